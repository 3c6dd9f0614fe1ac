"""Style of the figures, and interactive HTML pages of the figures."""
