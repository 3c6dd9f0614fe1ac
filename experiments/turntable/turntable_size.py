"""Size: does the echo power rise with the height of cans that are otherwise equal?

The six cans have heights from 76 to 157 mm. The echo power should rise by 6 dB per doubling, as long as the wavefront is flat across the
can. Paper, disentangled fidelity, size: the measured echo power shows no consistent trend, because the array has no aperture in elevation;
the simulation includes the whole mesh and may show a trend.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from experiments import statistics
from experiments.campaign.cases import COMPARED, LABELS
from experiments.campaign.frame import Frame
from experiments.cells import Cell, per, rank_correlation, using
from experiments.drawing import DOMAIN_STYLES, Figure, figure, legend_above, panels_width_in
from experiments.framed import framed
from experiments.statistics import Estimate
from experiments.turntable.turntable_shape import is_can
from experiments.verdicts import EQUAL, NONE, Claim
from radartwin.config.config import Config
from radartwin.errors import ConfigError
from radartwin.features.families import BRIGHTNESS
from radartwin.runs.experiment import Table
from radartwin.scene.objects.catalogue import catalogue

TABLE = Table(
    name="turntable_size",
    title="Size",
    caption="Six cans of one diameter and several heights on a turntable: rank correlation of brightness with height (Spearman, "
    "exact p) and slope of brightness over height (Theil-Sen). Intervals are 95 % bootstraps over cans.",
)

MOTIONS = ("turntable",)
# a rank correlation of 0.5 explains a quarter of the variance of the ranks
NO_TREND = Claim("no consistent trend with the height of a can", "none", direction=EQUAL, null=0.0, margin=0.5)


def cells(config: Config, frame: Frame) -> Iterator[Cell]:
    """Declare the order and the slope of the brightness over the heights of the cans, at each distance and over all distances."""
    cans = frame[frame.object.map(is_can)]
    if (count := cans.object.nunique()) < 3:
        raise ConfigError(f"turntable_size needs three cans or more, but the campaign has {count}; add cans to profile.campaign")
    for distance, here in [*cans.groupby("distance_m"), (None, cans)]:
        for domain, claim in zip(COMPARED, (NO_TREND if distance is None else NONE, NONE), strict=True):
            of = here[here.domain == domain]
            if of.object.nunique() > 2:
                case = {"case": "cans", "distance_m": distance, "of": LABELS[domain]}
                order = rank_correlation(heights_m, per(BRIGHTNESS))
                yield Cell(case, "order by height", of, order, claim)
                yield Cell(case, "per doubling of height (dB)", of, using(slope_db, heights_m, per(BRIGHTNESS)))


def heights_m(rows: Frame) -> NDArray[np.float64]:
    return np.array([catalogue()[name].size_m[2] for name in rows.object.unique()])


def slope_db(height_m: NDArray, brightness_db: NDArray, resamples: int, seed: int) -> Estimate:
    """Estimate the Theil-Sen slope of brightness in decibels per doubling of the height, with a bootstrap over objects.

    The Theil-Sen slope is the median of the slopes over all pairs of objects.

    >>> slope_db(np.array([1.0, 2, 4, 8]), np.array([0.0, 6, 12, 18]), 100, 0).value
    6.0
    """
    octaves = np.log2(height_m)

    def slope(index: NDArray) -> float:
        x, y = octaves[index], brightness_db[index]
        first, second = np.triu_indices(len(x), 1)
        apart = x[first] != x[second]
        return float(np.median((y[second] - y[first])[apart] / (x[second] - x[first])[apart])) if apart.any() else np.nan

    rng = np.random.default_rng(seed)
    drawn = [slope(rng.integers(len(octaves), size=len(octaves))) for _ in range(resamples)]
    return statistics.resampled(slope(np.arange(len(octaves))), drawn, len(octaves))


def _figure(frame: Frame) -> Figure:
    """Draw brightness in decibels against height, with one panel per distance."""
    cans = frame[frame.object.map(is_can)].groupby("distance_m")
    where = [(distance, here) for distance, here in cans if here.object.nunique() > 2]
    drawing, panels = figure(1, len(where), width_in=panels_width_in(len(where)), height_in=2.5, sharey=True, squeeze=False)
    for panel, (distance, here) in zip(panels[0], where, strict=True):
        height = 1000 * heights_m(here)
        order = np.argsort(height)
        for domain, (colour, marker) in DOMAIN_STYLES.items():
            values = per(BRIGHTNESS, domain)(here).to_numpy()
            panel.plot(height[order], values[order], marker + "-", color=colour, ms=4, lw=0.8, label=LABELS[domain])
        panel.set(title=f"{distance:g} m", xlabel="height of the can (mm)")
        panel.grid(axis="y", color="0.9", lw=0.5)
    panels[0, 0].set_ylabel("brightness at 1 m (dB)")
    legend_above(drawing, panels[0, 0], 2)
    return drawing


METRICS = {"order_by_height_{of}": {"metric": "order by height", "distance_m": None}}
run, recordings, score = framed(TABLE, {"motions": MOTIONS}, cells, {TABLE.name: _figure}, METRICS, named=True)
