"""From a configuration to the objects it describes: radar, scene, trajectory, recording."""
