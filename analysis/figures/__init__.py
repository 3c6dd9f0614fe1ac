"""Scripts that draw the figures of the documents in docs/."""
