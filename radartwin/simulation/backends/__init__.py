"""Simulators with one common interface (`backend.Backend`)."""
