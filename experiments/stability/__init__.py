"""Where each method fails, along sweeps of increasing difficulty."""
