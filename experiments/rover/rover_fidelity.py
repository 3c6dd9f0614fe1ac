"""Along trajectories: does the simulated signal follow the measured one as the rover drives, and do features order objects alike?

For every object, distance and room, a simulated drive is brought to the measured one's start by the correlation of their target energies;
then compared: the tracked range over the frames that overlap (Pearson), the mean normalised range profile (Pearson of amplitudes, 0.3 to
5.5 m), and the radial velocity from Doppler against the log's range rate. At each room, motion and distance: Spearman over objects of every
feature, and the share of these that is positive, with the exact binomial p that the paper gives (features are related, so that it is
smaller than independent ones would earn); the sign of metal less plastic brightness in both domains; and by how much the simulation
separates the two more, in decibels. Paper: signal fidelity along trajectories.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments import statistics
from experiments.claims import NONE, Claim, row
from experiments.recognition.readings import Campaign
from experiments.rover import drive_features
from experiments.rover.drive_features import Drive, Drives, Place
from experiments.rover.figures import correlation_figure, panels_figure
from experiments.statistics import Estimate
from experiments.turntable.rotations import DOMAINS, LABELS, MEASURED, TWIN
from radartwin.config.config import Config
from radartwin.errors import InputError
from radartwin.features.align import overlap, start_offset
from radartwin.features.doppler import range_rate
from radartwin.features.profile import profile_correlation
from radartwin.io.progress import Progress
from radartwin.runs.experiment import Result, Table
from radartwin.scene.objects.catalogue import catalogue
from radartwin.store.products import Store

TABLE = Table(
    name="rover_fidelity",
    title="Along trajectories",
    caption="Objects in front of a driving rover. Rows give the tracked range after removal of the start offset, the mean normalised "
    "range profile, the velocity from Doppler against the log, the order of objects by each feature at matched distance, and "
    "the brightness of metal minus plastic. The order is a Spearman correlation; p is the exact binomial probability of the "
    "share of positive correlations, with features taken as independent. Intervals are 95 % bootstraps; shares have "
    "Clopper-Pearson intervals.",
)

OVERLAYS = Claim("once start offsets are fitted, the simulated range track overlays the measured", "", above=0.0)
PLACED = Claim("mean range profiles of metals correlate", "up to +0.73", above=0.0)
AGREE = {
    "atrium": Claim("more features order objects alike than chance allows", "78 %, p 1.5e-5", above=0.5, p_below=0.05),
    "squash_court": Claim("more features order objects alike than chance allows", "63 %, p 0.014", above=0.5, p_below=0.05),
}
SIGNS = Claim("metal over plastic has the same sign in both domains", "9 of 9", above=0.5, p_below=0.05, least=5)  # five of five is p 0.03
SEPARATES = Claim("the simulation separates metal from plastic more", "about 25:1", above=1.0)
RELIABLE = Claim("the multipath share is the most reliable feature", "first", above=1 - 1e-9, least=1)
SHARE = "multipath_share"


@dataclass(frozen=True)
class Agreement:
    """Rank correlation of one feature over the objects of one place."""

    place: Place
    feature: str
    rho: float


def run(config: Config, store: Store, progress: Progress) -> Result:
    from experiments.campaign.campaign import Campaign as Recorded

    return score(config, Recorded(config, store, progress), progress)


def score(config: Config, campaign: Campaign, progress: Progress) -> Result:
    """Rows per room, motion and distance, and over all of them."""
    drives = drive_features.read(campaign, progress)
    found = agreements(drives)
    rows = [*_signal_rows(config, drives), *_feature_rows(config, drives, found), *_material_rows(config, drives)]
    figures = {
        "rover_panels": lambda: panels_figure(drives),
        "rover_feature_correlations": lambda: correlation_figure(
            [(one.place, drive_features.family(one.feature), one.rho) for one in found]
        ),
    }
    shares = [r for r in rows if r["metric"] == "share of features that order objects alike"]
    metrics = {f"share_alike_{r['room']}_{r['motion']}": r["value"] for r in shares}
    every = [one.key for domain in DOMAINS for some in drives[domain].values() for one in some]
    return Result(TABLE.name, rows, figures, metrics, every)


def agreements(drives: dict[str, Drives]) -> list[Agreement]:
    """Of every feature that varies, at every place with three objects or more."""
    found = []
    for place in drive_features.places(drives[MEASURED]):
        names = drive_features.objects(drives[MEASURED], place)
        if len(names) < 3:
            continue
        features, first = drive_features.matrix(drives[MEASURED], names, place)
        _, second = drive_features.matrix(drives[TWIN], names, place)
        for column, feature in enumerate(features):
            if np.ptp(first[:, column]) > 0 and np.ptp(second[:, column]) > 0:
                rho = statistics.spearman(first[:, column], second[:, column], 1, 0, alternative=None).value
                found.append(Agreement(place, feature, rho))
    return found


def _case(place: Place | None, label: str, room: str = "all", motion: str = "all") -> dict[str, Any]:
    if place is None:
        return {"room": room, "motion": motion, "distance_m": None, "case": label}
    return {"room": place[0], "motion": place[1], "distance_m": place[2], "case": label}


def aligned(first: Drive, second: Drive) -> tuple[NDArray, NDArray]:
    """Tracked ranges of two drives over the frames in which the same happens."""
    try:
        late = start_offset(first.energy, second.energy, max_frames=max(1, len(first.energy) // 4)).frames
    except InputError:  # a target whose energy does not vary, or that drowns in noise: they start together by the log
        late = 0
    return overlap(first.track_m, second.track_m, late)


def _signal_rows(config: Config, drives: dict[str, Drives]) -> list[dict[str, Any]]:
    """Track, profile and velocity, per place over objects; profiles also by class of material."""
    rows = []
    seeds = config.profile.resamples, config.seed
    for place in drive_features.places(drives[MEASURED]):
        names = drive_features.objects(drives[MEASURED], place)
        tracks, profiles, velocities = [], defaultdict(list), defaultdict(list)
        for name in names:
            twin = drives[TWIN][name, place][0]
            for one in drives[MEASURED][name, place]:
                tracks.append(_pearson(*aligned(one, twin)))
                kind = catalogue()[name].material_class
                profiles[kind].append(profile_correlation(one.profile, twin.profile, one.range_m))
            for domain in DOMAINS:
                for one in drives[domain][name, place]:
                    if one.velocity_mps is not None:
                        error = one.velocity_mps - range_rate(one.nominal_m, one.frame_rate_hz)
                        velocities[domain].append(float(np.sqrt(np.mean(error**2))))
        source = drive_features.keys(drives, names, [place])
        if place[1] == "depth":
            found = statistics.mean(tracks, *seeds)
            rows.append(row(config, {**_case(place, "all objects"), "of": "both"}, "track correlation", found, source, OVERLAYS))
        for kind, values in profiles.items():
            claim = PLACED if kind == "metal" and place[1] == "depth" else NONE
            found = statistics.mean(values, *seeds)
            rows.append(row(config, {**_case(place, kind), "of": "both"}, "range-profile correlation", found, source, claim))
        for domain, values in velocities.items():
            case = {**_case(place, "all objects"), "of": LABELS[domain]}
            rows.append(row(config, case, "velocity error, rms (m/s)", statistics.mean(values, *seeds), source))
    return rows


def _feature_rows(config: Config, drives: dict[str, Drives], found: list[Agreement]) -> list[dict[str, Any]]:
    """Shares of positive rank correlations per room and motion, families' means, and how the multipath share stands among all."""
    rows = []
    groups: dict[tuple[str, str], list[Agreement]] = defaultdict(list)
    for one in found:
        groups[one.place[0], one.place[1]].append(one)
    for (room, motion), some in groups.items():
        where = sorted({one.place for one in some})
        source = drive_features.keys(drives, catalogue(), where)
        alike = statistics.share(sum(one.rho > 0 for one in some), len(some))
        claim = AGREE.get(room, NONE) if motion == "depth" else NONE
        case = {**_case(None, "all features", room, motion), "of": "both"}
        rows.append(row(config, case, "share of features that order objects alike", alike, source, claim))
        families = defaultdict(list)
        for one in some:
            families[drive_features.family(one.feature)].append(one.rho)
        for name, values in families.items():
            mean = statistics.mean(values, config.profile.resamples, config.seed)
            rows.append(row(config, {**_case(None, name, room, motion), "of": "both"}, "order of objects, mean", mean, source))
    means = {f: np.mean([one.rho for one in found if one.feature == f]) for f in {one.feature for one in found}}
    if SHARE in means and len(means) > 1:
        beaten = float(np.mean([means[SHARE] >= value for f, value in means.items() if f != SHARE]))
        source = drive_features.keys(drives, catalogue(), {one.place for one in found})
        case = {**_case(None, "multipath share"), "of": "both"}
        rows.append(
            row(config, case, "share of features less reliable", Estimate(beaten, beaten, beaten, len(means) - 1), source, RELIABLE)
        )
    return rows


def _material_rows(config: Config, drives: dict[str, Drives]) -> list[dict[str, Any]]:
    """Metal less plastic per place and domain, the share of places where the signs agree, and the ratio of the separations."""
    rows, gaps, source = [], [], []
    known = catalogue()
    for place in drive_features.places(drives[MEASURED]):
        names = drive_features.objects(drives[MEASURED], place)
        metal, plastic = ([name for name in names if known[name].material_class == kind] for kind in ("metal", "plastic"))
        if not (metal and plastic):
            continue
        apart = {domain: _brightness(drives[domain], metal, place) - _brightness(drives[domain], plastic, place) for domain in DOMAINS}
        used = drive_features.keys(drives, [*metal, *plastic], [place])
        for domain, value in apart.items():
            case = {**_case(place, "metal less plastic"), "of": LABELS[domain]}
            rows.append(row(config, case, "brightness (dB)", Estimate(value, value, value, len(metal) + len(plastic)), used))
        gaps.append((apart[MEASURED], apart[TWIN]))
        source += used
    if gaps:
        pairs = np.array(gaps)
        signs = statistics.share(int(np.sum(np.sign(pairs[:, 0]) == np.sign(pairs[:, 1]))), len(pairs))
        rows.append(row(config, {**_case(None, "metal less plastic"), "of": "both"}, "share of places with one sign", signs, source, SIGNS))
        ratio = _ratio(pairs, config.profile.resamples, config.seed)
        rows.append(row(config, {**_case(None, "metal less plastic"), "of": "both"}, "simulated over measured", ratio, source, SEPARATES))
    return rows


def _ratio(pairs: NDArray, resamples: int, seed: int) -> Estimate:
    """Mean simulated over mean measured separation, places drawn anew; without a bound where a draw's measured one is not above zero."""
    value = float(pairs[:, 1].mean() / pairs[:, 0].mean()) if pairs[:, 0].mean() > 0 else float("nan")
    drawn = pairs[np.random.default_rng(seed).integers(len(pairs), size=(resamples, len(pairs)))].mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = np.quantile(np.where(drawn[:, 0] > 0, drawn[:, 1] / drawn[:, 0], np.inf), [0.025, 0.975], method="inverted_cdf")
    return Estimate(value, min(float(low), value), max(float(high), value), len(pairs))


def _brightness(drives: Drives, names: list[str], place: Place) -> float:
    return float(np.mean([np.mean([one.values["brightness_db"] for one in drives[name, place]]) for name in names]))


def _pearson(first: NDArray, second: NDArray) -> float:
    """0 where one of the two does not move."""
    return float(np.corrcoef(first, second)[0, 1]) if np.ptp(first) > 0 and np.ptp(second) > 0 else 0.0
