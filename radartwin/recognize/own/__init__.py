"""Train a recogniser of the user's own objects on simulation alone. The command `radartwin train` calls this package."""
