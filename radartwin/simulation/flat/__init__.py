"""Echoes of flat faces with edges: rooms, objects of flat faces, shadows and panes."""
