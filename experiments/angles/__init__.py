"""Angle estimation: how close two targets may be for each spectrum to separate them."""
