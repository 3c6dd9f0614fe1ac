"""Surfaces and scenes, procedural rooms, objects and their layouts, trajectories, and a 3D page of a scene."""
