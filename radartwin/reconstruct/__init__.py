"""Turn a scan into a scene: read and check it, segment it into surfaces, flatten the surfaces, and label them."""
