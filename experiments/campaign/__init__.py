"""The recordings that all tables share: measured and simulated ones. Each is simulated once and then stored."""
