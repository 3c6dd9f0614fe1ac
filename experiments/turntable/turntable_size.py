"""Size: does brightness rise with the height of cans that differ in nothing else?

The six cans have one diameter, one material and heights from 76 to 157 mm. Compared at each distance, and over all: rank correlation of
height and target-gate brightness, and the slope of brightness in decibels per doubling of the height (20 log10 of the height would be 6 dB:
a cylinder's cross-section grows with its height squared until the wavefront bends over it). Paper, disentangled fidelity, size: no
consistent trend in the measured domain, whose array has no aperture in elevation; the simulation sees the whole mesh and may show one.
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
from experiments.turntable.turntable_material import BRIGHTNESS
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
    name="turntable_size",
    title="Size",
    caption="Six cans of one diameter and several heights on a turntable: order of brightness by height (Spearman correlation, exact p) "
    "and slope of brightness over height (Theil-Sen). Intervals are 95 % bootstraps over cans.",
)

NO_TREND = Claim("no consistent trend with the height of a can", "none", contains=0.0)


def run(config: Config, store: Store, progress: Progress) -> Result:
    from experiments.campaign.campaign import Campaign as Recorded

    return score(config, Recorded(config, store, progress), progress)


def score(config: Config, campaign: Campaign, progress: Progress) -> Result:
    """Rows per distance and domain. Raises ConfigError where the campaign has fewer than three cans."""
    turns = rotations.read(campaign, progress)
    cans = [name for name in rotations.objects(turns[MEASURED]) if rotations.is_can(name)]
    if len(cans) < 3:
        raise ConfigError(f"turntable_size needs three cans or more, and the campaign has {len(cans)}")
    rows: list[dict[str, Any]] = []
    for distance in (*rotations.distances_m(turns[MEASURED]), None):
        for domain in DOMAINS:
            rows += _rows(config, turns[domain], domain, cans, distance)
    metrics = {f"order_by_height_{r['of']}": r["value"] for r in rows if r["metric"] == "order by height" and r["distance_m"] is None}
    figures = {"turntable_size": lambda: _figure(turns, cans)}
    return Result(TABLE.name, rows, figures, metrics, rotations.keys(*(rotations.chosen(turns[d], cans) for d in DOMAINS)))


def slope_db(height_m: NDArray, brightness_db: NDArray, resamples: int, seed: int) -> Estimate:
    """Decibels per doubling of the height, of the median line through all pairs (Theil and Sen), with a bootstrap over objects.

    >>> slope_db(np.array([1.0, 2, 4, 8]), np.array([0.0, 6, 12, 18]), 100, 0).value
    6.0
    """
    octaves = np.log2(height_m)

    def slope(chosen: NDArray) -> float:
        x, y = octaves[chosen], brightness_db[chosen]
        first, second = np.triu_indices(len(x), 1)
        apart = x[first] != x[second]
        return float(np.median((y[second] - y[first])[apart] / (x[second] - x[first])[apart])) if apart.any() else np.nan

    rng = np.random.default_rng(seed)
    value = slope(np.arange(len(octaves)))
    drawn = np.array([slope(rng.integers(len(octaves), size=len(octaves))) for _ in range(resamples)])
    low, high = np.nanquantile(drawn, [0.025, 0.975])
    return Estimate(value, min(float(low), value), max(float(high), value), len(octaves))


def _rows(config: Config, turns: Turns, domain: str, cans: list[str], distance: float | None) -> list[dict[str, Any]]:
    here = [name for name in cans if distance is None or (name, distance) in turns]
    if len(here) < 3:
        return []
    height_m = np.array([catalogue()[name].size_m[2] for name in here])
    brightness = rotations.object_means(turns, BRIGHTNESS, here, distance)
    case = {"case": "cans", "distance_m": distance, "of": LABELS[domain]}
    source = rotations.keys(rotations.chosen(turns, here, distance))
    order = statistics.spearman(height_m, brightness, config.profile.resamples, config.seed, alternative="two-sided")
    slope = slope_db(height_m, brightness, config.profile.resamples, config.seed)
    claim = NO_TREND if domain == MEASURED and distance is None else NONE
    return [row(config, case, "order by height", order, source, claim), row(config, case, "per doubling of height (dB)", slope, source)]


def _figure(turns: dict[str, Turns], cans: list[str]) -> Figure:
    """Brightness against height, one panel per distance."""
    where = [d for d in rotations.distances_m(turns[MEASURED]) if sum((name, d) in turns[MEASURED] for name in cans) > 2]
    drawing, panels = figure(1, len(where), width_in=panels_width_in(len(where)), height_in=2.5, sharey=True, squeeze=False)
    for panel, distance in zip(panels[0], where, strict=True):
        here = [name for name in cans if (name, distance) in turns[MEASURED]]
        height = np.array([1000 * catalogue()[name].size_m[2] for name in here])
        for domain, colour, marker in ((MEASURED, PALETTE[0], "o"), (TWIN, PALETTE[1], "s")):
            values = rotations.object_means(turns[domain], BRIGHTNESS, here, distance)
            order = np.argsort(height)
            panel.plot(height[order], values[order], marker + "-", color=colour, ms=4, lw=0.8, label=LABELS[domain])
        panel.set(title=f"{distance:g} m", xlabel="height of the can (mm)")
        panel.grid(axis="y", color="0.9", lw=0.5)
    panels[0, 0].set_ylabel("brightness at 1 m (dB)")
    drawing.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return drawing
