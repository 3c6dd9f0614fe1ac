"""Compare the material labels of surfaces with the true materials: accuracy of the MINC categories, and reflection error in decibels.

The error of a material label is the electromagnetic distance in dB (`radartwin.materials.distance`) between the labelled and the true
material. Each surface is weighted by its area. The confidence intervals are Wilson's intervals (E. Wilson, JASA 22 (1927) 209). The
effective number of surfaces in these intervals is (sum of areas)^2 / sum of areas^2, because the label of a 15 m2 wall is one decision and
not fifteen.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from radartwin.errors import SceneError
from radartwin.label.material_sources import true_surfaces
from radartwin.label.surface_match import place_of
from radartwin.materials.distance import diffuse_distance_db, distance_db
from radartwin.materials.minc import CATEGORIES
from radartwin.scene.scene import Scene

if TYPE_CHECKING:
    import pandas as pd

CLOSE_DB = 1.0  # the radar cannot observe a smaller reflection error, because the speckle of a rough wall is 0.6 to 1.1 dB
Z95 = 1.959963984540054


@dataclass(frozen=True)
class Judged:
    """A surface with a material label and its true MINC category.

    Attributes:
        area_m2: area of the surface.
        label: MINC category of the surface's material label; None if the labelled material has no category.
        truth: true MINC category of the surface.
        distance_db: electromagnetic distance in dB between the labelled material and the true material.
        diffuse_db: distance in dB between the diffuse echoes of the labelled and the true roughness.
        stand_in: True if the labelled material is a substitute material, or if its layers are uncertain.
    """

    area_m2: float
    label: str | None
    truth: str
    distance_db: float
    diffuse_db: float
    stand_in: bool

    @property
    def right(self) -> bool:
        """Whether the labelled category equals the true category and, for the category `other`, the distance is at most CLOSE_DB."""
        return self.label == self.truth and (self.truth != "other" or self.distance_db <= CLOSE_DB)


def judge(labelled: Scene, truth: Scene) -> list[Judged]:
    """Compare each surface of a labelled scene with the surface of the true scene that most of its area lies on.

    Both scenes must have the same coordinate frame. Surfaces that lie on no true surface are left out.

    Raises:
        SceneError: a true surface has no MINC category.
    """
    distance = functools.cache(distance_db)
    out = []
    for surface, true in zip(labelled, true_surfaces(labelled, truth), strict=True):
        if true is None:
            continue
        category = true.provenance.get("minc")
        if category is None:
            raise SceneError(f"the true surface '{true.name}' has no MINC category; give it as minc in its provenance")
        area = place_of(surface.mesh).area_m2
        error_db = distance(surface.material, true.material)
        facts = surface.provenance
        diffuse_db = diffuse_distance_db(surface.roughness_m, true.roughness_m)
        out.append(Judged(area, facts.get("minc"), str(category), error_db, diffuse_db, bool(facts.get("stand_in"))))
    return out


def accuracy_table(judged: Sequence[Judged]) -> pd.DataFrame:
    """Make a table of the label accuracy: one row per true MINC category in MINC's order, and a last row "all".

    Every share and mean in the table is weighted by surface area. The columns are:
    - minc: the true MINC category; n: number of surfaces; area_m2: total area of these surfaces.
    - accuracy: share of surfaces with the right category; low and high: ends of the share's 95 % interval.
    - close: share of surfaces with a distance of at most CLOSE_DB; close_low and close_high: ends of the share's 95 % interval.
    - mean_db, worst_db: mean and largest electromagnetic distance between labelled and true material.
    - diffuse_db: mean distance between the diffuse echoes of labelled and true roughness.
    - guessed: share of surfaces whose label is a substitute material or has uncertain layers.
    """
    import pandas as pd

    groups = {category: [j for j in judged if j.truth == category] for category in CATEGORIES}
    rows = [_row(name, group) for name, group in groups.items() if group]
    return pd.DataFrame([*rows, _row("all", judged)])


def wilson(weights: np.ndarray, hits: np.ndarray) -> tuple[float, float, float]:
    """Return (share, low, high): the weighted share of hits and the ends of its Wilson 95 % interval, with the effective number of
    surfaces.

    >>> [round(value, 3) for value in wilson(np.ones(10), np.arange(10) < 8)]
    [0.8, 0.49, 0.943]
    """
    share = float(weights[hits].sum() / weights.sum())
    n = float(weights.sum() ** 2 / (weights**2).sum())
    z = Z95
    middle = (share + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * float(np.sqrt(share * (1 - share) / n + z**2 / (4 * n**2)))
    return share, min(share, max(0.0, middle - half)), max(share, min(1.0, middle + half))


def _row(name: str, group: Sequence[Judged]) -> dict[str, object]:
    areas = np.array([j.area_m2 for j in group])
    distances = np.array([j.distance_db for j in group])
    accuracy, low, high = wilson(areas, np.array([j.right for j in group]))
    close, close_low, close_high = wilson(areas, distances <= CLOSE_DB)
    return {
        "minc": name,
        "n": len(group),
        "area_m2": float(areas.sum()),
        "accuracy": accuracy,
        "low": low,
        "high": high,
        "close": close,
        "close_low": close_low,
        "close_high": close_high,
        "mean_db": float(np.average(distances, weights=areas)),
        "worst_db": float(distances.max()),
        "diffuse_db": float(np.average([j.diffuse_db for j in group], weights=areas)),
        "guessed": float(np.average([j.stand_in for j in group], weights=areas)),
    }
