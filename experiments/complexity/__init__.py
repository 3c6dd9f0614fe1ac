"""How much model a scene needs."""
