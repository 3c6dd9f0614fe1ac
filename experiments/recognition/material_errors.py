"""Effect of wrong materials: how do recognition accuracy and level error change if more surfaces of the room have a wrong material?

The share of wrong material labels grows from none (true materials) to all (materials=random). The table also shows the configured material
source for comparison. Objects are recognised by the method of experiments/recognition/reconstruction_ablation.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments import draws
from experiments.campaign.campaign import Campaign, joined, make_together
from experiments.campaign.schedule import RecordingTask
from experiments.campaign.source import RecordingSource
from experiments.claims import Claim
from experiments.drawing import error_bars
from experiments.recognition import readings, transfer
from experiments.recognition.protocol import FLOOR_ONLY, RecognitionRows, correct, statistics_columns
from experiments.recognition.reconstruction_ablation import MOTION, ROOM
from experiments.statistics import POSITIVE, clustered
from radartwin.config.config import Config
from radartwin.config.materials import MaterialsConfig, RandomMaterials, TrueMaterials
from radartwin.io.progress import Progress
from radartwin.plotting.style import PAGE_WIDTH_IN, PALETTE, figure
from radartwin.recognize.score import uniform_chance
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE = Table(
    name="material_errors",
    title="Effect of wrong materials",
    caption="Label-free recognition of lateral drives in the squash court, with a share of the room's material labels replaced at "
    "random. The level error is the root mean square difference of the range profile in decibels, 0.3 to 5.5 m, from the "
    "twin with true materials.",
)

TRUE = "true materials"
WRONG = (0.25, 0.5, 1.0)  # shares of labels that are replaced


def run(config: Config, store: Store, progress: Progress) -> Result:
    make_together(recordings(config, store, progress), config.jobs, progress)
    return draws.joined([score(config, campaigns(config, store, progress, draw), progress) for draw in draws.numbers(config, rover=True)])


def recordings(config: Config, store: Store, progress: Progress) -> dict[str, RecordingTask]:
    return joined(transfer.missing(one, ROOM, MOTION) for one in campaigns(config, store, progress).values())


def campaigns(config: Config, store: Store, progress: Progress, draw: int | None = None) -> dict[str, Campaign]:
    """Return the campaign of each material source in `sources`, for one draw or (with None) for all draws."""
    return {name: Campaign(replace(config, materials=materials), store, progress, draw) for name, (_, materials) in sources(config).items()}


def sources(config: Config) -> dict[str, tuple[float | None, MaterialsConfig]]:
    """Return {name: (share of wrong material labels, material source)}; the share is None for the configured material source."""
    found: dict[str, tuple[float | None, MaterialsConfig]] = {TRUE: (0.0, TrueMaterials())}
    for share in WRONG if config.profile.name != "quick" else WRONG[-1:]:
        found[f"{100 * share:g} % random"] = (share, RandomMaterials(p=share))
    return found | {f"as configured ({config.materials.source})": (None, config.materials)}


def score(config: Config, campaigns: Mapping[str, RecordingSource], progress: Progress) -> Result:
    """Build rows of accuracy, of the accuracy lost by wrong materials, and of level error. `campaigns` is a dictionary of campaigns
    with the same keys as the result of `sources`.
    """
    rows = RecognitionRows(config)
    used: set[str] = set()
    curve: list[dict[str, Any]] = []
    reference = first = None  # profiles and correct predictions with true materials, which are the first source
    for name, (share, _) in sources(config).items():
        progress.say(f"{MOTION} drives in {ROOM}: {name}")
        source = campaigns[name]
        frames = transfer.read(source, ROOM, MOTION)
        used |= set(frames.keys)
        truth = frames.measured.per_recording()
        hits = correct(transfer.predict(config, transfer.ranked_split(frames)), truth.label)
        case = {"method": name, "wrong": share}
        accuracy = rows.share(case, hits, truth, frames.keys, uniform_chance(truth))
        profiles = readings.vectors(source, "twin", readings.shared_cases(source, MOTION, ROOM)[1], "raw")
        levels = profiles.samples
        if reference is None or first is None:
            reference, first = levels.values, hits
        else:
            claim = Claim("wrong labels cost recognition", untestable=FLOOR_ONLY) if share == 1 else Claim()
            rows.gain(case | {"method": f"{TRUE} - {name}"}, first, hits, truth, frames.keys, claim)
        difference = np.sqrt(np.mean((levels.values - reference) ** 2, axis=1))
        found = clustered(difference, levels.object, config.profile.resamples, config.seed, limits=POSITIVE)
        error = rows.add(case | statistics_columns(len(levels)), "level error of the range profile (dB)", found, profiles.keys)
        curve.append({"name": name, "share": share, "accuracy": accuracy, "error": error})
    metrics = {f"accuracy_wrong_{point['share']:g}": point["accuracy"]["value"] for point in curve if point["share"] is not None}
    return Result("material_errors", rows, {"material_errors": lambda: _figure(curve)}, metrics, sorted(used))


def _figure(curve: list[dict[str, Any]]) -> Figure:
    """Draw accuracy and level error against the share of wrong material labels. A horizontal band shows the accuracy and level error
    of the configured material source.
    """
    drawing, panels = figure(1, 2, width_in=PAGE_WIDTH_IN, height_in=2.6)
    known, configured = [point for point in curve if point["share"] is not None], curve[-1]
    for panel, quantity, label in zip(panels, ("accuracy", "error"), ("label-free accuracy", "level error (dB)"), strict=True):
        value, errors = error_bars(point[quantity] for point in known)
        share = [100 * point["share"] for point in known]
        panel.errorbar(share, value, errors, marker="o", ms=4, capsize=2, color=PALETTE[0], label="random labels")
        row = configured[quantity]
        panel.axhspan(row["low"], row["high"], color=PALETTE[1], alpha=0.2, lw=0)
        panel.axhline(row["value"], color=PALETTE[1], lw=1, label=configured["name"])
        panel.set(xlabel="wrong labels of the room (%)", ylabel=label, ylim=(0, None))
    panels[0].axhline(known[0]["accuracy"]["chance"], color="black", ls="--", lw=0.8, label="chance")
    panels[0].legend(loc="best")
    return drawing
