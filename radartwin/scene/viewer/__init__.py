"""A scene as a standalone 3D page."""
