"""Show a scene as a standalone 3D web page, which needs no server."""
