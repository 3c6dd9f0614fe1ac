"""RGB-D frames with poses: reading, checking and writing them."""
