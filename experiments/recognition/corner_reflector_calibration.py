"""Calibration by a corner reflector: the echo power error of each material, before and after calibration from simulated to measured level.

The calibrated feature is the brightness of a revolution (radartwin/features/envelope.py). A single reflector gives a single level, so the
calibration is an offset in decibels. A straight line fitted to the levels of single frames would have a slope of 0.59 at 1.5 m, because
echoes of the room dominate at angles where the reflector's echo is weak. Paper (corner-reflector radiometric calibration): after
calibration, metal objects agree with the measurement, dielectric objects stay too dim, and liquid-filled containers are the dimmest.
"""

from collections.abc import Iterator

import numpy as np

from experiments.campaign.cases import COMPARED, REFLECTOR
from experiments.campaign.frame import Frame, balanced, by_revolution
from experiments.cells import Cell, paired, using
from experiments.drawing import PAGE_WIDTH_IN, PALETTE, Figure, figure, legend_above
from experiments.framed import framed
from experiments.recognition.readings import MOTION, reflector
from experiments.statistics import clustered, difference, exact
from experiments.verdicts import NONE, Claim, within
from radartwin.config.config import Config
from radartwin.features.families import BRIGHTNESS
from radartwin.runs.experiment import Table
from radartwin.scene.objects.catalogue import catalogue

TABLE = Table(
    name="corner_reflector_calibration",
    title="Calibrated by one corner reflector",
    caption="The brightness difference between measured and simulated revolutions that remains after an affine map. The map is "
    "fitted to one unlabelled recording of the reflector at the middle distance, measured and simulated; the reflector "
    "itself is not scored. Intervals are bootstraps over objects.",
)

MOTIONS = (MOTION,)
BEFORE, AFTER = "before calibration", "after calibration"
FILLED = "filled plastic"
ALIGNED_DB = 3.0  # a factor of two in power
ERROR = "measured - simulated (dB)"
LEAST_DB = 1.0  # smallest difference of brightness that counts as an effect


def cells(config: Config, frame: Frame) -> Iterator[Cell]:
    """Declare the cells of one draw."""
    of, scored, offset = balanced(frame), errors(frame), exact(offset_db(frame), 1)
    case = {"materials": "reflector", "feature": BRIGHTNESS, "method": "the map"}
    yield Cell(case, ERROR, of, offset, count=1)
    for when in (BEFORE, AFTER):
        for kind, group in scored.groupby("kind"):
            claim = Claim(f"{kind} stays too dim in simulation", "too dim", bound=LEAST_DB, null=0.0)
            if kind == "metal":
                claim = within("metal aligns within 3 dB", -ALIGNED_DB, ALIGNED_DB, paper="aligned")
            estimate = using(clustered, group[when], group.object.to_numpy(str))
            case, count = {"materials": kind, "feature": BRIGHTNESS, "method": when}, group.key.nunique()
            yield Cell(case, ERROR, of, estimate, claim if when == AFTER else NONE, count)
    objects = scored.groupby(["kind", "object"])[AFTER].mean()
    kinds = list(objects.index.unique("kind"))
    for kind in [kind for kind in kinds if kind != FILLED and FILLED in kinds]:
        case = {"materials": f"{FILLED} - {kind}", "feature": BRIGHTNESS, "method": AFTER}
        claim = Claim(f"filled bottles are dimmer than {kind}", "filled bottles most", bound=LEAST_DB, null=0.0)
        count = scored.key[scored.kind.isin([FILLED, kind])].nunique()
        yield Cell(case, "difference of the remaining errors (dB)", of, using(difference, objects[FILLED], objects[kind]), claim, count)


def offset_db(frame: Frame) -> float:
    """Return the measured less the simulated brightness of the reflector at its middle distance, from one recording of each domain."""
    here = reflector(frame)
    measured, twin = (by_revolution(here[here.domain == domain])[BRIGHTNESS] for domain in COMPARED)
    return float(measured.mean() - twin.iloc[0])  # one revolution determines an offset but no slope


def errors(frame: Frame) -> Frame:
    """Return the measured less the simulated brightness (BEFORE, AFTER) and the `kind` of each revolution, without the reflector."""
    compared = balanced(frame)
    pairs = paired(by_revolution(compared[compared.object != REFLECTOR]))
    before = pairs[BRIGHTNESS] - pairs[f"{BRIGHTNESS}_twin"]
    filled = (pairs.material_class == "plastic") & pairs.object.map(lambda name: bool(catalogue()[name].contents))
    return pairs.assign(kind=pairs.material_class.mask(filled, FILLED), **{BEFORE: before, AFTER: before - offset_db(frame)})


def _figure(scored: Frame) -> Figure:
    """Draw the echo power error of every recording before and after calibration, by object, sorted by material."""
    drawing, panels = figure(1, 2, width_in=PAGE_WIDTH_IN, height_in=2.9, sharey=False)
    kinds = dict(zip(scored.object, scored.kind, strict=True))
    objects = sorted(kinds, key=lambda name: (kinds[name], name))
    colours = dict(zip(sorted(set(kinds.values())), PALETTE, strict=False))
    for panel, when in zip(panels, (BEFORE, AFTER), strict=True):
        labels = dict.fromkeys(kinds.values())  # one legend entry per material
        for place, name in enumerate(objects):
            points = scored[when][scored.object == name]
            label = kinds[name] if kinds[name] in labels else None
            labels.pop(kinds[name], None)
            panel.scatter(np.full(len(points), place), points, s=10, color=colours[kinds[name]], alpha=0.7, label=label)
        panel.axhline(0, color="0.5", lw=0.8)
        panel.set_xticks(range(len(objects)), [name.replace("_", " ") for name in objects], rotation=60, ha="right")
        panel.set(title=when, ylabel="measured - simulated brightness (dB)")
    legend_above(drawing, panels[0], 4)
    return drawing


FIGURES = {TABLE.name: lambda first: _figure(errors(first))}
METRICS = {"residual_db_{materials}": {"metric": ERROR, "method": AFTER}}
run, recordings, score = framed(TABLE, {"motions": MOTIONS}, cells, FIGURES, METRICS, named=True)
