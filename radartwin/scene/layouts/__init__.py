"""Layouts: objects and their places in a room, from files and sentences."""
