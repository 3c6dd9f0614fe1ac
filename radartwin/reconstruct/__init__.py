"""A scan becomes a scene: mesh files checked, segmented into surfaces, flattened and labelled."""
