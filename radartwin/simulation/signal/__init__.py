"""Compute the IQ samples of a radar from propagation paths."""
