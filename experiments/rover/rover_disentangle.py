"""Object, distance, room: which of these factors makes simulated features agree with measured features, and which makes them differ?

A slice fixes two of the three factors and varies the third factor. An object slice gives the rank correlation between measured and
simulated features over objects in one room at one distance. A distance slice gives the rank correlation between measured and simulated
features over distances for one object in one room. A room slice gives, for one object at one distance, the share of features that change in
the same direction between two rooms in measurement and simulation. The pooled correlation between measured and simulated features uses all
objects and distances of a room together. The matched correlation between measured and simulated features is computed over the objects at
each distance and then averaged. As in the paper, the table gives the pooled and the matched correlation of the feature with the highest
value. The disagreement is the simulated minus the measured feature, each standardised over all recordings of its domain. The variance of
the disagreement is divided among the main effects of object, distance and room, as a mean over features. Paper, disentangling object,
distance and environment: pooled correlation about 0.8, matched correlation about 0.5; the environment factor dominates.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments import draws, statistics
from experiments.campaign.cases import COMPARED, MEASURED, ROVER
from experiments.campaign.source import RecordingSource
from experiments.claims import NONE, Claim, RowList
from experiments.rover import drive_features
from experiments.rover.drive_features import MOST_DRAWN, Drives, Place
from experiments.rover.figures import slices_figure
from experiments.statistics import Estimate
from radartwin.config.config import Config
from radartwin.io.progress import Progress
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

TABLE = Table(
    name="rover_disentangle",
    title="Object, distance, room",
    caption="Agreement of simulated and measured features while two of the factors object, distance and room are fixed and the "
    "third varies; correlations pooled over distances and at matched distances; and the variance of the disagreement "
    "(simulated minus measured), divided among the three factors. Intervals are bootstraps over objects with at most 300 resamples, "
    "widened for few objects.",
)

SHARE = "share of the disagreement, per degree of freedom"
INFLATED = Claim("pooling distances inflates the correlation of features", "0.8 to 0.5", bound=0.05, null=0.0)
ROOM_FIRST = Claim("the room decides the disagreement more than object or distance", "environment dominates", bound=0.05, null=0.0)
Label = tuple[str, str, float]  # object, room, distance
POSITIONS = {"object": 0, "distance": 2, "room": 1}  # index of each factor in a Label
Cells = Mapping[Label, NDArray[np.floating]]  # values (2, features): measured, simulated


def run(config: Config, store: Store, progress: Progress) -> Result:
    return draws.scored(config, store, progress, lambda campaign: score(config, campaign, progress), rover=True)


def score(config: Config, source: RecordingSource, progress: Progress) -> Result:
    """Build the table rows for each motion. Slices for which the campaign has no recordings are left out."""
    drives = drive_features.read(source, progress)
    rows = RowList(config)
    slices: dict[tuple[str, str], NDArray] = {}
    for motion in ROVER:
        where = [place for place in drive_features.places(drives[MEASURED]) if place[1] == motion]
        if where:
            cells = standardised(drives, where)
            keys = drive_features.keys(drives, {name for name, _, _ in cells}, where)
            _add_slices(rows, motion, cells, keys, slices)
            _add_effects(rows, motion, cells, keys)
    metrics = {f"{r['metric'].replace(' ', '_')}_{r['motion']}": r["value"] for r in rows if r["case"] in ("pooled", "matched")}
    figures = {"rover_slices": lambda: slices_figure(slices)} if slices else {}
    return Result("rover_disentangle", rows, figures, metrics, drive_features.keys(drives))


def standardised(drives: dict[str, Drives], where: list[Place]) -> Cells:
    """Scale the features of one motion to zero mean and unit standard deviation within each domain. Constant features are left out."""
    names = {place: drive_features.objects(drives[MEASURED], place) for place in where}
    labels = [(name, place[0], place[2]) for place in where for name in names[place]]
    both = [np.concatenate([drive_features.matrix(drives[domain], names[place], place)[1] for place in where]) for domain in COMPARED]
    varies = np.all([values.std(axis=0) > 1e-9 * (1 + np.abs(values).max(axis=0)) for values in both], axis=0)
    scaled = np.stack([(values[:, varies] - values[:, varies].mean(axis=0)) / values[:, varies].std(axis=0) for values in both], axis=1)
    return dict(zip(labels, scaled, strict=True))


def _add_slices(rows: RowList, motion: str, cells: Cells, keys: list[str], slices: dict[tuple[str, str], NDArray]) -> None:
    """Add the rows of the object, distance and room slices, which the module docstring defines. Also add the rows of the pooled and matched
    correlations. The dictionary `slices` collects the values that the figure shows.
    """
    seeds = rows.config.profile.resamples, rows.config.seed

    def add(case: str, metric: str, statistic: Callable[[Cells], float], limits: tuple[float, float], claim: Claim = NONE) -> None:
        rows.add({"motion": motion, "case": case}, metric, bootstrap(cells, statistic, *seeds, limits), keys, claim)

    for factor in ("object", "distance"):
        values = slice_correlations(cells, factor)
        if len(values):
            slices[motion, factor] = values
            add(
                f"{factor} slice",
                "correlation of features, mean",
                lambda some, f=factor: _mean(slice_correlations(some, f)),
                statistics.SIGNED,
            )
    signs = room_signs(cells)
    if len(signs):
        slices[motion, "room"] = 2 * signs - 1
        add("room slice", "share of features that change alike", lambda some: _mean(room_signs(some)), statistics.SHARE)
    if len({distance for _, _, distance in cells}) > 1:
        for case, correlations in (("pooled", pooled), ("matched", matched)):
            add(case, "highest correlation of a feature", lambda some, f=correlations: float(np.nanmax(f(some))), statistics.SIGNED)
        add("pooled less matched", "highest correlation of a feature", inflation, (-2.0, 2.0), INFLATED)


def _add_effects(rows: RowList, motion: str, cells: Cells, keys: list[str]) -> None:
    seeds = rows.config.profile.resamples, rows.config.seed
    shares = effects(cells)
    for factor in shares:
        found = bootstrap(cells, lambda some, f=factor: effects(some).get(f, float("nan")), *seeds, statistics.SHARE)
        rows.add({"motion": motion, "case": factor}, SHARE, found, keys)
    if len(shares) == len(POSITIONS):
        lead = bootstrap(cells, _room_lead, *seeds, statistics.SIGNED)
        rows.add({"motion": motion, "case": "room less the larger of the others"}, SHARE, lead, keys, ROOM_FIRST)


def slice_correlations(cells: Cells, factor: str) -> NDArray[np.floating]:
    """Compute the rank correlation of every feature in every slice along a factor. Slices with fewer than three values of the factor
    are left out.
    """
    slices = _grouped(cells, lambda label: tuple(part for i, part in enumerate(label) if i != POSITIONS[factor]))
    found = [_rank_correlations(some) for some in slices if len(some) >= 3]
    values = np.concatenate(found) if found else np.zeros(0)
    return values[np.isfinite(values)]


def room_signs(cells: Cells) -> NDArray[np.floating]:
    """Return 1 or 0 for each object, distance, pair of rooms and feature, in one array.

    The entry is 1 if the feature is higher in the same one of the two rooms in measurement and simulation. Unchanged features are left out.
    """
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
    """Return the rank correlation between measured and simulated values of each feature (features,). The correlation is computed over all
    objects and distances of a room, and then averaged over rooms.
    """
    return _mean_correlation(cells, lambda label: label[1])


def matched(cells: Cells) -> NDArray[np.floating]:
    """Return the rank correlation between measured and simulated values of each feature (features,). The correlation is computed over the
    objects at each room and distance, and then averaged.
    """
    return _mean_correlation(cells, lambda label: label[1:])


def effects(cells: Cells) -> dict[str, float]:
    """Compute the main effect of each factor on the disagreement (simulated minus measured), as a mean over features.

    The effect of a factor is the share of the variance that the means at the factor's levels explain, per degree of freedom (number of
    levels minus one). The division is needed because a factor with more levels explains more variance even if it has no effect. Factors
    with only one level (such as a single room) are left out.
    """
    labels = list(cells)
    gap = np.stack([values[1] - values[0] for values in cells.values()])
    gap = gap - gap.mean(axis=0)
    total = np.sum(gap**2, axis=0)
    varies = total > 1e-12
    found = {}
    for factor, position in POSITIONS.items():
        levels = sorted({label[position] for label in labels})
        if len(levels) < 2:
            continue
        explained = np.zeros(gap.shape[1])
        for level in levels:
            rows = [label[position] == level for label in labels]
            explained += np.sum(rows) * gap[rows].mean(axis=0) ** 2
        found[factor] = float(np.mean(explained[varies] / total[varies])) / (len(levels) - 1) if varies.any() else 0.0
    return found


def inflation(cells: Cells) -> float:
    """Return the highest pooled correlation of any feature minus the highest matched correlation of any feature."""
    return float(np.nanmax(pooled(cells)) - np.nanmax(matched(cells)))


def _room_lead(cells: Cells) -> float:
    shares = effects(cells)
    return shares["room"] - max(shares["object"], shares["distance"])


def _mean(values: NDArray) -> float:
    return float(values.mean()) if len(values) else float("nan")


def _grouped(cells: Cells, group: Callable[[Label], Any]) -> list[NDArray]:
    """Return for each group the values (n, 2, features) of its n cells, measured and simulated."""
    groups: dict[Any, list[NDArray]] = {}
    for label, values in cells.items():
        groups.setdefault(group(label), []).append(values)
    return [np.stack(some) for some in groups.values()]


def _mean_correlation(cells: Cells, group: Callable[[Label], Any]) -> NDArray[np.floating]:
    """Return the rank correlation of measured and simulated values, as a mean over groups, for each feature (features,). Groups in which a
    feature is constant do not count; NaN if no group is left.
    """
    found = np.stack([_rank_correlations(some) for some in _grouped(cells, group)])
    finite = np.isfinite(found)
    return np.where(finite.any(axis=0), np.where(finite, found, 0).sum(axis=0) / np.maximum(finite.sum(axis=0), 1), np.nan)


def _rank_correlations(values: NDArray) -> NDArray[np.floating]:
    """Return the Spearman correlations (features,) of measured and simulated values (n, 2, features); NaN for a constant feature."""
    from scipy.stats import rankdata

    first, second = (rankdata(values[:, side], axis=0) for side in (0, 1))
    first, second = first - first.mean(axis=0), second - second.mean(axis=0)
    norm = np.sqrt(np.sum(first**2, axis=0) * np.sum(second**2, axis=0))
    return np.divide(np.sum(first * second, axis=0), norm, out=np.full(len(norm), np.nan), where=norm > 0)


def bootstrap(
    cells: Cells, statistic: Callable[[Cells], float], resamples: int, seed: int, limits: tuple[float, float] = statistics.ANY
) -> Estimate:
    """Compute a statistic, and its interval by a bootstrap over objects. An object that the bootstrap draws contributes its values in all
    rooms and at all distances.

    At most MOST_DRAWN resamples are drawn. The interval is widened for few objects (`statistics.widening`) and clipped to `limits`, the
    smallest and largest value that the statistic can have.
    """
    names = sorted({name for name, _, _ in cells})
    rng = np.random.default_rng(seed)
    drawn = []
    for _ in range(min(resamples, MOST_DRAWN)):
        chosen = rng.choice(len(names), len(names))
        again = {
            (str(number), room, distance): values
            for number, i in enumerate(chosen)
            for (name, room, distance), values in cells.items()
            if name == names[i]
        }
        drawn.append(statistic(again))
    value = statistic(cells)
    return statistics.resampled(value, np.clip(statistics.widened(np.array(drawn), value, len(names)), *limits), len(names), limits)
