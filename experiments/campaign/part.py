"""Simulate one part of the campaign's recordings, so that the jobs of a sweep on several machines share the campaign.

The recordings in the order of `Campaign.plan`, in which those along one path of the radar are adjacent, are cut into n parts of about equal
size. The store locks a result while a job computes it, so that no two jobs compute the same scan, and the next call of a killed job
continues it.
"""

import numpy as np

from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import Case
from experiments.interface import Config, Progress, Result, Store
from experiments.statistics import exact
from experiments.verdicts import RowList

NAME = "campaign_part"
READS = ("part", "parts")  # options experiment.NAME of this experiment


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Simulate the recordings of one part that the store lacks. Raises UserError if a recording cannot be simulated."""
    campaign, options = Campaign(config, store, progress), config.experiment
    wanted = part(campaign.plan(), options.part, options.parts)
    campaign.prepare(wanted)
    keys = [campaign.process(domain, case).key for domain, case in progress.over(wanted, "recordings")]
    rows = RowList(config)
    rows.add({"part": options.part, "parts": options.parts}, "recordings", exact(len(wanted), len(wanted)), keys)
    return Result(NAME, rows, {}, {"recordings": len(wanted)}, keys)


def part(plan: list[tuple[str, Case]], number: int, parts: int) -> list[tuple[str, Case]]:
    """Return part `number` (0 to parts - 1) of the planned recordings. The sizes of two parts differ by at most one recording.

    >>> [part([("twin", k) for k in range(5)], number, 2) for number in (0, 1)]
    [[('twin', 0), ('twin', 1), ('twin', 2)], [('twin', 3), ('twin', 4)]]
    """
    edges = np.cumsum([0, *(len(section) for section in np.array_split(np.arange(len(plan)), parts))])
    return plan[edges[number] : edges[number + 1]]
