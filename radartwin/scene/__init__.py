"""What is in the room: surfaces and scenes, procedural rooms, canonical objects, trajectories, a page to look at them."""
