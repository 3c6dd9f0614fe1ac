"""Calibration by one corner reflector: how far each material is off after a per-feature affine map from simulated to measured values.

One unlabelled recording of the reflector in both domains gives the map (radartwin/features/calibration.py) from the very figure that is
scored, the brightness of a revolution: one level, and so an offset. Fitted to the frames of a turn instead, its slope was what the room
puts into the reflector's shadow (0.59 at 1.5 m). It is applied to the brightness of every simulated object, and what is left is the
measured value less the mapped one. The reflector itself is not scored. Paper: corner-reflector radiometric calibration: metal aligns,
dielectrics stay too dim, liquid-filled containers most.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from experiments.recognition import readings, transfer
from experiments.recognition.labelled_probe import FEATURES, MOTION
from experiments.recognition.protocol import CALIBRATION_OBJECT, MATERIAL, Rows, cells
from experiments.recognition.readings import Campaign
from radartwin.config.config import Config
from radartwin.features import calibration
from radartwin.io.progress import Progress
from radartwin.plotting.style import PAGE_WIDTH_IN, PALETTE, figure
from radartwin.recognize.samples import Samples
from radartwin.recognize.score import mean_difference, seed_mean
from radartwin.runs.experiment import Result, Table
from radartwin.scene.objects.catalogue import catalogue
from radartwin.store.products import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE = Table(
    name="corner_reflector_calibration",
    title="Calibrated by one corner reflector",
    caption="The brightness difference between measured and simulated revolutions that remains after an affine map. The map comes from "
    "one unlabelled recording of the reflector at the middle distance; the reflector itself is not scored. Intervals are "
    "bootstraps over objects and distances.",
)

BRIGHTNESS = "brightness_db"
BEFORE, AFTER = "before calibration", "after calibration"
FILLED = "filled plastic"
ALIGNED_DB = 3.0  # a factor of two in power


def run(config: Config, store: Store, progress: Progress) -> Result:
    from experiments.campaign.campaign import Campaign as Recorded

    return score(config, Recorded(config, store, progress), progress)


def score(config: Config, campaign: Campaign, progress: Progress) -> Result:
    room = sorted({case.room for case in campaign.cases("measured", motion=MOTION)})[0]
    cases = dict(zip(("measured", "twin"), readings.shared_cases(campaign, MOTION, room), strict=True))
    progress.say(f"{len(cases['measured'])} measured and {len(cases['twin'])} simulated revolutions in {room}")
    measured, twin = (readings.vectors(campaign, domain, cases[domain], FEATURES) for domain in ("measured", "twin"))
    reflector = [
        readings.vectors(campaign, domain, [transfer.calibration_case(campaign, domain, room, MOTION)], FEATURES).samples.values
        for domain in ("twin", "measured")
    ]
    keys = tuple(sorted((*measured.keys, *twin.keys)))
    column = measured.samples.names.index(BRIGHTNESS)
    # The simulated reflector turns once: one level tells an offset and no slope.
    mapped = calibration.fit(reflector[0][:1, [column]], reflector[1][:, [column]])
    values = {BEFORE: twin.samples.values[:, column], AFTER: mapped.apply(twin.samples.values[:, [column]])[:, 0]}
    theirs = measured.samples.without(CALIBRATION_OBJECT)
    residual = {when: _residual(theirs, twin.samples, level, column) for when, level in values.items()}
    kinds = {name: _kind(name) for name in theirs.classes}
    table = Rows(config, [])
    offset = float(mapped.offset[0])
    table.add(
        {"materials": "reflector", "feature": BRIGHTNESS, "method": "the map"},
        "measured - simulated (dB)",
        (offset, offset, offset),
        1,
        keys,
    )
    left: dict[str, tuple[float, float, float]] = {}
    for when, found in residual.items():
        for kind in sorted(set(kinds.values())):
            rows = np.array([kinds[label] == kind for label in theirs.label])
            recordings = theirs.take(rows)
            low, value, high = seed_mean(found[rows], cells(recordings), config.profile.resamples, config.seed)
            claim, paper, holds = "", "", None
            if when == AFTER:
                left[kind] = (low, value, high)
                claim, paper = (
                    ("metal aligns within 3 dB", "aligned") if kind == "metal" else (f"{kind} stays too dim in simulation", "too dim")
                )
                holds = max(abs(low), abs(high)) <= ALIGNED_DB if kind == "metal" else low > 0
                holds = holds if np.unique(cells(recordings)).size > 1 else None  # one place has no interval
            case = {"materials": kind, "feature": BRIGHTNESS, "method": when}
            table.add(
                case,
                "measured - simulated (dB)",
                (low, value, high),
                np.unique(recordings.source).size,
                keys,
                paper=paper,
                claim=claim,
                holds=holds,
            )
    filled = np.array([kinds[label] == FILLED for label in theirs.label])
    for kind in sorted(set(kinds.values()) - {FILLED}) if filled.any() else ():
        rows = np.array([kinds[label] == kind for label in theirs.label])
        groups = (cells(theirs.take(filled)), cells(theirs.take(rows)))
        found = mean_difference(residual[AFTER][filled], residual[AFTER][rows], groups, config.profile.resamples, config.seed)
        case = {"materials": f"{FILLED} - {kind}", "feature": BRIGHTNESS, "method": AFTER}
        table.add(
            case, "difference of what is left (dB)", found, np.unique(theirs.source[filled | rows]).size, keys, paper="filled bottles most",
            claim=f"filled bottles are dimmer than {kind}",
            holds=found[0] > 0 if min(np.unique(group).size for group in groups) > 1 else None,
        )  # fmt: skip
    figures = {"corner_reflector_calibration": lambda: _figure(theirs, residual, kinds)}
    metrics = {f"residual_db_{kind.replace(' ', '_')}": value for kind, (_, value, _) in left.items()}
    return Result(TABLE.name, table.rows, figures, metrics, sorted(keys))


def _kind(name: str) -> str:
    """metal, ceramic, or filled plastic, by the catalogue."""
    found = catalogue()[name]
    return f"filled {MATERIAL[name]}" if found.contents and MATERIAL[name] == "plastic" else MATERIAL[name]


def _residual(measured: Samples, twin: Samples, level: NDArray, column: int) -> NDArray:
    """Measured value less the simulated one of the same object and distance, per measured recording."""
    simulated = {(label, stratum): one for label, stratum, one in zip(twin.label, twin.stratum, level, strict=True)}
    wanted = zip(measured.label, measured.stratum, strict=True)
    return measured.values[:, column] - np.array([simulated[pair] for pair in wanted])


def _figure(measured: Samples, residual: dict[str, NDArray], kinds: dict[str, str]) -> Figure:
    """Residual of every recording by object, before and after, materials side by side."""
    drawing, panels = figure(1, 2, width_in=PAGE_WIDTH_IN, height_in=2.9, sharey=False)
    objects = sorted(kinds, key=lambda name: (kinds[name], name))
    colours = dict(zip(sorted(set(kinds.values())), PALETTE, strict=False))
    for panel, (when, found) in zip(panels, residual.items(), strict=True):
        for place, name in enumerate(objects):
            points = found[measured.label == name]
            label = kinds[name] if [kinds[other] for other in objects].index(kinds[name]) == place else None
            panel.scatter(np.full(len(points), place), points, s=10, color=colours[kinds[name]], alpha=0.7, label=label)
        panel.axhline(0, color="0.5", lw=0.8)
        panel.set_xticks(range(len(objects)), [name.replace("_", " ") for name in objects], rotation=60, ha="right", fontsize=6)
        panel.set(title=when, ylabel="measured - simulated brightness (dB)")
    panels[1].legend(loc="best")
    return drawing
