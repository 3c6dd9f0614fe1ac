"""`simulator=auto`: choose the cheapest model of a scene whose features change by less than their repeatability limits.

`model` defines the settings of a model, such as the simulated parts of the room. `limits` holds the tolerated change of each feature.
`probe` computes the features of a few frames under a model. `choice` runs the greedy search.
"""
