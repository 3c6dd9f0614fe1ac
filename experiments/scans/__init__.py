"""Reconstruction and labelling tables."""
