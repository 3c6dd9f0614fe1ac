"""Who says what a surface is made of."""
