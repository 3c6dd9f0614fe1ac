"""The paper's Table 1: what each system can do."""
