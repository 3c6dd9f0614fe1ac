"""Calibration and recognition tables."""
