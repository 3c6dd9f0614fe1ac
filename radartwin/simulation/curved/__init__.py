"""Simulate echoes of curved and small surfaces by ray tubes with physical optics."""
