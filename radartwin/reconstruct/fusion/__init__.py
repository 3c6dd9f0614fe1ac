"""Fuse colour-and-depth frames into a mesh: alignment, a signed distance volume, marching cubes."""
