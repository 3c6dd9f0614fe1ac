"""How figures look, and how a figure becomes an interactive page."""
