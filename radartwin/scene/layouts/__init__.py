"""Place objects in a room according to an object layout, which is given as a YAML file or as an English sentence."""
