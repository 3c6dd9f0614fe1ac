"""Measure the standard deviation of turntable features between recordings of the same object.

Feature scaling divides a feature by its standard deviation over the training rows, but at least by the standard deviation measured here.

    python -m experiments.generators.feature_floor      writes radartwin/recognize/feature_floor.json in about five core-minutes

The testbed records each object as in repeatability.py, but with a person who stands in the room. No table reports the draw DRAW of these
recordings, and no learner is chosen by them.
"""

import json
from pathlib import Path

import numpy as np

from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import MEASURED
from experiments.campaign.frame import stored
from experiments.generators.repeatability import DISTANCE_M, DRAW, REPEATS, repeated
from experiments.recognition.readings import revolutions
from radartwin.config.compose import compose
from radartwin.io import files
from radartwin.io.progress import Progress
from radartwin.recognize.probes import FLOOR
from radartwin.store.products import Store


def main() -> None:
    config, progress = compose(["experiment=campaign", "profile.campaign.turns=1"]), Progress()
    campaign = Campaign(config, Store(Path(config.output) / "cache", progress.say), progress)
    variances, names = [], ()
    for cases in progress.over(repeated(config, "turntable"), "objects"):
        samples = revolutions(stored(campaign, [(MEASURED, case) for case in cases], progress))
        names, variances = samples.names, [*variances, samples.values.var(axis=0, ddof=1)]
    deviation = np.sqrt(np.mean(variances, axis=0))
    source = (
        f"testbed, draw {DRAW}, which no table reports: {REPEATS} recordings of each object on the turntable at {DISTANCE_M:g} m, each set "
        "up anew; standard deviation pooled over objects; experiments/generators/feature_floor.py"
    )
    content = {"source": source, "deviation": {name: float(f"{value:.3g}") for name, value in zip(names, deviation, strict=True)}}
    files.write_atomically(FLOOR, json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()
