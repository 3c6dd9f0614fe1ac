"""Experiments with scenes or settings of increasing difficulty, which show where each simulation method fails."""
