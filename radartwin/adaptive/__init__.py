"""simulator=auto: the cheapest model of a scene whose features stay within their measured repeatability.

`model` defines the parts of a scene that can be left out, `limits` the tolerated change of each feature, `probe` the features of a
few frames under a model, and `choice` the greedy search.
"""
