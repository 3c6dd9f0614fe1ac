"""Tables for a radar that moves on a rover."""
