"""The study: one module per table, each with `run(config, store, progress) -> Result` (radartwin/runs/experiment.py)."""
