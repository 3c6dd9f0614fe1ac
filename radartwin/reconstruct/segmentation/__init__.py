"""From a mesh to segments: coherent surfaces of a scan."""
