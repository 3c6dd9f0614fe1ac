"""Compare simulation methods by run time, feature error and recognition error on the turntable recordings of the campaign.

The feature error compares the features of a simulated revolution with their mean over measured ones of the object, as the rms over features
in standard deviations, after one common gain is removed from brightness. The recognition error is the share of measured revolutions whose
symmetry a linear classifier of ranks, trained on simulation, gets wrong. The run time is the median of the recordings that reused a traced
room, plus their share of the longest set-up, in processor seconds per frame. The paper profile uses the recordings of the quick profile
with the changes LONGER.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from experiments import cells
from experiments.campaign import tally
from experiments.campaign.campaign import Campaign, joined
from experiments.campaign.cases import BENCH_ROOM, TWIN
from experiments.campaign.frame import shared, stored
from experiments.campaign.schedule import RecordingTask
from experiments.interface import Config, Progress, Store
from experiments.recognition.protocol import GEOMETRY
from experiments.recognition.readings import MOTION, revolutions
from experiments.recognition.transfer import ranked
from experiments.scans import virtual_scan
from experiments.speed.methods import DEFAULT, OURS, POINTS, RFGENESIS
from radartwin.config.compose import compose
from radartwin.config.materials import VoidMaterials
from radartwin.features.families import BRIGHTNESS
from radartwin.recognize.probes import transferred_probe
from radartwin.recognize.samples import Samples
from radartwin.recognize.split import label_free

NAME = "campaign"
TITLE = "turntables of twelve objects in the laboratory"
LONGER = ("profile.campaign.reflector_repeats=3",)  # changes of the quick profile


@dataclass(frozen=True)
class Twin:
    """The settings with which one method simulates the campaign."""

    family: str  # name of the simulation method
    setting: str
    simulator: tuple[str, ...] = ()  # command-line options that select the simulator
    changed: Mapping[str, Any] = field(default_factory=dict)  # parts of the configuration that are replaced


def twins(full: bool) -> list[Twin]:
    """Return the compared methods, the default first; if `full`, with more settings."""
    few = [
        Twin(OURS, DEFAULT),
        Twin(OURS, "no room", changed={"materials": VoidMaterials()}),
        Twin(RFGENESIS, "corrected, 128 x 128", ("simulator=rfgenesis", "simulator.version=corrected")),
    ]
    if not full:
        return few
    return [
        *few,
        Twin(POINTS, "far-field table", ("simulator=points",)),
        Twin(OURS, "1 bounce", ("simulator.max_bounces=1",)),
        Twin(OURS, "2 bounces", ("simulator.max_bounces=2",)),
        Twin(OURS, "0.25 tubes per square wavelength", ("simulator.rays_per_wavelength2=0.25",)),
        Twin(OURS, "object and room uncoupled", ("simulator.coupling=false",)),
        Twin(OURS, "planar elements", ("simulator.elements=planar",)),
        Twin(RFGENESIS, "shipped, 128 x 128", ("simulator=rfgenesis",)),
    ]


def recordings(config: Config, store: Store, progress: Progress, full: bool) -> dict[str, RecordingTask]:
    """Return {store key: task} of the recordings that `measure` needs and the store lacks."""
    missing = []
    for method in twins(full):
        campaign = Campaign(_configured(config, method, full), store, progress, draw=0)
        missing.append(campaign.missing(shared(campaign, (MOTION,), several=True)))
    return joined(missing)


def measure(config: Config, store: Store, progress: Progress, full: bool) -> list[dict[str, Any]]:
    """Simulate the campaign with every method and return one row per method, without the time of the scan that all use."""
    virtual_scan.fetch(config, store, BENCH_ROOM, config.measured.gap.geometry)
    rows = []
    for method in progress.over(twins(full), "methods on the campaign"):
        campaign = Campaign(_configured(config, method, full), store, progress, draw=0)
        wanted = shared(campaign, (MOTION,), several=True)
        simulated = [case for domain, case in wanted if domain == TWIN]
        campaign.prepare([(TWIN, case) for case in simulated], fresh=True)
        frame = stored(campaign, wanted, progress)
        reference, made = revolutions(frame), revolutions(frame, domain=TWIN)
        error, spread = feature_error(made, reference)
        missed = recognition_error(made, reference)
        rows.append({
            "problem": NAME, "family": method.family, "setting": method.setting, **_cost(campaign, simulated), "feature_error": error,
            "spread of feature_error": spread, "recognition_error": missed, "answers": len(reference), "exact": False,
            "keys": cells.keys(frame[frame.domain == TWIN]),
        })  # fmt: skip
    return rows


def _configured(config: Config, method: Twin, full: bool) -> Config:
    """Return the configuration of the recognition tables with this method as the simulator."""
    recognition_config = compose(["experiment=labelled_probe", "profile=quick", *(LONGER if full else ()), *method.simulator])
    same = {name: getattr(config, name) for name in ("measured", "radar", "seed", "output", "jobs")}
    return replace(recognition_config, **same, **method.changed)


def _cost(campaign: Campaign, cases: Sequence[Any]) -> dict[str, Any]:
    """Return processor seconds per frame of recordings that reused a set-up (median, each), plus their share of the longest set-up."""
    made = [campaign.clean("twin", case).read_json("meta") for case in cases]
    frames = [meta["told"]["frames"] for meta in made]
    setups = [int(meta["told"].get(tally.SETUPS, 0)) for meta in made]
    each = [meta["core_seconds"] / n for meta, n, k in zip(made, frames, setups, strict=True) if not k] or [
        meta["core_seconds"] / n for meta, n in zip(made, frames, strict=True)
    ]
    middle = float(np.median(each))
    took = [(meta["core_seconds"] - middle * n) / k for meta, n, k in zip(made, frames, setups, strict=True) if k]
    share = max(max(took, default=0.0), 0.0) / sum(frames)
    return {"seconds_frame": middle + share, "seconds": [seconds + share for seconds in each]}


def feature_error(simulated: Samples, measured: Samples) -> tuple[float, float]:
    """Return the error in standard deviations of the measured features that vary, and its standard error over recordings."""
    spread = measured.values.std(axis=0)
    tells = spread > 1e-9 * np.abs(measured.values).max(axis=0)
    apart = np.stack([
        values - measured.values[(measured.label == label) & (measured.stratum == stratum)].mean(axis=0)
        for label, stratum, values in zip(simulated.label, simulated.stratum, simulated.values, strict=True)
    ])  # fmt: skip
    levels = np.array([name == BRIGHTNESS for name in simulated.names])
    apart[:, levels] -= apart[:, levels].mean(axis=0)
    squares = ((apart[:, tells] / spread[tells]) ** 2).mean(axis=1)
    error = float(np.sqrt(squares.mean()))
    return error, float(squares.std(ddof=1) / np.sqrt(len(squares)) / (2 * error)) if error and len(squares) > 1 else 0.0


def recognition_error(simulated: Samples, measured: Samples) -> float:
    """Return the share of measured revolutions whose symmetry a classifier trained on simulated revolutions gets wrong."""
    split = label_free(ranked(simulated).relabelled(GEOMETRY), ranked(measured).relabelled(GEOMETRY))
    return float(np.mean(transferred_probe(split) != split.test.label))
