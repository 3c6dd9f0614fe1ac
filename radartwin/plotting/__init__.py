"""Style of the figures."""
