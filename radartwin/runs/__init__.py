"""Runs and sweeps: experiments, launchers, workers, tracking, dashboard and doctor."""
