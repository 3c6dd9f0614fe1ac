"""Tables about calibration by a corner reflector and about recognition of objects and materials."""
