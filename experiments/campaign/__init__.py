"""Measured and simulated recordings that all tables share. Each recording is simulated once and then read from the store."""
