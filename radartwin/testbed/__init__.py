"""A virtual measurement campaign that replaces real radar measurements.

The campaign differs on purpose from the simulation with which it is compared.
"""
