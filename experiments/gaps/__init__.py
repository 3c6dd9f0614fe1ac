"""Experiments on gaps (known differences between virtual measurement and simulation): the effect of each gap alone, and its share of
the total.
"""
