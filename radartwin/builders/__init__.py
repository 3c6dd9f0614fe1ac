"""Functions that build the radar, scene, trajectory, simulator and recording from a composed configuration."""
