"""Tables of the moving radar."""
