"""Does the simulated signal follow the measured signal along a drive, and do simulated and measured features rank the objects equally?

The starts of both drives are aligned by correlating their target energies. Range profiles are compared as amplitudes from 0.3 to 5.5 m.
Features depend on each other, and so do places with the same objects; the p values of the shares of features and of places therefore come
from permutations of the objects, while the binomial p values of the paper are too small. Paper: signal fidelity along trajectories.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from experiments import statistics
from experiments.campaign.cases import COMPARED, LABELS, MEASURED, ROVER
from experiments.campaign.frame import Frame, features
from experiments.cells import Cell, mean, paired, per, using
from experiments.framed import framed
from experiments.rover.figures import correlation_figure, panels_figure
from experiments.statistics import Estimate
from experiments.verdicts import NONE, Claim
from radartwin.config.config import Config
from radartwin.errors import InputError
from radartwin.features.align import overlap, start_offset
from radartwin.features.doppler import range_rate
from radartwin.features.families import BRIGHTNESS
from radartwin.features.profile import profile_correlation
from radartwin.runs.experiment import Table

TABLE = Table(
    name="rover_fidelity",
    title="Features along drives",
    caption="Objects in front of a driving rover. Rows give the tracked range after removal of the start offset, the mean "
    "normalised range profile, the velocity from Doppler against the log, the rank correlation of each feature over objects "
    "at equal distance (Spearman, measured against simulated), and the brightness of metal minus plastic. The test of "
    "the share of positive rank correlations assigns the simulated objects to the measured ones anew. The test of the share of places "
    "with one sign assigns the material labels to the objects anew, in the domain with the larger p. Their intervals invert these "
    "tests. Other intervals are 95 % bootstraps, widened for few items.",
)

MOTIONS = ROVER
OVERLAYS = Claim("once start offsets are fitted, the simulated range track overlays the measured", "", bound=0.5, null=0.0)
PLACED = Claim("mean range profiles of metals correlate", "up to +0.73", bound=0.2, null=0.0)
AGREE = {
    "atrium": Claim("more features order objects alike than chance allows", "78 %, p 1.5e-5", bound=0.5),
    "squash_court": Claim("more features order objects alike than chance allows", "63 %, p 0.014", bound=0.5),
}
SIGNS = Claim("metal over plastic has the same sign in both domains", "9 of 9", bound=0.5)
SEPARATES = Claim(
    "the simulation separates metal from plastic more", "about 25:1", bound=1.5, null=1.0,
    untestable="the receiver has no compression or gain control",
)  # fmt: skip
RELIABLE = Claim("the multipath share is the most reliable feature", "first", bound=1 - 1e-9, null=0.5, least=1)
MULTIPATH = "multipath_share"
WHERE = ["room", "motion", "distance_m"]
Place = tuple[str, str, float]  # room, motion, distance
Series = tuple[NDArray, NDArray]


def cells(config: Config, frame: Frame) -> Iterator[Cell]:
    """Declare the cells of each room, motion and distance, and of all of them together."""
    for place, here in frame.groupby(WHERE):
        yield from _signals(here, place)
    yield from _orders(frame)
    yield from _materials(frame)


def agreements(frame: Frame) -> Frame:
    """Return the rank correlation `rho` over the objects of each place (three or more) for each feature that varies in both domains."""
    rows = []
    for place, here in frame.groupby(WHERE):
        if here.object.nunique() > 2:
            first, second = (per(features(here), domain)(here) for domain in COMPARED)
            for name in first.columns[(np.ptp(first, axis=0) > 0) & (np.ptp(second, axis=0) > 0)]:
                rho = statistics.rank_correlation(first[name], second[name])
                rows.append((*place, name, family(name), rho))
    return pd.DataFrame(rows, columns=[*WHERE, "feature", "family", "rho"])


def family(feature: str) -> str:
    """Return the name of the feature family of a feature, as tables print it."""
    if feature.startswith("window"):
        return "range-profile window"
    known = {"multipath_share": "multipath share", "azimuth_extent_rad": "angular extent", BRIGHTNESS: "brightness"}
    known |= dict.fromkeys(("excursion_m", "track_offset_m", "track_spread_m"), "track")
    return known.get(feature, "envelope")


def _case(label: str, place: tuple[str, str, float | None] = ("all", "all", None), of: str = "both") -> dict[str, Any]:
    """Return the columns that describe a row about one place or several places (room, motion, distance)."""
    return dict(zip(WHERE, place, strict=True)) | {"case": label, "of": of}


def aligned(first: Series, second: Series) -> tuple[NDArray, NDArray]:
    """Return the tracked ranges (F,) of two drives in the frames that both drives have, without the offset between their starts."""
    try:
        late = start_offset(first[0], second[0], max(1, len(first[0]) // 4))
    except InputError:  # the target's energy is constant or below the noise, so the logged start is used
        late = 0
    return overlap(first[1], second[1], late)


def _signals(here: Frame, place: Place) -> Iterator[Cell]:
    """Declare cells on tracked range, range profile and velocity at one place, and on range profiles for each material class."""
    pairs = paired(here)
    if place[1] == "depth":
        tracks = [
            statistics.correlation(*aligned((drive.energy, drive.track_m), (drive.energy_twin, drive.track_m_twin)))
            for drive in pairs.itertuples()
        ]
        yield Cell(_case("all objects", place), "track correlation", here, mean(tracks, statistics.SIGNED, statistics.FISHER), OVERLAYS)
    for kind, of_kind in pairs.groupby("material_class", sort=False):
        alike = [profile_correlation(drive.profile, drive.profile_twin, drive.range_m) for drive in of_kind.itertuples()]
        claim = PLACED if kind == "metal" and place[1] == "depth" else NONE
        yield Cell(_case(kind, place), "range-profile correlation", here, mean(alike, statistics.SIGNED, statistics.FISHER), claim)
    for domain in COMPARED:
        drives = [drive for drive in here[here.domain == domain].itertuples() if len(drive.velocity_mps)]
        error = [float(np.sqrt(np.mean((drive.velocity_mps - range_rate(drive.nominal_m, drive.frame_rate_hz)) ** 2))) for drive in drives]
        if error:
            yield Cell(_case("all objects", place, LABELS[domain]), "velocity error, rms (m/s)", here, mean(error, statistics.POSITIVE))


def _orders(frame: Frame) -> Iterator[Cell]:
    """Declare the share of positive rank correlations and the mean of each family at a room and motion, and the rank of MULTIPATH."""
    correlations = agreements(frame)
    ordered = frame.merge(correlations[WHERE].drop_duplicates())
    for (room, motion), group in correlations.groupby(["room", "motion"]):
        here = ordered[(ordered.room == room) & (ordered.motion == motion)]
        claim = AGREE.get(room, NONE) if motion == "depth" else NONE
        yield Cell(_case("all features", (room, motion, None)), "share of features that order objects alike", here, share_alike, claim)
        for name, of in group.groupby("family", sort=False):
            yield Cell(_case(name, (room, motion, None)), "order of objects, mean", here, mean(of.rho, statistics.SIGNED))
    means = correlations.groupby("feature").rho.mean()
    if MULTIPATH in means and len(means) > 1:
        beaten = float((means[MULTIPATH] >= means.drop(MULTIPATH)).mean())
        estimate = statistics.exact(beaten, len(means) - 1)
        yield Cell(_case("multipath share"), "share of features less reliable", ordered, estimate, RELIABLE)


def share_alike(rows: Frame, resamples: int, seed: int) -> Estimate:
    """Return the share of features, over several places, whose rank correlation over objects is positive.

    The features of one recording are not independent trials. The test therefore assigns the simulated objects to the measured objects anew.
    All places use the same assignments; at a place that lacks objects, the others keep their order in the assignment. n counts objects.
    """
    names = sorted(set(rows.object))
    shuffled, positive = statistics.orders(len(names), seed), []
    for _, here in rows.groupby(WHERE):
        values = [per(features(here), domain)(here).sort_index() for domain in COMPARED]
        varies = np.all([np.ptp(levels, axis=0) > 0 for levels in values], axis=0)
        place = np.searchsorted(names, values[0].index.to_list())
        measured, simulated = (levels.to_numpy()[:, varies] for levels in values)
        positive.append(_positive_shuffled(measured, simulated, shuffled[:, place]))
    shares = np.concatenate(positive, axis=1).mean(axis=1)
    return statistics.permuted(float(shares[0]), shares, len(names), statistics.SHARE)


def _positive_shuffled(measured: NDArray, simulated: NDArray, orders: NDArray) -> NDArray[np.bool_]:
    """Return (permutations, features) whether the correlation is positive after the simulated objects are sorted by `orders`."""
    from scipy.stats import rankdata

    ranks, twin_ranks = (rankdata(values, axis=0) - (len(values) + 1) / 2 for values in (measured, simulated))
    order = np.argsort(orders, axis=1)
    total = np.zeros((len(orders), ranks.shape[1]))
    for number, row in enumerate(ranks):
        total += row * twin_ranks[order[:, number]]
    return total > 1e-9


def _materials(frame: Frame) -> Iterator[Cell]:
    """Declare the contrast of metal and plastic at each place and domain, the share of places with one sign, and the ratio."""
    frame = frame[frame.material_class.isin(["metal", "plastic"])]
    both = frame.groupby(WHERE).filter(lambda here: here.material_class.nunique() == 2)
    if both.empty:
        return
    label = "metal less plastic"
    levels = both.groupby(["domain", "material_class", "object", *WHERE])[BRIGHTNESS].mean().unstack(WHERE)
    contrasts = (levels.xs("metal", level=1).groupby("domain").mean() - levels.xs("plastic", level=1).groupby("domain").mean()).loc[
        [*COMPARED]
    ]
    for place, here in both.groupby(WHERE):
        for domain in COMPARED:
            estimate = statistics.exact(contrasts.loc[domain, place], here.object.nunique())
            yield Cell(_case(label, place, LABELS[domain]), "brightness (dB)", here, estimate)
    pairs = contrasts.to_numpy().T
    kinds = levels.loc[MEASURED].index.get_level_values(0)
    p = contrast_test(np.array([levels.loc[domain] for domain in COMPARED]), kinds == "metal")
    alike = float(np.mean(np.sign(pairs[:, 0]) == np.sign(pairs[:, 1])))
    signs = statistics.interval_of_p(alike, 0.5, p, len(kinds), statistics.SHARE)
    yield Cell(_case(label), "share of places with one sign", both, signs, SIGNS)
    yield Cell(_case(label), "simulated over measured", both, using(_ratio, pairs), SEPARATES)


def contrast_test(levels: NDArray, metal: NDArray[np.bool_]) -> float:
    """Return the p value of the test whether the brightness contrast of metal and plastic has one sign in both domains, from the levels
    (2, objects, places) in dB, NaN where an object is missing.

    The test assigns the material labels to the objects in every possible way, the same at all places, because the places share the objects.
    In each domain, p is the share of assignments whose mean contrast over places is at least as far from zero as that of the true labels.
    The larger p counts, because the claim needs a contrast in both domains. p is 1 if the contrasts have different signs.
    """
    count, metal_count = len(metal), int(metal.sum())
    assigned = [np.isin(np.arange(count), members) for members in combinations(range(count), metal_count)]
    labels, known = np.array([metal, *assigned], float), np.isfinite(levels).astype(float)
    with np.errstate(invalid="ignore"):  # a place without objects of one label has no contrast, which counts as 0 dB
        means = [weights @ np.nan_to_num(levels) / (weights @ known) for weights in (labels, 1 - labels)]
    contrasts = np.nan_to_num(means[0] - means[1]).mean(axis=-1)
    far = np.abs(contrasts[:, 1:]) >= np.abs(contrasts[:, :1]) - 1e-9
    one_sign = np.sign(contrasts[0, 0]) == np.sign(contrasts[1, 0])
    return float(far.mean(axis=1).max()) if one_sign else 1.0


def _ratio(pairs: NDArray, resamples: int, seed: int) -> Estimate:
    """Estimate the simulated over the measured contrast of `pairs` (places, 2); without a measured contrast it is infinite."""
    value = float(pairs[:, 1].mean() / pairs[:, 0].mean()) if pairs[:, 0].mean() > 0 else float("nan")
    forward, back = statistics.SCALES[statistics.LOG]
    drawn = pairs[np.random.default_rng(seed).integers(len(pairs), size=(resamples, len(pairs)))].mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.where(drawn[:, 0] > 0, drawn[:, 1] / drawn[:, 0], np.inf)
        ratios = back(statistics.widened(forward(ratios), float(forward(value)), len(pairs)))
    return replace(statistics.resampled(value, ratios, len(pairs), statistics.POSITIVE), scale=statistics.LOG, unit="places")


FIGURES = {"rover_panels": panels_figure, "rover_feature_correlations": lambda first: correlation_figure(agreements(first))}
METRICS = {"share_alike_{room}_{motion}": {"metric": "share of features that order objects alike"}}
run, recordings, score = framed(TABLE, {"motions": MOTIONS}, cells, FIGURES, METRICS)
