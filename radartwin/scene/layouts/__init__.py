"""Layouts: which objects stand where in a room."""
