"""Tables about recordings of objects on a turntable and on a linear rail."""
