"""From RGB-D frames to a mesh."""
