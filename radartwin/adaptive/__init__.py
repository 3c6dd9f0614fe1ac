"""`simulator=auto`: choose the cheapest model of a scene whose features change by less than their repeatability limits."""
