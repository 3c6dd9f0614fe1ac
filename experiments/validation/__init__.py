"""The tracer against independent oracles and against Sionna RT."""
