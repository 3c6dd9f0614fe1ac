"""Calibration by a corner reflector: the echo power error of each material, before and after calibration from simulated to measured level.

The calibrated feature is the brightness of a revolution (radartwin/features/envelope.py). A single reflector gives a single level, so the
calibration is an offset in decibels. A straight line fitted to the levels of single frames would have a slope of 0.59 at 1.5 m, because
echoes of the room dominate at angles where the reflector's echo is weak. Paper (corner-reflector radiometric calibration): after
calibration, metal objects agree with the measurement, dielectric objects stay too dim, and liquid-filled containers are the dimmest.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from experiments import draws
from experiments.campaign.cases import COMPARED, REFLECTOR
from experiments.campaign.source import RecordingSource
from experiments.claims import Claim, within
from experiments.recognition import readings, transfer
from experiments.recognition.protocol import MATERIAL, RecognitionRows, count_sources
from experiments.recognition.readings import FEATURES, MOTION
from experiments.statistics import clustered, difference, exact
from radartwin.config.config import Config
from radartwin.features.normalise import fit_map
from radartwin.features.sets import BRIGHTNESS
from radartwin.io.progress import Progress
from radartwin.plotting.style import PAGE_WIDTH_IN, PALETTE, figure
from radartwin.recognize.samples import Samples
from radartwin.runs.experiment import Result, Table
from radartwin.scene.objects.catalogue import catalogue
from radartwin.store.products import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE = Table(
    name="corner_reflector_calibration",
    title="Calibrated by one corner reflector",
    caption="The brightness difference between measured and simulated revolutions that remains after an affine map. The map is "
    "fitted to one unlabelled recording of the reflector at the middle distance, measured and simulated; the reflector "
    "itself is not scored. Intervals are bootstraps over objects.",
)

BEFORE, AFTER = "before calibration", "after calibration"
FILLED = "filled plastic"
ALIGNED_DB = 3.0  # a factor of two in power
LEAST_DB = 1.0  # smallest difference of brightness that counts as an effect


def run(config: Config, store: Store, progress: Progress) -> Result:
    return draws.scored(config, store, progress, lambda campaign: score(config, campaign, progress))


def score(config: Config, source: RecordingSource, progress: Progress) -> Result:
    """Build rows of the calibration offset, of each material's error before and after calibration, and of filled bottles minus other
    materials.
    """
    room = sorted({case.room for case in source.cases("measured", motion=MOTION)})[0]
    cases = dict(zip(COMPARED, readings.shared_cases(source, MOTION, room), strict=True))
    progress.say(f"{len(cases['measured'])} measured and {len(cases['twin'])} simulated revolutions in {room}")
    measured, twin = (readings.vectors(source, domain, cases[domain], FEATURES) for domain in COMPARED)
    theirs, ours = (
        readings.vectors(source, domain, [transfer.calibration_case(source, domain, room, MOTION)], FEATURES).samples.values
        for domain in COMPARED
    )
    keys = tuple(sorted((*measured.keys, *twin.keys)))
    column = measured.samples.names.index(BRIGHTNESS)
    mapped = fit_map(ours[:1, [column]], theirs[:, [column]])  # one revolution determines an offset but no slope
    levels = {BEFORE: twin.samples.values[:, column], AFTER: mapped.apply(twin.samples.values[:, [column]])[:, 0]}
    scored = measured.samples.without(REFLECTOR)
    errors = {when: _errors(scored, twin.samples, level, column) for when, level in levels.items()}
    rows = RecognitionRows(config)
    offset = float(mapped.offset[0])
    case = {"materials": "reflector", "feature": BRIGHTNESS, "method": "the map"}
    rows.add(case, "measured - simulated (dB)", exact(offset, 1), keys, count=1)
    metrics = _add_materials(rows, scored, errors, keys)
    _add_filled(rows, scored, errors[AFTER], keys)
    figures = {"corner_reflector_calibration": lambda: _figure(scored, errors)}
    return Result("corner_reflector_calibration", rows, figures, metrics, sorted(keys))


def _add_materials(rows: RecognitionRows, scored: Samples, errors: Mapping[str, NDArray], keys: tuple[str, ...]) -> dict[str, float]:
    """Add rows of the echo power error of each material. Returns the echo power errors after calibration in dB, as metrics of the run."""
    kinds, metrics = _kinds(scored), {}
    for when, error in errors.items():
        for kind in np.unique(kinds):
            recordings = scored.take(kinds == kind)
            found = clustered(error[kinds == kind], recordings.object, rows.config.profile.resamples, rows.config.seed)
            claim = Claim()
            if when == AFTER:
                metrics[f"residual_db_{kind.replace(' ', '_')}"] = found.value
                claim = Claim(f"{kind} stays too dim in simulation", "too dim", bound=LEAST_DB, null=0.0)
                if kind == "metal":
                    claim = within("metal aligns within 3 dB", -ALIGNED_DB, ALIGNED_DB, paper="aligned")
            case = {"materials": str(kind), "feature": BRIGHTNESS, "method": when}
            rows.add(case, "measured - simulated (dB)", found, keys, claim, count_sources(recordings))
    return metrics


def _add_filled(rows: RecognitionRows, scored: Samples, error: NDArray, keys: tuple[str, ...]) -> None:
    """Add rows of the echo power error of filled bottles minus the error of each other material."""
    kinds = _kinds(scored)
    filled = kinds == FILLED
    for kind in np.unique(kinds[~filled]) if filled.any() else ():
        others = kinds == kind
        first, second = (_object_means(error[chosen], scored.object[chosen]) for chosen in (filled, others))
        found = difference(first, second, rows.config.profile.resamples, rows.config.seed)
        case = {"materials": f"{FILLED} - {kind}", "feature": BRIGHTNESS, "method": AFTER}
        claim = Claim(f"filled bottles are dimmer than {kind}", "filled bottles most", bound=LEAST_DB, null=0.0)
        rows.add(case, "difference of the remaining errors (dB)", found, keys, claim, count_sources(scored.take(filled | others)))


def _object_means(values: NDArray, objects: NDArray[np.str_]) -> NDArray[np.float64]:
    """Return the mean of the values (N,) of each object, (objects,)."""
    return np.array([values[objects == one].mean() for one in np.unique(objects)])


def _kinds(recordings: Samples) -> NDArray[np.str_]:
    """Return the material class of each recording (N,): metal, ceramic, plastic or filled plastic."""

    def kind(name: str) -> str:
        return FILLED if catalogue()[name].contents and MATERIAL[name] == "plastic" else MATERIAL[name]

    return np.array([kind(label) for label in recordings.label])


def _errors(measured: Samples, twin: Samples, level: NDArray, column: int) -> NDArray:
    """Return the measured value minus the simulated value at equal object and distance, for each measured recording (N,)."""
    simulated = {(label, stratum): one for label, stratum, one in zip(twin.label, twin.stratum, level, strict=True)}
    return measured.values[:, column] - np.array([simulated[pair] for pair in zip(measured.label, measured.stratum, strict=True)])


def _figure(measured: Samples, errors: Mapping[str, NDArray]) -> Figure:
    """Draw the echo power error of every recording before and after calibration, by object. The objects on the horizontal axis are
    sorted by material.
    """
    drawing, panels = figure(1, 2, width_in=PAGE_WIDTH_IN, height_in=2.9, sharey=False)
    kinds = dict(zip(measured.label, _kinds(measured), strict=True))
    objects = sorted(kinds, key=lambda name: (kinds[name], name))
    colours = dict(zip(sorted(set(kinds.values())), PALETTE, strict=False))
    for panel, (when, error) in zip(panels, errors.items(), strict=True):
        labels = dict.fromkeys(kinds.values())  # one legend entry per material
        for place, name in enumerate(objects):
            points = error[measured.label == name]
            label = kinds[name] if kinds[name] in labels else None
            labels.pop(kinds[name], None)
            panel.scatter(np.full(len(points), place), points, s=10, color=colours[kinds[name]], alpha=0.7, label=label)
        panel.axhline(0, color="0.5", lw=0.8)
        panel.set_xticks(range(len(objects)), [name.replace("_", " ") for name in objects], rotation=60, ha="right", fontsize=6)
        panel.set(title=when, ylabel="measured - simulated brightness (dB)")
    panels[1].legend(loc="best")
    return drawing
