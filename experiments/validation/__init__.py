"""Comparisons of the tracer with independent reference values (oracles), with Sionna RT and with RF-Genesis."""
