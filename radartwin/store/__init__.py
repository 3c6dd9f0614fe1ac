"""The store of computed products, the cache of arrays, and the digests that form their keys."""
