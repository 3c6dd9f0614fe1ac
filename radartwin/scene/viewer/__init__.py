"""Show a scene as a standalone 3D web page."""
