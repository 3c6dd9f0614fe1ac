"""Turn a scan of a room into a scene: read and check the scan, segment it into surfaces, and flatten the surfaces."""
