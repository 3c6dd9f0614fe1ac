"""Divide the mesh of a scan into segments. Each segment is a set of faces that forms a single surface, such as a wall or a cabinet side."""
