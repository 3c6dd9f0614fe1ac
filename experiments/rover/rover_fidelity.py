"""Does the simulated signal follow the measured signal along a drive, and do simulated and measured features rank the objects equally?

The start of the simulated drive is aligned with the start of the measured drive by correlating the target energies of both. Range profiles
are compared as amplitudes from 0.3 to 5.5 m. Some rows give the share of features with a positive rank correlation over objects. Another
row gives the share of places where the brightness contrast of metal and plastic has the same sign in both domains. Features depend on each
other, and places with the same objects depend on each other. The p values of both shares therefore come from permutations of the objects;
the paper reports binomial p values, which are too small. Paper: signal fidelity along trajectories.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments import draws, statistics
from experiments.campaign.cases import COMPARED, LABELS, MEASURED, TWIN
from experiments.campaign.source import RecordingSource
from experiments.claims import NONE, Claim, RowList
from experiments.rover import drive_features
from experiments.rover.drive_features import Drive, Drives, Place
from experiments.rover.figures import correlation_figure, panels_figure
from experiments.statistics import Estimate
from radartwin.config.config import Config
from radartwin.errors import InputError
from radartwin.features.align import overlap, start_offset
from radartwin.features.doppler import range_rate
from radartwin.features.profile import profile_correlation
from radartwin.features.sets import BRIGHTNESS
from radartwin.io.progress import Progress
from radartwin.runs.experiment import Result, Table
from radartwin.scene.objects.catalogue import catalogue
from radartwin.store.products import Store

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


@dataclass(frozen=True)
class Agreement:
    """Rank correlation `rho` between measured and simulated values of a feature, over the objects at one place (room, motion, distance)."""

    place: Place
    feature: str
    rho: float


def run(config: Config, store: Store, progress: Progress) -> Result:
    return draws.scored(config, store, progress, lambda campaign: score(config, campaign, progress), rover=True)


def score(config: Config, source: RecordingSource, progress: Progress) -> Result:
    """Build the table rows for each room, motion and distance, and for all of them together."""
    drives = drive_features.read(source, progress)
    found = agreements(drives)
    rows = RowList(config)
    for place in drive_features.places(drives[MEASURED]):
        _add_signals(rows, drives, place)
    _add_shares(rows, drives, found)
    _add_reliability(rows, drives, found)
    _add_materials(rows, drives)
    families = [(one.place, drive_features.family(one.feature), one.rho) for one in found]
    figures = {"rover_panels": lambda: panels_figure(drives), "rover_feature_correlations": lambda: correlation_figure(families)}
    shares = [r for r in rows if r["metric"] == "share of features that order objects alike"]
    metrics = {f"share_alike_{r['room']}_{r['motion']}": r["value"] for r in shares}
    return Result("rover_fidelity", rows, figures, metrics, drive_features.keys(drives))


def agreements(drives: dict[str, Drives]) -> list[Agreement]:
    """Return an `Agreement` for each feature at each place with three or more objects. Features without variation between the objects in
    either domain are left out.
    """
    found = []
    for place in drive_features.places(drives[MEASURED]):
        names = drive_features.objects(drives[MEASURED], place)
        if len(names) < 3:
            continue
        features, first = drive_features.matrix(drives[MEASURED], names, place)
        _, second = drive_features.matrix(drives[TWIN], names, place)
        for column, feature in enumerate(features):
            if np.ptp(first[:, column]) > 0 and np.ptp(second[:, column]) > 0:
                rho = statistics.rank_correlation(first[:, column], second[:, column])
                found.append(Agreement(place, feature, rho))
    return found


def _at(place: Place, label: str, of: str = "both") -> dict[str, Any]:
    """Return the columns that describe a row about one place (room, motion, distance)."""
    return {"room": place[0], "motion": place[1], "distance_m": place[2], "case": label, "of": of}


def _over(label: str, room: str = "all", motion: str = "all") -> dict[str, Any]:
    """Return the columns that describe a row about several places (rooms, motions, distances)."""
    return {"room": room, "motion": motion, "distance_m": None, "case": label, "of": "both"}


def aligned(first: Drive, second: Drive) -> tuple[NDArray, NDArray]:
    """Return the tracked ranges of two drives in the frames that both drives have, after the offset between their starts is removed."""
    try:
        late = start_offset(first.energy, second.energy, max(1, len(first.energy) // 4))
    except InputError:  # the target's energy is constant or below the noise, so the logged start is used
        late = 0
    return overlap(first.track_m, second.track_m, late)


def _add_signals(rows: RowList, drives: dict[str, Drives], place: Place) -> None:
    """Add rows on tracked range, range profile and velocity at one place, over objects. The rows on range profiles also exist for
    each material class.
    """
    names = drive_features.objects(drives[MEASURED], place)
    tracks, profiles, velocities = [], defaultdict(list), defaultdict(list)
    for name in names:
        twin = drives[TWIN][name, place][0]
        for one in drives[MEASURED][name, place]:
            tracks.append(statistics.correlation(*aligned(one, twin)))
            profiles[catalogue()[name].material_class].append(profile_correlation(one.profile, twin.profile, one.range_m))
        for domain in COMPARED:
            for one in drives[domain][name, place]:
                if one.velocity_mps is not None:
                    error = one.velocity_mps - range_rate(one.nominal_m, one.frame_rate_hz)
                    velocities[domain].append(float(np.sqrt(np.mean(error**2))))
    keys = drive_features.keys(drives, names, [place])
    if place[1] == "depth":
        rows.add_mean(_at(place, "all objects"), "track correlation", tracks, keys, OVERLAYS, statistics.SIGNED, statistics.FISHER)
    for kind, values in profiles.items():
        claim = PLACED if kind == "metal" and place[1] == "depth" else NONE
        rows.add_mean(_at(place, kind), "range-profile correlation", values, keys, claim, statistics.SIGNED, statistics.FISHER)
    for domain, values in velocities.items():
        rows.add_mean(_at(place, "all objects", LABELS[domain]), "velocity error, rms (m/s)", values, keys, NONE, statistics.POSITIVE)


def _add_shares(rows: RowList, drives: dict[str, Drives], found: list[Agreement]) -> None:
    """Add the share of positive rank correlations for each room and motion, and the mean correlation of each feature family."""
    groups: dict[tuple[str, str], list[Agreement]] = defaultdict(list)
    for one in found:
        groups[one.place[0], one.place[1]].append(one)
    for (room, motion), some in groups.items():
        keys = drive_features.keys(drives, chosen={one.place for one in some})
        alike = share_alike(drives, sorted({one.place for one in some}), rows.config.seed)
        claim = AGREE.get(room, NONE) if motion == "depth" else NONE
        rows.add(_over("all features", room, motion), "share of features that order objects alike", alike, keys, claim)
        families = defaultdict(list)
        for one in some:
            families[drive_features.family(one.feature)].append(one.rho)
        for name, values in families.items():
            rows.add_mean(_over(name, room, motion), "order of objects, mean", values, keys)


def share_alike(drives: dict[str, Drives], where: Sequence[Place], seed: int) -> Estimate:
    """Return the share of features, over several places, whose rank correlation over objects is positive.

    The features of one recording are not independent trials. The test therefore assigns the simulated objects to the measured objects anew.
    All places use the same assignments; at a place that lacks objects, the others keep their order in the assignment. n counts objects.
    """
    names = sorted({name for place in where for name in drive_features.objects(drives[MEASURED], place)})
    parts = []
    for place in where:
        here = [name for name in names if name in drive_features.objects(drives[MEASURED], place)]
        values = [drive_features.matrix(drives[domain], here, place)[1] for domain in COMPARED]
        varies = np.all([np.ptp(one, axis=0) > 0 for one in values], axis=0)
        parts.append((np.array([names.index(name) for name in here]), *(one[:, varies] for one in values)))

    shuffled = statistics.orders(len(names), seed)
    positive = [_positive_shuffled(measured, simulated, shuffled[:, place]) for place, measured, simulated in parts]
    shares = np.concatenate(positive, axis=1).mean(axis=1)
    return statistics.permuted(float(shares[0]), shares, len(names), statistics.SHARE)


def _positive_shuffled(measured: NDArray, simulated: NDArray, orders: NDArray) -> NDArray[np.bool_]:
    """Return (permutations, features) whether the rank correlation over the objects of a place is positive after the simulated objects are
    permuted. The permutation of these objects is their order by the numbers `orders` (permutations, objects).
    """
    from scipy.stats import rankdata

    one, two = (rankdata(values, axis=0) - (len(values) + 1) / 2 for values in (measured, simulated))
    order = np.argsort(orders, axis=1)
    total = np.zeros((len(orders), one.shape[1]))
    for number, row in enumerate(one):
        total += row * two[order[:, number]]
    return total > 1e-9


def _add_reliability(rows: RowList, drives: dict[str, Drives], found: list[Agreement]) -> None:
    """Add the share of features whose mean rank correlation does not exceed that of the feature `multipath share`."""
    means = {f: np.mean([one.rho for one in found if one.feature == f]) for f in {one.feature for one in found}}
    if MULTIPATH in means and len(means) > 1:
        beaten = float(np.mean([means[MULTIPATH] >= value for f, value in means.items() if f != MULTIPATH]))
        keys = drive_features.keys(drives, chosen={one.place for one in found})
        rows.add(_over("multipath share"), "share of features less reliable", statistics.exact(beaten, len(means) - 1), keys, RELIABLE)


def _add_materials(rows: RowList, drives: dict[str, Drives]) -> None:
    """Add rows on the brightness contrast (metal minus plastic, dB) for each place and domain.

    Two summary rows give the share of places where the contrast has the same sign in measurement and simulation, and the ratio of
    simulated to measured contrast.
    """
    label, gaps, keys, where = "metal less plastic", [], [], []
    known = catalogue()
    for place in drive_features.places(drives[MEASURED]):
        names = drive_features.objects(drives[MEASURED], place)
        metal, plastic = ([name for name in names if known[name].material_class == kind] for kind in ("metal", "plastic"))
        if not (metal and plastic):
            continue
        used = drive_features.keys(drives, [*metal, *plastic], [place])
        gaps.append([_brightness(drives[domain], metal, place) - _brightness(drives[domain], plastic, place) for domain in COMPARED])
        for domain, gap in zip(COMPARED, gaps[-1], strict=True):
            rows.add(_at(place, label, LABELS[domain]), "brightness (dB)", statistics.exact(gap, len(metal) + len(plastic)), used)
        keys += used
        where.append(place)
    if gaps:
        pairs = np.array(gaps)
        alike = float(np.mean(np.sign(pairs[:, 0]) == np.sign(pairs[:, 1])))
        names = [name for name in known if known[name].material_class in ("metal", "plastic")]
        names = [name for name in names if any((name, place) in drives[MEASURED] for place in where)]
        levels = np.array([[[_level(drives[domain], name, place) for place in where] for name in names] for domain in COMPARED])
        p = contrast_test(levels, np.array([known[name].material_class == "metal" for name in names]))
        signs = statistics.interval_of_p(alike, 0.5, p, len(names), statistics.SHARE)
        rows.add(_over(label), "share of places with one sign", signs, keys, SIGNS)
        ratio = _ratio(pairs, rows.config.profile.resamples, rows.config.seed)
        rows.add(_over(label), "simulated over measured", ratio, keys, SEPARATES)


def contrast_test(levels: NDArray, metal: NDArray[np.bool_]) -> float:
    """Return the p value of the test whether the brightness contrast of metal and plastic has one sign in both domains.

    The test assigns the material labels to the objects in every possible way, the same at all places, because the places share the objects.
    In each domain, p is the share of assignments whose mean contrast over places is at least as far from zero as the contrast of the true
    labels. The claim needs a contrast in both domains, so the larger of the two p values counts. p is 1 if the contrasts have different
    signs.

    Args:
        levels: (2, objects, places) brightness in dB in both domains, NaN where an object is missing.
        metal: (objects,) whether an object is of metal; the other objects are of plastic.
    """
    count, chosen = len(metal), int(metal.sum())
    assigned = [np.isin(np.arange(count), some) for some in combinations(range(count), chosen)]
    labels, known = np.array([metal, *assigned], float), np.isfinite(levels).astype(float)
    with np.errstate(invalid="ignore"):  # a place without objects of one label has no contrast, which counts as 0 dB
        means = [one @ np.nan_to_num(levels) / (one @ known) for one in (labels, 1 - labels)]
    contrasts = np.nan_to_num(means[0] - means[1]).mean(axis=-1)
    far = np.abs(contrasts[:, 1:]) >= np.abs(contrasts[:, :1]) - 1e-9
    one_sign = np.sign(contrasts[0, 0]) == np.sign(contrasts[1, 0])
    return float(far.mean(axis=1).max()) if one_sign else 1.0


def _ratio(pairs: NDArray, resamples: int, seed: int) -> Estimate:
    """Estimate the mean simulated brightness contrast divided by the mean measured contrast, from `pairs` (places, 2), with a bootstrap
    over places.

    The ratio counts as infinite in a resample whose mean measured contrast is not above zero.
    """
    value = float(pairs[:, 1].mean() / pairs[:, 0].mean()) if pairs[:, 0].mean() > 0 else float("nan")
    forward, back = statistics.SCALES[statistics.LOG]
    drawn = pairs[np.random.default_rng(seed).integers(len(pairs), size=(resamples, len(pairs)))].mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.where(drawn[:, 0] > 0, drawn[:, 1] / drawn[:, 0], np.inf)
        ratios = back(statistics.widened(forward(ratios), float(forward(value)), len(pairs)))
    return replace(statistics.resampled(value, ratios, len(pairs), statistics.POSITIVE), scale=statistics.LOG, unit="places")


def _brightness(drives: Drives, names: list[str], place: Place) -> float:
    return float(np.mean([_level(drives, name, place) for name in names]))


def _level(drives: Drives, name: str, place: Place) -> float:
    """Return the mean brightness of an object at a place in dB, or NaN if the place has no recording of the object."""
    return float(np.mean([one.values[BRIGHTNESS] for one in drives[name, place]])) if (name, place) in drives else np.nan
