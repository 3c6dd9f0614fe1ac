"""Material: by how many decibels does the echo power of objects of similar size depend on their material, measured and simulated?

The classes are cans (metal), bottles (plastic) and the mug (ceramic), without the corner reflector, a retroreflector.
Paper, disentangled fidelity, material: metal is brighter than plastic in both; the simulation exaggerates this contrast and gives too low a
level for the mug. The mug is judged relative to the cans, so that a gain difference between measurement and simulation has no effect.
"""

from collections.abc import Iterator

import numpy as np

from experiments.campaign.cases import COMPARED, LABELS, MEASURED, REFLECTOR, TWIN
from experiments.campaign.frame import Frame
from experiments.cells import Cell, difference, gap, mean, per
from experiments.drawing import DOMAIN_STYLES, Figure, figure, legend_above, panels_width_in
from experiments.framed import framed
from experiments.verdicts import BELOW, NONE, Claim
from radartwin.config.config import Config
from radartwin.errors import ConfigError
from radartwin.features.families import BRIGHTNESS
from radartwin.runs.experiment import Table

TABLE = Table(
    name="turntable_material",
    title="Material",
    caption="Objects of similar size on a turntable: brightness of the target gate, corrected for the range law, by material class at "
    "each distance, measured and simulated. The corner reflector is left out. Rows with an entry in the column 'twin' belong to a "
    "simulation that knows only the surface of vessels (paper profile). Intervals are 95 % bootstraps over objects.",
)

MOTIONS = ("turntable",)
CLASSES = ("metal", "ceramic", "plastic")
LEAST_DB = 1.0  # smallest difference of brightness that counts as an effect

OVER = Claim("metal is brighter than plastic", "above 0", bound=LEAST_DB, null=0.0)
EXAGGERATES = Claim("the simulation exaggerates the contrast of metal and plastic", "above 0", bound=LEAST_DB, null=0.0)
DIM_MUG = Claim("the simulation under-predicts the ceramic mug", "below 0", bound=-LEAST_DB, direction=BELOW, null=0.0)
EXCESS = {  # class: gap between the domains whose contrast between metal and the class is the estimate, metric and claim
    "plastic": (gap(BRIGHTNESS, TWIN, MEASURED), "excess of contrast (dB)", EXAGGERATES),
    "ceramic": (gap(BRIGHTNESS, MEASURED, TWIN), "mug, relative to the cans (dB)", DIM_MUG),
}
ALL = "all of similar size"


def cells(config: Config, frame: Frame) -> Iterator[Cell]:
    """Declare the brightness of each class, the contrasts of metal to the other classes, and the errors of these contrasts."""
    if not similar(frame):
        raise ConfigError("turntable_material needs objects of two material classes at one distance; add objects to profile.campaign")
    brightness = per(BRIGHTNESS)
    for distance, here in similar(frame):
        classes = [kind for kind in CLASSES if kind in set(here.material_class)]
        pairs = {kind: ("metal", kind) for kind in EXCESS if {"metal", kind} <= set(classes)}
        for domain in COMPARED:
            at, of = {"distance_m": distance, "of": LABELS[domain]}, here[here.domain == domain]
            for kind in classes:
                yield Cell({"case": kind, **at}, "brightness at 1 m (dB)", of[of.material_class == kind], mean(brightness))
            for kind, pair in pairs.items():
                contrast, claim = difference(brightness, "material_class", *pair), OVER if kind == "plastic" else NONE
                yield Cell({"case": ALL, **at}, f"metal less {kind} (dB)", of[of.material_class.isin(pair)], contrast, claim)
        for kind, pair in pairs.items():
            error, metric, claim = EXCESS[kind]
            case, of = {"case": ALL, "distance_m": distance, "of": "simulated less measured"}, here[here.material_class.isin(pair)]
            yield Cell(case, metric, of, difference(error, "material_class", *pair), claim)


def similar(frame: Frame) -> list[tuple[float, Frame]]:
    """Return (distance in metres, recordings of objects of similar size) for the distances with objects of two material classes or more."""
    groups = frame[frame.object != REFLECTOR].groupby("distance_m")
    return [(distance, here) for distance, here in groups if here.material_class.nunique() > 1]


def _figure(frame: Frame) -> Figure:
    """Draw the measured and simulated brightness of every object by material class, with one panel per distance."""
    where = similar(frame)
    drawing, panels = figure(1, len(where), width_in=panels_width_in(len(where)), height_in=2.8, sharey=True, squeeze=False)
    for panel, (distance, here) in zip(panels[0], where, strict=True):
        reflector = frame[(frame.object == REFLECTOR) & (frame.distance_m == distance)]
        classes = {"reflector": reflector, **{kind: here[here.material_class == kind] for kind in CLASSES}}
        classes = {kind: of for kind, of in classes.items() if len(of) or kind == "reflector"}
        for i, of in enumerate(classes.values()):
            for (domain, (colour, marker)), shift in zip(DOMAIN_STYLES.items(), (-0.15, 0.15), strict=True):
                if len(of):
                    values = per(BRIGHTNESS, domain)(of)
                    label = LABELS[domain] if i == 1 else None
                    panel.plot(np.full(len(values), i + shift), values, marker, color=colour, ms=4, alpha=0.8, label=label)
                    panel.plot([i + shift - 0.12, i + shift + 0.12], [values.mean()] * 2, color=colour, lw=2)
        panel.set_xticks(range(len(classes)), list(classes), rotation=30, ha="right")
        panel.set(title=f"{distance:g} m")
        panel.grid(axis="y", color="0.9", lw=0.5)
    panels[0, 0].set_ylabel("brightness at 1 m (dB)")
    legend_above(drawing, panels[0, 0], 2)
    return drawing


METRICS = {"metal_less_plastic_{of}_{distance_m:g}m_db": {"metric": "metal less plastic (dB)", "twin": None}}
run, recordings, score = framed(TABLE, {"motions": MOTIONS, "unknown": True}, cells, {"turntable_brightness": _figure}, METRICS)
