"""Wrong materials: what recognition and level lose as more and more of the room's surfaces carry a wrong label.

A share p of the room's labels is replaced by random ones (materials=random), from none, the truth, to all; beside them the configured
source. Scored label-free on lateral sweeps in the squash court, as the reconstruction ablation, and by the level of the whole range
profile against the twin with true materials, from 0.3 to 5.5 m.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from experiments.recognition import readings, transfer
from experiments.recognition.protocol import Rows, cells, right
from experiments.recognition.readings import Campaign
from experiments.recognition.reconstruction_ablation import MOTION, ROOM
from radartwin.config.config import Config
from radartwin.config.materials import MaterialsConfig, RandomMaterials, TrueMaterials
from radartwin.io.progress import Progress
from radartwin.plotting.style import PAGE_WIDTH_IN, PALETTE, figure
from radartwin.recognize.samples import Samples
from radartwin.recognize.score import seed_mean, uniform_chance
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE = Table(
    name="material_errors",
    title="What wrong materials cost",
    caption="The protocol of the reconstruction ablation, with a share of the room's labels replaced at random. The level error is the "
    "root mean square over range, 0.3 to 5.5 m, against the twin with true materials.",
)

WRONG = (0.0, 0.25, 0.5, 1.0)


def run(config: Config, store: Store, progress: Progress) -> Result:
    from experiments.campaign.campaign import Campaign as Recorded
    from experiments.campaign.campaign import make_together

    campaigns = {name: Recorded(replace(config, materials=materials), store, progress) for name, (_, materials) in sources(config).items()}
    make_together({key: one for some in campaigns.values() for key, one in transfer.missing(some, ROOM, MOTION).items()}, progress)
    return score(config, campaigns, progress)


def sources(config: Config) -> dict[str, tuple[float | None, MaterialsConfig]]:
    """By name: the share of wrong labels, and the configuration; the configured source has no known share."""
    found: dict[str, tuple[float | None, MaterialsConfig]] = {"true materials": (0.0, TrueMaterials())}
    for share in WRONG[1:] if config.profile.name != "quick" else WRONG[-1:]:  # a twin of the room for each
        found[f"{100 * share:g} % random"] = (share, RandomMaterials(p=share))
    return found | {f"as configured ({config.materials.source})": (None, config.materials)}


def score(config: Config, campaigns: Mapping[str, Campaign], progress: Progress) -> Result:
    """`campaigns`: by the names of `sources`."""
    table = Rows(config, [])
    used: set[str] = set()
    reference: Samples | None = None
    first: NDArray | None = None
    curve: list[dict[str, Any]] = []
    for name, (share, _) in sources(config).items():
        progress.say(f"{MOTION} sweeps in {ROOM}: {name}")
        campaign = campaigns[name]
        frames = transfer.read(campaign, ROOM, MOTION)
        used |= set(frames.keys)
        truth = frames.measured.per_recording()
        hits = right(transfer.answers(config, transfer.ranked_split(frames)), truth.label)
        case = {"method": name, "wrong": share}
        row = table.share(case, hits, truth, frames.keys, uniform_chance(truth))
        profiles = readings.vectors(campaign, "twin", readings.shared_cases(campaign, MOTION, ROOM)[1], "raw")
        levels = profiles.samples
        if reference is None or first is None:
            reference, first = levels, hits
        else:
            claim = "wrong labels cost recognition" if share == 1 else ""
            table.gain(case | {"method": f"true materials - {name}"}, first, hits, truth, frames.keys, claim=claim)
        error = np.sqrt(np.mean((levels.values - reference.values) ** 2, axis=1))
        interval = seed_mean(error, cells(levels), config.profile.resamples, config.seed)
        told = case | {"answers": len(levels), "chance": None, "p": None, "seed_sd": None}
        other = table.add(told, "level error of the range profile (dB)", interval, len(levels), profiles.keys)
        curve.append({"name": name, "share": share, "accuracy": row, "error": other})
    metrics = {f"accuracy_wrong_{point['share']:g}": point["accuracy"]["value"] for point in curve if point["share"] is not None}
    return Result(TABLE.name, table.rows, {"material_errors": lambda: _figure(curve)}, metrics, sorted(used))


def _figure(curve: list[dict[str, Any]]) -> Figure:
    """Accuracy and level error against the share of wrong labels; the configured source is a band across."""
    drawing, panels = figure(1, 2, width_in=PAGE_WIDTH_IN, height_in=2.6)
    known, configured = [point for point in curve if point["share"] is not None], curve[-1]
    for panel, quantity, label in zip(panels, ("accuracy", "error"), ("label-free accuracy", "level error (dB)"), strict=True):
        value, low, high = (np.array([point[quantity][column] for point in known]) for column in ("value", "low", "high"))
        share = [100 * point["share"] for point in known]
        panel.errorbar(share, value, [value - low, high - value], marker="o", ms=4, capsize=2, color=PALETTE[0], label="random labels")
        row = configured[quantity]
        panel.axhspan(row["low"], row["high"], color=PALETTE[1], alpha=0.2, lw=0)
        panel.axhline(row["value"], color=PALETTE[1], lw=1, label=configured["name"])
        panel.set(xlabel="wrong labels of the room (%)", ylabel=label, ylim=(0, None))
    panels[0].axhline(known[0]["accuracy"]["chance"], color="black", ls="--", lw=0.8, label="chance")
    panels[0].legend(loc="best")
    return drawing
