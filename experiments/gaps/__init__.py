"""The gaps between testbed and twin: the effect of each gap alone, and its share of the total."""
