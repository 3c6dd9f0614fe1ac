"""The experiments of the study. Each experiment module has `run(config, store, progress) -> Result` (radartwin/runs/experiment.py)."""
