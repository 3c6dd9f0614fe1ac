"""Turn the segments of a scan into the surfaces of a scene: outline, complete, flatten, simplify and colour each segment."""
