"""Synthesis of IQ samples from paths."""
