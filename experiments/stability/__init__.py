"""Sweeps of increasing difficulty that show where each simulation method fails."""
