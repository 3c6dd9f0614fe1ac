"""A simulated measurement campaign that takes the place of real measurements. It differs from the twin on purpose."""
