"""Compare labels with the true materials: compute the accuracy of the categories, and the error of the reflection in decibels.

The error of a label is the electromagnetic distance (`radartwin.materials.distance`) between its material and the true material. The area
of a surface is its weight. The confidence intervals are Wilson's (E. Wilson, JASA 22 (1927) 209), with (sum of areas)^2 / sum of areas^2 as
the effective number of surfaces, because one wall of 15 m2 is one decision and not fifteen.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from radartwin.errors import SceneError
from radartwin.label.place import place_of
from radartwin.label.sources import true_surfaces
from radartwin.materials.distance import distance_db
from radartwin.materials.minc import CATEGORIES
from radartwin.scene.scene import Scene

if TYPE_CHECKING:
    import pandas as pd

CLOSE_DB = 1.0  # the radar cannot observe a smaller error, because the speckle of a rough wall is 0.6 to 1.1 dB
Z95 = 1.959963984540054


@dataclass(frozen=True)
class Judged:
    """A labelled surface with its true category.

    Attributes:
        label: MINC category of the label; None if the material has no category.
        distance_db: electromagnetic distance between the label's material and the true material.
        stand_in: whether the material of the label is a substitute material, or its layers are uncertain.
    """

    area_m2: float
    label: str | None
    truth: str
    distance_db: float
    stand_in: bool

    @property
    def right(self) -> bool:
        """Whether the category is the true category and, for `other`, whether the material also agrees."""
        return self.label == self.truth and (self.truth != "other" or self.distance_db <= CLOSE_DB)


def judge(labelled: Scene, truth: Scene) -> list[Judged]:
    """Compare each surface of a labelled scene with the true surface that it lies on, if any, in the same coordinate frame.

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
        out.append(Judged(area, facts.get("minc"), str(category), error_db, bool(facts.get("stand_in"))))
    return out


def accuracy_table(judged: Sequence[Judged]) -> pd.DataFrame:
    """Make a table of the label accuracy: one row per true category in MINC's order, and a last row "all".

    Shares and means are weighted by area. Columns:
    - minc: the category; n: number of surfaces; area_m2: their area.
    - accuracy: share of right labels, with the 95 % interval low to high.
    - close: share of labels with a distance of at most CLOSE_DB, with the 95 % interval close_low to close_high.
    - mean_db, worst_db: mean and largest electromagnetic distance.
    - guessed: share of labels with a substitute material or uncertain layers.
    """
    import pandas as pd

    groups = {category: [j for j in judged if j.truth == category] for category in CATEGORIES}
    rows = [_row(name, group) for name, group in groups.items() if group]
    return pd.DataFrame([*rows, _row("all", judged)])


def wilson(weights: np.ndarray, hits: np.ndarray) -> tuple[float, float, float]:
    """Return the weighted share of hits, and the ends of Wilson's 95 % interval with the effective number of draws.

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
        "guessed": float(np.average([j.stand_in for j in group], weights=areas)),
    }
