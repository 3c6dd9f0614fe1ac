"""Contain four simulators of radar propagation paths, which implement one common interface (`backend.Backend`)."""
