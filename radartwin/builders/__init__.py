"""Build objects of the library from a composed configuration: radar, scene, trajectory, simulator, recording."""
