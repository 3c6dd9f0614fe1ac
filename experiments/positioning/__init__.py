"""The paper's Table 1, which compares the capabilities of radar simulation systems."""
