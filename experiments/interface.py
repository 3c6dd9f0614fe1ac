"""The types of an experiment's function `run(config, store, progress) -> Result`, and of the description of its table."""

from radartwin.config.config import Config
from radartwin.io.progress import Progress
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

__all__ = ["Config", "Progress", "Result", "Store", "Table"]
