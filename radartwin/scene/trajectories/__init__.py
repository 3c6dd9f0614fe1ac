"""Compute the poses of the sensor and of moving objects, or read these poses from files."""
