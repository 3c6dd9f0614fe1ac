"""Material: by how many decibels does the echo power of objects of similar size depend on their material, measured and simulated?

The material classes are cans (metal), bottles (plastic) and the mug (ceramic). The corner reflector is left out, because it is a
retroreflector and not of similar size. Paper, disentangled fidelity, material: metal is brighter than plastic in measurement and
simulation; the simulation exaggerates this contrast and gives too low a level for the ceramic mug. The level of the mug is judged relative
to the cans, so that a gain difference between measurement and simulation has no effect.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from experiments import draws, statistics
from experiments.campaign.cases import COMPARED, LABELS, MEASURED, REFLECTOR, TWIN
from experiments.campaign.schedule import RecordingTask
from experiments.campaign.source import RecordingSource, cases_of
from experiments.claims import BELOW, NONE, Claim, RowList
from experiments.drawing import DOMAIN_STYLES, legend_above, panels_width_in
from experiments.turntable import rotations
from experiments.turntable.rotations import Turns
from radartwin.config.config import Config
from radartwin.errors import ConfigError
from radartwin.features.sets import BRIGHTNESS
from radartwin.io.progress import Progress
from radartwin.plotting.style import figure
from radartwin.runs.experiment import Result, Table
from radartwin.scene.objects.catalogue import catalogue
from radartwin.store.products import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE = Table(
    name="turntable_material",
    title="Material",
    caption="Objects of similar size on a turntable: brightness of the target gate, corrected for the range law, by material class at "
    "each distance, measured and simulated. The corner reflector is left out. Rows with an entry in the column 'twin' belong to a "
    "simulation that knows only the surface of vessels (paper profile). Intervals are 95 % bootstraps over objects.",
)

CLASSES = ("metal", "ceramic", "plastic")
LEAST_DB = 1.0  # smallest difference of brightness that counts as an effect

OVER = Claim("metal is brighter than plastic", "above 0", bound=LEAST_DB, null=0.0)
EXAGGERATES = Claim("the simulation exaggerates the contrast of metal and plastic", "above 0", bound=LEAST_DB, null=0.0)
DIM_MUG = Claim("the simulation under-predicts the ceramic mug", "below 0", bound=-LEAST_DB, direction=BELOW, null=0.0)


def recordings(config: Config, store: Store, progress: Progress) -> dict[str, RecordingTask]:
    own = [config, *draws.unknown_contents(config)]
    return draws.recordings(own, lambda campaign: cases_of(campaign, ["turntable"]), store, progress)


def run(config: Config, store: Store, progress: Progress) -> Result:
    return draws.beside_unknown(config, lambda own: draws.scored(own, store, progress, lambda campaign: score(own, campaign, progress)))


def score(config: Config, source: RecordingSource, progress: Progress) -> Result:
    """Build the table rows for each distance.

    The rows hold the brightness of each material class, the contrasts between classes in measurement and simulation, and the differences
    between simulated and measured contrast.

    Raises:
        ConfigError: the campaign has no distance with objects of two material classes.
    """
    turns = rotations.read(source, progress)
    where = compared_distances(turns[MEASURED])
    if not where:
        raise ConfigError("turntable_material needs objects of two material classes at one distance; add objects to profile.campaign")
    rows = RowList(config)
    for distance in where:
        _add_rows(rows, turns, distance)
    metrics = {
        f"metal_less_plastic_{r['of']}_{r['distance_m']:g}m_db": r["value"] for r in rows if r["metric"] == "metal less plastic (dB)"
    }
    figures = {"turntable_brightness": lambda: _figure(turns)}
    return Result("turntable_material", rows, figures, metrics, rotations.keys_of_both(turns))


def _add_rows(rows: RowList, turns: dict[str, Turns], distance: float) -> None:
    classes = by_class(turns[MEASURED], distance)
    seeds = rows.config.profile.resamples, rows.config.seed
    values = {
        domain: {name: rotations.object_means(turns[domain], BRIGHTNESS, objects, distance) for name, objects in classes.items()}
        for domain in COMPARED
    }
    for domain in COMPARED:
        for name, objects in classes.items():
            case = {"case": name, "distance_m": distance, "of": LABELS[domain]}
            rows.add_mean(case, "brightness at 1 m (dB)", values[domain][name], rotations.keys(turns[domain], objects, distance))
        for dim, claim in (("plastic", OVER), ("ceramic", NONE)):
            if "metal" in classes and dim in classes:
                found = statistics.difference(values[domain]["metal"], values[domain][dim], *seeds)
                case = {"case": "all of similar size", "distance_m": distance, "of": LABELS[domain]}
                source = rotations.keys(turns[domain], [*classes["metal"], *classes[dim]], distance)
                rows.add(case, f"metal less {dim} (dB)", found, source, claim)
    for dim, metric, sign, claim in (
        ("plastic", "excess of contrast (dB)", 1, EXAGGERATES),
        ("ceramic", "mug, relative to the cans (dB)", -1, DIM_MUG),
    ):
        if dim in classes and "metal" in classes:
            gaps = {name: values[TWIN][name] - values[MEASURED][name] for name in ("metal", dim)}
            found = statistics.difference(sign * gaps["metal"], sign * gaps[dim], *seeds)
            case = {"case": "all of similar size", "distance_m": distance, "of": "simulated less measured"}
            rows.add(case, metric, found, rotations.keys_of_both(turns, [*classes["metal"], *classes[dim]], distance), claim)


def compared_distances(turns: Turns) -> list[float]:
    """Return the distances in metres that have objects of two material classes or more."""
    return [distance for distance in rotations.distances_m(turns) if len(by_class(turns, distance)) > 1]


def by_class(turns: Turns, distance: float) -> dict[str, list[str]]:
    """Return {material class: objects of similar size} at a distance. Classes without objects are left out."""
    known = catalogue()
    here = [name for name, at in turns if at == distance and name != REFLECTOR]
    classes = {kind: [name for name in here if known[name].material_class == kind] for kind in CLASSES}
    return {kind: names for kind, names in classes.items() if names}


def _figure(turns: dict[str, Turns]) -> Figure:
    """Draw the measured and simulated brightness of every object by material class, with one panel per distance."""
    where = compared_distances(turns[MEASURED])
    drawing, panels = figure(1, len(where), width_in=panels_width_in(len(where)), height_in=2.8, sharey=True, squeeze=False)
    for panel, distance in zip(panels[0], where, strict=True):
        reflector = [REFLECTOR] if (REFLECTOR, distance) in turns[MEASURED] else []
        classes = {"reflector": reflector, **by_class(turns[MEASURED], distance)}
        for i, names in enumerate(classes.values()):
            for (domain, (colour, marker)), shift in zip(DOMAIN_STYLES.items(), (-0.15, 0.15), strict=True):
                if names:
                    values = rotations.object_means(turns[domain], BRIGHTNESS, names, distance)
                    label = LABELS[domain] if i == 1 else None
                    panel.plot(np.full(len(names), i + shift), values, marker, color=colour, ms=4, alpha=0.8, label=label)
                    panel.plot([i + shift - 0.12, i + shift + 0.12], [values.mean()] * 2, color=colour, lw=2)
        panel.set_xticks(range(len(classes)), list(classes), rotation=30, ha="right")
        panel.set(title=f"{distance:g} m")
        panel.grid(axis="y", color="0.9", lw=0.5)
    panels[0, 0].set_ylabel("brightness at 1 m (dB)")
    legend_above(drawing, panels[0, 0], 2)
    return drawing
