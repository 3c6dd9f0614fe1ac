"""A virtual measurement campaign that replaces real radar measurements.

It differs on purpose from the simulation that it is compared with.
"""
