"""Compute the poses of the sensor and of moving objects, or read them from files."""
