"""Measure the repeatability limits of features. simulator=auto divides the feature error of a simulation model by these limits.

    python -m experiments.generators.repeatability            writes radartwin/adaptive/repeatability.json in about twenty core-minutes

The testbed (virtual measurement) records each object REPEATS times at one metre, in draw DRAW, which no table reports. For each recording,
the object is placed again, and the drive's slip, the turntable's wobble, the room's drift and the receiver noise are drawn again. Nobody
stands in the room. With a person at another place in each recording, the mean range profile would differ by 12 dB instead of 2 dB. With
limits of this size, simulator=auto would accept a simulation without a room. The output file has a repeatability limit for each object, and
a pooled limit for unknown objects. The standard deviation of so few recordings is uncertain by a third, so the limits include a margin.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import BENCH_ROOM, RAIL, Case, Motion
from experiments.interface import Config, Progress, Store
from radartwin.adaptive import limits
from radartwin.config.compose import compose
from radartwin.features import families
from radartwin.io import files

REPEATS = 5
DRAW = 501  # draw of the testbed that no table reports and that choices.py does not use
DISTANCE_M = 1.0
ROOM = "squash_court"  # room of the drives
DRIVEN = ("track", "multipath", "window", "extent", "brightness", "profile")
FAMILIES: dict[Motion, tuple[str, ...]] = {
    "turntable": ("harmonics", "envelope", "extent", "brightness", "multipath", "profile"),
    "radial": DRIVEN,
    "diagonal": DRIVEN,
    "depth": DRIVEN,
    "lateral": ("harmonics", "envelope", *DRIVEN),
}
Read = tuple[Sequence[str], np.ndarray]


def repeated(config: Config, motion: Motion) -> list[list[Case]]:
    """Return the cases to record for one motion in draw DRAW of the testbed, as one list of REPEATS cases per object."""
    campaign = config.profile.campaign
    if motion == "turntable":
        from radartwin.scene.objects.catalogue import catalogue

        objects, room = campaign.turntable_objects or list(catalogue()), BENCH_ROOM
    elif motion in RAIL:
        objects, room = campaign.rail_objects, BENCH_ROOM
    else:
        objects, room = campaign.rover_objects, ROOM
    return [[Case(name, room, motion, DISTANCE_M, number, DRAW) for number in range(REPEATS)] for name in objects]


def read(campaign: Campaign, motion: Motion, cases: Sequence[Case]) -> Read:
    """Return the feature names, and the feature values (recordings, features) of the cases of one object."""
    rows = []
    for case in cases:
        processed = campaign.processed("measured", case)[1]
        names, values = families.read(processed, campaign.log(case), FAMILIES[motion], turns=motion == "turntable")
        rows.append(values)
    return names, np.stack(rows)


def summary(groups: Mapping[str, Mapping[str, Read]]) -> dict[str, Any]:
    """Return the content of the file of repeatability limits from {motion: {object: (feature names, values (recordings, features))}}."""

    def rounded(readings: Sequence[Read]) -> dict[str, float]:
        return {name: float(f"{limit:.3g}") for name, limit in limits.measured(readings).items()}

    motions = {
        motion: {"pooled": rounded(list(of.values())), "objects": {name: rounded([reading]) for name, reading in of.items()}}
        for motion, of in groups.items()
    }
    setting = f"{REPEATS} recordings of each object at {DISTANCE_M:g} m, each set up anew"
    source = f"testbed without a person, draw {DRAW}, {setting}; experiments/generators/repeatability.py"
    return {"source": source, "motions": motions}


def main() -> None:
    """Measure the repeatability limits and write them to the package file."""
    config, progress = compose(["experiment=campaign", "measured.gap.person=0", "profile.campaign.turns=1"]), Progress()
    campaign = Campaign(config, Store(Path(config.output) / "cache", progress.say), progress)
    groups = {}
    for motion in FAMILIES:
        cases = repeated(config, motion)
        campaign.prepare([("measured", case) for repetitions in cases for case in repetitions])
        groups[motion] = {repetitions[0].object: read(campaign, motion, repetitions) for repetitions in progress.over(cases, motion)}
    files.write_atomically(limits.SHIPPED, json.dumps(summary(groups), indent=1) + "\n")


if __name__ == "__main__":
    main()
