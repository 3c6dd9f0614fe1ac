"""SHA-256 of each room's answers.json, written by `radartwin.label.recorded.ship`: what depends on the answers depends on this module."""

DIGESTS: dict[str, str] = {}
