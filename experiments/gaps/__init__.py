"""The gaps between testbed and twin: each alone, and their shares."""
