"""Simulate the recordings of several tables together, so that every recording is simulated once and all workers are busy.

A module of an experiment may define two functions. `recordings(config, store, progress)` returns the tasks of the recordings that the table
reads and the store lacks. `calls(config)` returns further simulations as tuples (function, arguments...), which save their results in the
store.
"""

from collections.abc import Sequence
from pathlib import Path

from experiments.campaign.campaign import joined, make_together
from experiments.interface import Config, Progress, Store
from radartwin.runs import run
from radartwin.runs.experiment import load


def simulate(configs: Sequence[Config], progress: Progress) -> None:
    """Make the recordings and further simulations that the experiments need, with the number of workers of the first configuration."""
    missing, calls = [], []
    for config in configs:
        if not run.finished(config):
            module, store = load(config.experiment), Store(Path(config.output) / "cache", progress.say)
            if recordings := getattr(module, "recordings", None):
                missing.append(recordings(config, store, progress))
            if further_calls := getattr(module, "calls", None):
                calls += further_calls(config)
    make_together(joined(missing), configs[0].jobs, progress, calls=calls)
