"""How good labels are, against the truth beneath them: per category, and per decibel of reflection.

Every surface of the labelled scene counts with its area for the true surface that most of it lies on. A label is right if its MINC category
is the true one (`other` only if the material agrees); what a wrong one costs is the electromagnetic distance
(`radartwin.materials.distance`) between its material and the true material. Intervals are Wilson's (E. Wilson, JASA 22 (1927) 209) at the
effective number of surfaces, (sum of areas)^2 / sum of areas^2, since one wall of 15 m2 is one decision and not fifteen.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from radartwin.errors import SceneError
from radartwin.label.place import place_of
from radartwin.label.sources import true_surfaces
from radartwin.materials import Layered
from radartwin.materials.distance import distance_db
from radartwin.materials.minc import CATEGORIES
from radartwin.scene.scene import Scene

if TYPE_CHECKING:
    import pandas as pd

CLOSE_DB = 1.0  # labels nearer than this are the same for the radar: the speckle of a rough wall is 0.6 to 1.1 dB
Z95 = 1.959963984540054


@dataclass(frozen=True)
class Judged:
    """A labelled surface beside the true one.

    Attributes:
        label, truth: MINC categories; label is None where the material came without one.
        distance_db: between the two materials.
        stand_in: the label's material stands for something it is not, or its build-up is a guess.
    """

    name: str
    area_m2: float
    label: str | None
    truth: str
    distance_db: float
    confidence: float | None
    stand_in: bool = False

    @property
    def right(self) -> bool:
        """Whether the category is the true one; of `other`, which is none, whether the material is."""
        return self.label == self.truth and (self.truth != "other" or self.distance_db <= CLOSE_DB)


def judge(labelled: Scene, truth: Scene) -> list[Judged]:
    """Each surface of a labelled scene that lies on a true one; both in one frame.

    Raises:
        SceneError: a true surface without a MINC category.
    """
    known: dict[tuple[object, object], float] = {}

    def distance(first: str | Layered, second: str | Layered) -> float:
        if (first, second) not in known:
            known[first, second] = distance_db(first, second)
        return known[first, second]

    out = []
    for surface, true in zip(labelled, true_surfaces(labelled, truth), strict=True):
        if true is None:
            continue
        category = true.provenance.get("minc")
        if category is None:
            raise SceneError(f"the true surface '{true.name}' has no MINC category in its provenance; labels cannot be scored against it")
        area = place_of(surface.mesh).area_m2
        cost = distance(surface.material, true.material)
        told = surface.provenance
        guessed = bool(told.get("stand_in"))
        out.append(Judged(surface.name, area, told.get("minc"), str(category), cost, told.get("confidence"), guessed))
    return out


def accuracy_table(judged: Sequence[Judged]) -> pd.DataFrame:
    """One row per true category that occurs, in MINC's order, and "all" last.

    Columns: minc, n (surfaces), area_m2, accuracy with low and high (95 %), all by area; close, the share by area within CLOSE_DB of the
    truth, with close_low and close_high; mean_db, the mean distance by area; worst_db; guessed, the share by area of stand-ins and
    uncertain build-ups.
    """
    import pandas as pd

    groups = {category: [j for j in judged if j.truth == category] for category in CATEGORIES}
    rows = [_row(name, group) for name, group in groups.items() if group]
    return pd.DataFrame([*rows, _row("all", judged)] if judged else [], columns=list(_row("", [])))


def confusion_table(judged: Sequence[Judged]) -> pd.DataFrame:
    """Area in square metres by true category (rows) and label (columns, "none" for a material without category)."""
    import pandas as pd

    truths = [c for c in CATEGORIES if any(j.truth == c for j in judged)]
    labels = [c for c in (*CATEGORIES, "none") if any((j.label or "none") == c or j.truth == c for j in judged)]
    table = pd.DataFrame(0.0, index=pd.Index(truths, name="truth"), columns=pd.Index(labels, name="label"))
    for j in judged:
        table.loc[j.truth, j.label or "none"] += j.area_m2  # type: ignore[operator]
    return table


def distance_table(judged: Sequence[Judged], edges_db: Sequence[float] = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, np.inf)) -> pd.DataFrame:
    """Share of the area by electromagnetic distance from the truth: from_db, to_db, n, area_m2, share, low, high, and those with the right
    category among them (right).
    """
    import pandas as pd

    areas = np.array([j.area_m2 for j in judged])
    distances = np.array([j.distance_db for j in judged])
    right = np.array([j.right for j in judged], bool)
    rows = []
    for low, high in itertools.pairwise(edges_db):
        inside = (distances >= low) & (distances < high)
        share, least, most = wilson(areas, inside)
        named = float(areas[inside & right].sum() / areas[inside].sum()) if inside.any() else float("nan")
        rows.append((low, high, int(inside.sum()), float(areas[inside].sum()), share, least, most, named))
    return pd.DataFrame(rows, columns=["from_db", "to_db", "n", "area_m2", "share", "low", "high", "right"])


def wilson(weights: np.ndarray, hits: np.ndarray, z: float = Z95) -> tuple[float, float, float]:
    """Weighted share of hits and Wilson's interval at the effective number of draws; nan where there are none.

    >>> [round(value, 3) for value in wilson(np.ones(10), np.arange(10) < 8)]
    [0.8, 0.49, 0.943]
    """
    weights = np.asarray(weights, float)
    if weights.size == 0 or weights.sum() <= 0:
        return float("nan"), float("nan"), float("nan")
    share = float(weights[np.asarray(hits, bool)].sum() / weights.sum())
    n = float(weights.sum() ** 2 / (weights**2).sum())
    middle = (share + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * float(np.sqrt(share * (1 - share) / n + z**2 / (4 * n**2)))
    return share, min(share, max(0.0, middle - half)), max(share, min(1.0, middle + half))


def _row(name: str, group: Sequence[Judged]) -> dict[str, object]:
    areas = np.array([j.area_m2 for j in group])
    distances = np.array([j.distance_db for j in group])
    accuracy, low, high = wilson(areas, np.array([j.right for j in group], bool))
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
        "mean_db": float(np.average(distances, weights=areas)) if len(group) else float("nan"),
        "worst_db": float(distances.max()) if len(group) else float("nan"),
        "guessed": float(np.average([j.stand_in for j in group], weights=areas)) if len(group) else float("nan"),
    }
