"""The recordings that the tables share: of the measured domain and of its twin, each simulated once and stored."""
