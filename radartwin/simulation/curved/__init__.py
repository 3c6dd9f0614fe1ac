"""Shooting and bouncing ray tubes with physical optics, for curved and small surfaces."""
