"""Object, distance, room: which of them makes simulated features agree with measured ones, and which makes them differ?

Two of the three are held and the third varies. Object slice: at one room and distance, rank correlation over objects. Distance slice: of
one object in one room, over distances. Room slice: of one object at one distance, whether the change from one room to the other has the
same sign. Pooled over distances against matched: the same feature's correlation over all objects and distances at once, and its mean over
distances; the highest over features is what the paper gives. And what the disagreement itself depends on: the gap between simulated and
measured feature, each standardised over all recordings of its domain, divided among the main effects of object, distance and room, in
shares of its variance, mean over features. Paper: disentangling object, distance and environment: pooled about 0.8, matched about 0.5; the
environment factor dominates.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.claims import NONE, Claim, row
from experiments.recognition.readings import Campaign
from experiments.rover import drive_features
from experiments.rover.drive_features import Drives, Place
from experiments.rover.figures import slices_figure
from experiments.statistics import Estimate
from experiments.turntable.rotations import DOMAINS, MEASURED, TWIN
from radartwin.config.config import Config
from radartwin.io.progress import Progress
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

TABLE = Table(
    name="rover_disentangle",
    title="Object, distance, room",
    caption="Agreement of simulated and measured features while two of object, distance and room are held and the third varies, "
    "correlations pooled over distances and at matched distances, and the division of the variance of the disagreement among "
    "the three. Intervals are bootstraps over objects.",
)

FACTORS = ("object", "distance", "room")
SHARE = "share of the disagreement, per degree of freedom"
INFLATED = Claim("pooling distances inflates the correlation of features", "0.8 to 0.5", above=0.0)
ROOM_FIRST = Claim("the room decides the disagreement more than object or distance", "environment dominates", above=0.0)
Cells = Mapping[tuple[str, str, float], NDArray[np.floating]]  # (2, features), measured and simulated, by object, room and distance


def run(config: Config, store: Store, progress: Progress) -> Result:
    from experiments.campaign.campaign import Campaign as Recorded

    return score(config, Recorded(config, store, progress), progress)


def score(config: Config, campaign: Campaign, progress: Progress) -> Result:
    """Rows per motion; slices that the campaign has not are left out."""
    drives = drive_features.read(campaign, progress)
    rows: list[dict[str, Any]] = []
    slices: dict[tuple[str, str], NDArray] = {}
    for motion in drive_features.MOTIONS:
        where = [place for place in drive_features.places(drives[MEASURED]) if place[1] == motion]
        if where:
            cells = standardised(drives, where)
            rows += _rows(config, motion, cells, drives, where, slices)
    metrics = {f"{r['metric'].replace(' ', '_')}_{r['motion']}": r["value"] for r in rows if r["case"] in ("pooled", "matched")}
    every = [one.key for domain in DOMAINS for some in drives[domain].values() for one in some]
    figures = {"rover_slices": lambda: slices_figure(slices)} if slices else {}
    return Result(TABLE.name, rows, figures, metrics, every)


def standardised(drives: dict[str, Drives], where: list[Place]) -> Cells:
    """Features of every object and place of one motion, each with zero mean and unit spread over its domain; constant ones are left out."""
    names = {place: drive_features.objects(drives[MEASURED], place) for place in where}
    labels = [(name, place[0], place[2]) for place in where for name in names[place]]
    both = [
        np.concatenate([drive_features.matrix(drives[domain], names[place], place)[1] for place in where]) for domain in (MEASURED, TWIN)
    ]
    varies = np.all([values.std(axis=0) > 1e-9 * (1 + np.abs(values).max(axis=0)) for values in both], axis=0)
    scaled = np.stack([(values[:, varies] - values[:, varies].mean(axis=0)) / values[:, varies].std(axis=0) for values in both], axis=1)
    return dict(zip(labels, scaled, strict=True))


def _rows(
    config: Config, motion: str, cells: Cells, drives: dict[str, Drives], where: list[Place], slices: dict[tuple[str, str], NDArray]
) -> list[dict[str, Any]]:
    source = drive_features.keys(drives, {name for name, _, _ in cells}, where)
    seeds = config.profile.resamples, config.seed
    rows = []

    def add(case: str, metric: str, found: Estimate, claim: Claim = NONE) -> None:
        rows.append(row(config, {"motion": motion, "case": case}, metric, found, source, claim))

    for factor in ("object", "distance"):
        values = slice_correlations(cells, factor)
        if len(values):
            slices[motion, factor] = values
            add(
                f"{factor} slice",
                "correlation of features, mean",
                _bootstrap(cells, lambda some, f=factor: _mean(slice_correlations(some, f)), *seeds),
            )
    signs = room_signs(cells)
    if len(signs):
        slices[motion, "room"] = 2 * signs - 1
        add("room slice", "share of features that change alike", _bootstrap(cells, lambda some: _mean(room_signs(some)), *seeds))
    if len({distance for _, _, distance in cells}) > 1:
        for case, figure in (("pooled", pooled), ("matched", matched)):
            add(case, "highest correlation of a feature", _bootstrap(cells, lambda some, f=figure: float(np.nanmax(f(some))), *seeds))
        add("pooled less matched", "highest correlation of a feature", _bootstrap(cells, _inflation, *seeds), INFLATED)
    shares = effects(cells)
    for factor, value in shares.items():
        found = _bootstrap(cells, lambda some, f=factor: effects(some).get(f, float("nan")), *seeds)
        add(factor, SHARE, Estimate(value, min(found.low, value), max(found.high, value), found.n))
    if len(shares) == len(FACTORS):
        add("room less the larger of the others", SHARE, _bootstrap(cells, _room_lead, *seeds), ROOM_FIRST)
    return rows


def slice_correlations(cells: Cells, factor: str) -> NDArray[np.floating]:
    """Rank correlation of every feature in every slice along a factor with three levels or more."""
    position = {"object": 0, "room": 1, "distance": 2}[factor]
    slices: dict[tuple, list[NDArray]] = {}
    for label, values in cells.items():
        slices.setdefault(tuple(part for i, part in enumerate(label) if i != position), []).append(values)
    found = [_ranked(np.stack(some)) for some in slices.values() if len(some) >= 3]
    values = np.concatenate(found) if found else np.zeros(0)
    return values[np.isfinite(values)]


def room_signs(cells: Cells) -> NDArray[np.floating]:
    """Of every object and distance in two rooms: per feature, 1 where it changes the same way in both domains, else 0."""
    found = []
    rooms = sorted({room for _, room, _ in cells})
    for name, room, distance in cells:
        for other in rooms:
            if room < other and (name, other, distance) in cells:
                change = cells[name, other, distance] - cells[name, room, distance]
                changes = np.abs(change).min(axis=0) > 1e-9
                found.append((np.sign(change[0]) == np.sign(change[1]))[changes])
    return np.concatenate(found).astype(float) if found else np.zeros(0)


def pooled(cells: Cells) -> NDArray[np.floating]:
    """(features,): correlation over all objects and distances of a room, mean over rooms."""
    return _mean_over(cells, lambda label: label[1])


def matched(cells: Cells) -> NDArray[np.floating]:
    """(features,): correlation over the objects of a room and distance, mean over both."""
    return _mean_over(cells, lambda label: label[1:])


def effects(cells: Cells) -> dict[str, float]:
    """Share of the variance of simulated less measured that the mean at each level of a factor explains, per degree of freedom (levels less
    one: more levels explain more of anything), mean over features.

    Factors with one level explain nothing and are left out.
    """
    labels = list(cells)
    gap = np.stack([values[1] - values[0] for values in cells.values()])
    gap = gap - gap.mean(axis=0)
    total = np.sum(gap**2, axis=0)
    found = {}
    for factor, position in (("object", 0), ("distance", 2), ("room", 1)):
        levels = sorted({label[position] for label in labels})
        if len(levels) < 2:
            continue
        explained = np.zeros(gap.shape[1])
        for level in levels:
            rows = [label[position] == level for label in labels]
            explained += np.sum(rows) * gap[rows].mean(axis=0) ** 2
        varies = total > 1e-12
        found[factor] = float(np.mean(explained[varies] / total[varies])) / (len(levels) - 1) if varies.any() else 0.0
    return found


def _inflation(cells: Cells) -> float:
    return float(np.nanmax(pooled(cells)) - np.nanmax(matched(cells)))


def _mean(values: NDArray) -> float:
    return float(values.mean()) if len(values) else float("nan")


def _room_lead(cells: Cells) -> float:
    shares = effects(cells)
    return shares["room"] - max(shares["object"], shares["distance"])


def _mean_over(cells: Cells, group: Callable[[tuple[str, str, float]], Any]) -> NDArray[np.floating]:
    groups: dict[Any, list[NDArray]] = {}
    for label, values in cells.items():
        groups.setdefault(group(label), []).append(values)
    found = np.stack([_ranked(np.stack(some)) for some in groups.values()])
    there = np.isfinite(found)
    return np.where(there.any(axis=0), np.where(there, found, 0).sum(axis=0) / np.maximum(there.sum(axis=0), 1), np.nan)


def _ranked(values: NDArray) -> NDArray[np.floating]:
    """(features,): Spearman of (n, 2, features) over n; NaN where a feature does not vary."""
    from scipy.stats import rankdata

    first, second = (rankdata(values[:, side], axis=0) for side in (0, 1))
    first, second = first - first.mean(axis=0), second - second.mean(axis=0)
    norm = np.sqrt(np.sum(first**2, axis=0) * np.sum(second**2, axis=0))
    return np.divide(np.sum(first * second, axis=0), norm, out=np.full(len(norm), np.nan), where=norm > 0)


def _bootstrap(cells: Cells, figure: Callable[[Cells], float], resamples: int, seed: int) -> Estimate:
    """A figure with an interval over objects drawn anew, each with all its places."""
    names = sorted({name for name, _, _ in cells})
    value = figure(cells)
    rng = np.random.default_rng(seed)
    drawn = []
    for _ in range(min(resamples, 300)):  # each draw ranks every feature anew
        chosen = rng.choice(len(names), len(names))
        again = {
            (f"{number}", room, distance): values
            for number, i in enumerate(chosen)
            for (name, room, distance), values in cells.items()
            if name == names[i]
        }
        drawn.append(figure(again))
    usable = np.array(drawn)[np.isfinite(drawn)]
    low, high = np.quantile(usable, [0.025, 0.975]) if len(usable) else (value, value)
    return Estimate(value, min(float(low), value), max(float(high), value), len(names))
