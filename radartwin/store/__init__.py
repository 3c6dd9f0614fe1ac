"""The store of computed results on the disk, the cache of arrays, and the digests from which the keys of stored results are formed."""
