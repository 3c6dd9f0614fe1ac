"""Run experiments and sweeps: interface of an experiment, launchers, workers, MLflow tracking, dashboard and doctor command."""
