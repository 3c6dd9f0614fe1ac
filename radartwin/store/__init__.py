"""The store of computed products and the digests that form its keys."""
