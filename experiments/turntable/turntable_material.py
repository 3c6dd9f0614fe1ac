"""Material: at matched distance and similar size, does brightness follow the class of material, and by how much in either domain?

Compared is the target-gate brightness with R^4 removed, in decibels, at each distance: mean of the cans (metal) less mean of the bottles
(plastic), and the mug (ceramic). The corner reflector is metal but no object of similar size: it sends everything back and is left out.
Paper, disentangled fidelity, material: metal over plastic in both domains; the simulation exaggerates the contrast and under-predicts the
ceramic mug. Under-predicted is judged with the gain between the domains taken out, as the difference to the cans.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from experiments import statistics
from experiments.claims import NONE, Claim, row
from experiments.recognition.readings import Campaign
from experiments.statistics import Estimate
from experiments.turntable import rotations
from experiments.turntable.rotations import DOMAINS, LABELS, MEASURED, TWIN, Turns, panels_width_in
from radartwin.config.config import Config
from radartwin.errors import ConfigError
from radartwin.io.progress import Progress
from radartwin.plotting.style import PALETTE, figure
from radartwin.runs.experiment import Result, Table
from radartwin.scene.objects.catalogue import catalogue
from radartwin.store.products import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE = Table(
    name="turntable_material",
    title="Material",
    caption="Objects of similar size on a turntable: brightness of the target gate, corrected for the range law, by material class at "
    "each distance, measured and simulated. The corner reflector is left out. Intervals are 95 % bootstraps over objects.",
)

BRIGHTNESS = "brightness_db"
APART = "corner_reflector"
CLASSES = ("metal", "ceramic", "plastic")

OVER = Claim("metal is brighter than plastic", "above 0", above=0.0, least=3)  # of two objects, one each, there is no interval
EXAGGERATES = Claim("the simulation exaggerates the contrast of metal and plastic", "above 0", above=0.0, least=3)
DIM_MUG = Claim("the simulation under-predicts the ceramic mug", "below 0", below=0.0, least=3)


def run(config: Config, store: Store, progress: Progress) -> Result:
    from experiments.campaign.campaign import Campaign as Recorded

    return score(config, Recorded(config, store, progress), progress)


def score(config: Config, campaign: Campaign, progress: Progress) -> Result:
    """Rows per distance: levels of the classes, contrasts in each domain, and their difference.

    Raises:
        ConfigError: the campaign has no distance with objects of two classes.
    """
    turns = rotations.read(campaign, progress)
    if not compared(turns[MEASURED]):
        raise ConfigError("turntable_material needs objects of two classes of material at one distance, and the campaign has none")
    rows: list[dict[str, Any]] = []
    for distance in compared(turns[MEASURED]):
        rows += _rows(config, turns, distance)
    metrics = {
        f"metal_less_plastic_{r['of']}_{r['distance_m']:g}m_db": r["value"] for r in rows if r["metric"] == "metal less plastic (dB)"
    }
    figures = {"turntable_brightness": lambda: _figure(turns)}
    return Result(TABLE.name, rows, figures, metrics, rotations.keys(*(some for d in DOMAINS for some in turns[d].values())))


def _rows(config: Config, turns: dict[str, Turns], distance: float) -> list[dict[str, Any]]:
    rows = []
    classes = by_class(turns[MEASURED], distance)
    pairs: dict[tuple[str, str], Estimate] = {}
    for domain in DOMAINS:
        values = {name: _objects(turns[domain], classes[name], distance) for name in classes}
        for name in classes:
            case = {"case": name, "distance_m": distance, "of": LABELS[domain]}
            found = statistics.mean(values[name], config.profile.resamples, config.seed)
            rows.append(row(config, case, "brightness at 1 m (dB)", found, _keys(turns[domain], classes[name], distance)))
        for bright, dim, claim in (("metal", "plastic", OVER), ("metal", "ceramic", NONE)):
            if bright in values and dim in values:
                found = pairs[domain, dim] = difference(values[bright], values[dim], config.profile.resamples, config.seed)
                case = {"case": "all of similar size", "distance_m": distance, "of": LABELS[domain]}
                source = _keys(turns[domain], [*classes[bright], *classes[dim]], distance)
                rows.append(row(config, case, f"{bright} less {dim} (dB)", found, source, claim))
    for dim, metric, claim in (("plastic", "excess of contrast (dB)", EXAGGERATES), ("ceramic", "mug, relative to the cans (dB)", DIM_MUG)):
        if dim in classes and "metal" in classes:
            gaps = {name: _gaps(turns, classes[name], distance) for name in ("metal", dim)}
            sign = 1 if dim == "plastic" else -1
            found = difference(sign * gaps["metal"], sign * gaps[dim], config.profile.resamples, config.seed)
            case = {"case": "all of similar size", "distance_m": distance, "of": "simulated less measured"}
            source = [key for domain in DOMAINS for key in _keys(turns[domain], [*classes["metal"], *classes[dim]], distance)]
            rows.append(row(config, case, metric, found, source, claim))
    return rows


def compared(turns: Turns) -> list[float]:
    """Distances at which there are objects of two classes or more. The reflector alone is at others too."""
    return [distance for distance in rotations.distances_m(turns) if len(by_class(turns, distance)) > 1]


def by_class(turns: Turns, distance: float) -> dict[str, list[str]]:
    """Objects of similar size by class of material, those that are there at this distance."""
    known = catalogue()
    here = [name for name, at in turns if at == distance and name != APART]
    classes = {kind: [name for name in here if known[name].material_class == kind] for kind in CLASSES}
    return {kind: names for kind, names in classes.items() if names}


def difference(first: NDArray, second: NDArray, resamples: int, seed: int) -> Estimate:
    """Difference of the means of two groups of objects, with a bootstrap over the objects of both.

    >>> found = difference(np.array([3.0, 5.0]), np.array([1.0]), 100, 0)
    >>> found.value, found.low >= 2, found.high <= 4
    (3.0, True, True)
    """
    value = float(np.mean(first) - np.mean(second))
    rng = np.random.default_rng(seed)
    drawn = [some[rng.integers(len(some), size=(resamples, len(some)))].mean(axis=1) for some in (first, second)]
    low, high = np.quantile(drawn[0] - drawn[1], [0.025, 0.975])
    return Estimate(value, min(float(low), value), max(float(high), value), len(first) + len(second))


def _objects(turns: Turns, names: list[str], distance: float) -> NDArray[np.float64]:
    """One brightness per object, in decibels: the mean over its repetitions."""
    return rotations.object_means(turns, BRIGHTNESS, names, distance)


def _gaps(turns: dict[str, Turns], names: list[str], distance: float) -> NDArray[np.float64]:
    """Simulated less measured brightness of each object."""
    return _objects(turns[TWIN], names, distance) - _objects(turns[MEASURED], names, distance)


def _keys(turns: Turns, names: list[str], distance: float) -> list[str]:
    return rotations.keys(rotations.chosen(turns, names, distance))


def _figure(turns: dict[str, Turns]) -> Figure:
    """Brightness of every object by class, one panel per distance, measured beside simulated."""
    where = compared(turns[MEASURED])
    drawing, panels = figure(1, len(where), width_in=panels_width_in(len(where)), height_in=2.8, sharey=True, squeeze=False)
    for panel, distance in zip(panels[0], where, strict=True):
        classes = {"reflector": [APART] if (APART, distance) in turns[MEASURED] else [], **by_class(turns[MEASURED], distance)}
        for i, names in enumerate(classes.values()):
            for domain, colour, marker, shift in ((MEASURED, PALETTE[0], "o", -0.15), (TWIN, PALETTE[1], "s", 0.15)):
                if names:
                    values = _objects(turns[domain], names, distance)
                    label = LABELS[domain] if i == 1 else None
                    panel.plot(np.full(len(names), i + shift), values, marker, color=colour, ms=4, alpha=0.8, label=label)
                    panel.plot([i + shift - 0.12, i + shift + 0.12], [values.mean()] * 2, color=colour, lw=2)
        panel.set_xticks(range(len(classes)), list(classes), rotation=30, ha="right")
        panel.set(title=f"{distance:g} m")
        panel.grid(axis="y", color="0.9", lw=0.5)
    panels[0, 0].set_ylabel("brightness at 1 m (dB)")
    drawing.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return drawing
