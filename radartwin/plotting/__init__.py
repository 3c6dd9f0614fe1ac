"""The style of figures, and their interactive pages."""
