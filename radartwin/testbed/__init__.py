"""The virtual measurement campaign, which deliberately differs from the twin."""
