"""From a composed configuration to objects of the library: radar, scene, trajectory, simulator, recording."""
