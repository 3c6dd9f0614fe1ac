"""Tables about recordings of a radar that moves on a rover."""
