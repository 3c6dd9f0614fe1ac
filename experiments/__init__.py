"""The tables of the study. Each module has a function `run(config, store, progress) -> Result` (radartwin/runs/experiment.py)."""
