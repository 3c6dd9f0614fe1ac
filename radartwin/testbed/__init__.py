"""The virtual measurement campaign. It differs from the twin on purpose."""
