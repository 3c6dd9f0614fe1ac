"""Colour-and-depth frames with camera poses: the data type, and the folder layouts that hold them."""
