"""From segments to the surfaces of a scene."""
