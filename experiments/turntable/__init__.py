"""Tables of the turntable and the rail."""
