"""Build and store scenes: surfaces, procedural rooms, objects, layouts of objects, trajectories, and a 3D web page of a scene."""
