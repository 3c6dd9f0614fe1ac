"""Place objects in a room according to a layout, which is a file or a sentence."""
