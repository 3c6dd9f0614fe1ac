"""Fuse colour-and-depth frames into a mesh: align the poses, average the depth in a signed distance volume, and extract the surface."""
