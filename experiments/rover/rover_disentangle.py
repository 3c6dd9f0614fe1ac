"""Object, distance, room: which of these factors makes simulated features agree with measured features, and which makes them differ?

A slice fixes two factors and varies the third: rank correlations over objects or distances, and the share of features that change in the
same direction between two rooms. The pooled correlation uses all objects and distances of a room, the matched one the objects at each
distance; as in the paper, the feature with the highest value counts. The variance of the disagreement (simulated minus measured,
standardised) is divided among the factors. Paper: pooled about 0.8, matched about 0.5; the environment dominates.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments import statistics
from experiments.campaign.cases import COMPARED, ROVER
from experiments.campaign.frame import Frame, features
from experiments.cells import Cell, using
from experiments.framed import Figures, framed
from experiments.rover.figures import slices_figure
from experiments.statistics import Estimate
from experiments.verdicts import NONE, Claim, Row
from radartwin.config.config import Config
from radartwin.runs.experiment import Table

TABLE = Table(
    name="rover_disentangle",
    title="Object, distance, room",
    caption="Agreement of simulated and measured features while two of the factors object, distance and room are fixed and the "
    "third varies; correlations pooled over distances and at matched distances; and the variance of the disagreement "
    "(simulated minus measured), divided among the three factors. Intervals are bootstraps over objects with at most 300 resamples, "
    "widened for few objects.",
)

MOTIONS = ROVER
MOST_DRAWN = 300  # largest number of bootstrap resamples, because every resample ranks every feature again
SHARE = "share of the disagreement, per degree of freedom"
INFLATED = Claim("pooling distances inflates the correlation of features", "0.8 to 0.5", bound=0.05, null=0.0)
ROOM_FIRST = Claim("the room decides the disagreement more than object or distance", "environment dominates", bound=0.05, null=0.0)
Label = tuple[str, str, float]  # object, room, distance
POSITIONS = {"object": 0, "distance": 2, "room": 1}  # index of each factor in a Label
Levels = Mapping[Label, NDArray[np.floating]]  # values (2, features): measured, simulated
Statistic = Callable[[Levels], float]
Limits = tuple[float, float]


def slices(frame: Frame) -> dict[tuple[str, str], NDArray]:
    """Return the values that the figure shows, by motion and factor."""
    by_slice = {}
    for motion, drives in frame.groupby("motion"):
        levels = standardised(drives)
        by_slice |= {(motion, factor): slice_correlations(levels, factor) for factor in ("object", "distance")}
        by_slice[motion, "room"] = 2 * room_signs(levels) - 1
    return {key: values for key, values in by_slice.items() if len(values)}


def standardised(drives: Frame) -> Levels:
    """Scale the features of one motion to zero mean and unit standard deviation within each domain. Constant features are left out."""
    names = features(drives)
    both = [drives[drives.domain == domain].groupby(["object", "room", "distance_m"], sort=False)[names].mean() for domain in COMPARED]
    varies = np.all([values.std(ddof=0) > 1e-9 * (1 + values.abs().max()) for values in both], axis=0)
    scaled = [((values - values.mean()) / values.std(ddof=0)).loc[both[0].index, varies].to_numpy() for values in both]
    return dict(zip(both[0].index, np.stack(scaled, axis=1), strict=True))


def cells(config: Config, frame: Frame) -> Iterator[Cell]:
    """Declare the cells of the slices, of the pooled and matched correlations, and of the effects of the factors, for each motion."""
    for motion, drives in frame.groupby("motion"):
        levels = standardised(drives)
        for case, metric, statistic, limits, claim in statistics_of(levels):
            yield Cell({"motion": motion, "case": case}, metric, drives, using(partial(bootstrap, levels, statistic, limits=limits)), claim)


def statistics_of(levels: Levels) -> Iterator[tuple[str, str, Statistic, Limits, Claim]]:
    """Return (case, metric, statistic, limits, claim) of those statistics that the drives of one motion have."""
    for factor in ("object", "distance"):
        if len(slice_correlations(levels, factor)):
            mean = partial(_mean_of, partial(slice_correlations, factor=factor))
            yield f"{factor} slice", "correlation of features, mean", mean, statistics.SIGNED, NONE
    if len(room_signs(levels)):
        yield "room slice", "share of features that change alike", partial(_mean_of, room_signs), statistics.SHARE, NONE
    if len({distance for _, _, distance in levels}) > 1:
        metric = "highest correlation of a feature"
        for case, of in (("pooled", pooled), ("matched", matched)):
            yield case, metric, lambda resampled, of=of: float(np.nanmax(of(resampled))), statistics.SIGNED, NONE
        yield "pooled less matched", metric, inflation, (-2.0, 2.0), INFLATED
    for factor in (shares := effects(levels)):
        yield factor, SHARE, lambda resampled, of=factor: effects(resampled).get(of, float("nan")), statistics.SHARE, NONE
    if len(shares) == len(POSITIONS):

        def lead(resampled: Levels) -> float:
            of = effects(resampled)
            return of["room"] - max(of["object"], of["distance"])

        yield "room less the larger of the others", SHARE, lead, statistics.SIGNED, ROOM_FIRST


def slice_correlations(levels: Levels, factor: str) -> NDArray[np.floating]:
    """Compute the rank correlation of every feature in every slice along a factor with three values or more."""
    slices = _grouped(levels, lambda label: tuple(part for i, part in enumerate(label) if i != POSITIONS[factor]))
    correlations = [_rank_correlations(members) for members in slices if len(members) >= 3]
    values = np.concatenate(correlations) if correlations else np.zeros(0)
    return values[np.isfinite(values)]


def room_signs(levels: Levels) -> NDArray[np.floating]:
    """Return for each object, distance, pair of rooms and changed feature whether it is higher in the same room in both domains."""
    signs = []
    rooms = sorted({room for _, room, _ in levels})
    for name, room, distance in levels:
        for other in rooms:
            if room < other and (name, other, distance) in levels:
                change = levels[name, other, distance] - levels[name, room, distance]
                changes = np.abs(change).min(axis=0) > 1e-9
                signs.append((np.sign(change[0]) == np.sign(change[1]))[changes])
    return np.concatenate(signs).astype(float) if signs else np.zeros(0)


def pooled(levels: Levels) -> NDArray[np.floating]:
    """Return the rank correlation of each feature (features,) over all objects and distances of a room, averaged over rooms."""
    return _mean_correlation(levels, lambda label: label[1])


def matched(levels: Levels) -> NDArray[np.floating]:
    """Return the rank correlation of each feature (features,) over the objects at each room and distance, averaged."""
    return _mean_correlation(levels, lambda label: label[1:])


def effects(levels: Levels) -> dict[str, float]:
    """Compute the effect of each factor on the disagreement: the share of the variance that the means of its levels explain, per degree of
    freedom (levels minus one), because more levels explain more. Factors with a single level are left out.
    """
    labels = list(levels)
    gap = np.stack([values[1] - values[0] for values in levels.values()])
    gap = gap - gap.mean(axis=0)
    total = np.sum(gap**2, axis=0)
    varies = total > 1e-12
    by_factor = {}
    for factor, position in POSITIONS.items():
        values = sorted({label[position] for label in labels})
        if len(values) < 2:
            continue
        explained = np.zeros(gap.shape[1])
        for level in values:
            rows = [label[position] == level for label in labels]
            explained += np.sum(rows) * gap[rows].mean(axis=0) ** 2
        by_factor[factor] = float(np.mean(explained[varies] / total[varies])) / (len(values) - 1) if varies.any() else 0.0
    return by_factor


def inflation(levels: Levels) -> float:
    """Return the highest pooled correlation of any feature minus the highest matched correlation of any feature."""
    return float(np.nanmax(pooled(levels)) - np.nanmax(matched(levels)))


def _mean_of(of: Callable[[Levels], NDArray], levels: Levels) -> float:
    values = of(levels)
    return float(values.mean()) if len(values) else float("nan")


def _grouped(levels: Levels, group: Callable[[Label], Any]) -> list[NDArray]:
    """Return for each group the values (n, 2, features) of its n labels, measured and simulated."""
    groups: dict[Any, list[NDArray]] = {}
    for label, values in levels.items():
        groups.setdefault(group(label), []).append(values)
    return [np.stack(members) for members in groups.values()]


def _mean_correlation(levels: Levels, group: Callable[[Label], Any]) -> NDArray[np.floating]:
    """Return the rank correlation of measured and simulated values (features,), as a mean over the groups where a feature varies."""
    correlations = np.stack([_rank_correlations(members) for members in _grouped(levels, group)])
    finite = np.isfinite(correlations)
    return np.where(finite.any(axis=0), np.where(finite, correlations, 0).sum(axis=0) / np.maximum(finite.sum(axis=0), 1), np.nan)


def _rank_correlations(values: NDArray) -> NDArray[np.floating]:
    """Return the Spearman correlations (features,) of measured and simulated values (n, 2, features); NaN for a constant feature."""
    from scipy.stats import rankdata

    first, second = np.moveaxis(rankdata(values, axis=0), 0, 2)
    return statistics.pearson(first, second)


def bootstrap(
    levels: Levels, statistic: Callable[[Levels], float], resamples: int, seed: int, limits: tuple[float, float] = statistics.ANY
) -> Estimate:
    """Compute a statistic and its interval by at most MOST_DRAWN resamples of whole objects, widened and clipped to `limits`."""
    names = sorted({name for name, _, _ in levels})
    rng = np.random.default_rng(seed)
    drawn = []
    for _ in range(min(resamples, MOST_DRAWN)):
        again = list(enumerate(names[i] for i in rng.choice(len(names), len(names))))
        drawn.append(statistic({(str(k), *at[1:]): values for k, name in again for at, values in levels.items() if at[0] == name}))
    value = statistic(levels)
    return statistics.resampled(value, np.clip(statistics.widened(np.array(drawn), value, len(names)), *limits), len(names), limits)


def _figures(rows: list[Row], first: Frame) -> Figures:
    slice_values = slices(first)  # without those for which the campaign has no recordings
    return {"rover_slices": lambda: slices_figure(slice_values)} if slice_values else {}


METRICS = {"highest_correlation_of_a_feature_{motion}": {"case": "matched"}}
run, recordings, score = framed(TABLE, {"motions": MOTIONS}, cells, _figures, METRICS)
