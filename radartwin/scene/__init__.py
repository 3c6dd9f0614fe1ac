"""Build and store scenes: surfaces, procedural rooms, objects, object layout files, sensor trajectories, and a 3D web page of a scene."""
