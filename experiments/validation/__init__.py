"""Compare RadarTwin's ray tracer with independent reference values (oracles), with Sionna RT and with RF-Genesis."""
