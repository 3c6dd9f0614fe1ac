"""Tables about the reconstruction of scans and the labelling of materials."""
