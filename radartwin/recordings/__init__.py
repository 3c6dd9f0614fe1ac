"""Recording sets: real captures with their index, data card and checks."""
