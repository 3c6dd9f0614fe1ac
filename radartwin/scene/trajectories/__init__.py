"""Poses of the sensor and of moving objects, computed or read from files."""
