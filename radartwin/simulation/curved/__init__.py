"""Ray tubes with physical optics, for curved and small surfaces."""
