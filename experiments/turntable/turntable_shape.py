"""Shape: does the modulation of an object's echo over a turn stand in the same relation to the others' in simulation as measured?

Every object turns in front of the radar at each distance. From each recording comes the angular harmonic ratio (1-6 cycles per turn over
DC), the other rotation features but brightness, and the range-Doppler signature of a turn. Compared: the ratio of each object; the ranking
of objects (Spearman); the matrices of distances between objects (Mantel test on standardised features); signatures (SSIM, against that with
other objects); how much the ratio of the corner reflector changes with distance. Paper: disentangled fidelity, shape, and turntable
fidelity. An object counts as cleanly localised where, in half or more of its measured recordings, the room's strongest return is in the
target gate; the paper does not say how it chose.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from experiments import statistics
from experiments.claims import NONE, Claim, row
from experiments.recognition.readings import Campaign
from experiments.statistics import Estimate
from experiments.turntable import rotations
from experiments.turntable.facet_ripple import ripple_rows
from experiments.turntable.rotations import DOMAINS, LABELS, MEASURED, TWIN, Turns
from radartwin.config.config import Config
from radartwin.io.progress import Progress
from radartwin.plotting.style import PAGE_WIDTH_IN, PALETTE, figure
from radartwin.runs.experiment import Result, Table
from radartwin.scene.objects.catalogue import catalogue
from radartwin.store.products import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE = Table(
    name="turntable_shape",
    title="Shape",
    caption="Objects on a turntable in the laboratory. Rows give the angular harmonic ratio (power at 1 to 6 cycles per revolution over "
    "the DC power, in the target gate, noise subtracted), its order over objects in both domains, the agreement of the "
    "distances between objects over all shape features (Mantel test), the similarity of the range-Doppler signatures of a "
    "revolution (SSIM), the variation with distance, and the ripple that flat facets add. Slow time runs at the frame rate, so "
    "the Doppler of the rim folds in both domains alike. Intervals are 95 % bootstraps over items. n counts recordings.",
)

RATIO = "harmonic_ratio"
REFLECTOR = "corner_reflector"
SHAPE_FEATURES = (RATIO, *(f"harmonic_{m}" for m in range(1, 7)), "crest_factor", "entropy", "azimuth_extent_rad")
PERMUTATIONS = 999  # the paper's p of 0.001 is the least that so many can give

SHOWN = 1e-4  # the least ratio of the figure: a twin's can has none
LEAST = 4  # objects: fewer cannot reach p 0.05, however well they agree

SPLIT = Claim("cans are flatter than the reflector and the bottles", "0.72 / 0.18 = 4", above=1.0)
ORDER = Claim("the order of objects is kept", "0.76", above=0.0, p_below=0.05, least=LEAST)
CLEAN = Claim("the order of cleanly localised objects is kept", "0.89", above=0.0, p_below=0.05, least=LEAST)
STRUCTURE = Claim("distances between objects are kept", "r 0.85, p 0.001", above=0.0, p_below=0.05, least=LEAST)
ALIKE = Claim("", "0.76")
OWN = Claim("a signature is more like its own twin's than like another object's", "", above=0.0)
_STABLE = "the reflector's ratio is stable with distance: it varies less than between objects"
STABLE_M = (0.6, 2.1)  # where the paper gives the reflector's variation; nearer, the wavefront bends over it


def run(config: Config, store: Store, progress: Progress) -> Result:
    from experiments.campaign.campaign import Campaign as Recorded

    return score(config, Recorded(config, store, progress), progress)


def score(config: Config, campaign: Campaign, progress: Progress, ripple: bool = True) -> Result:
    """Rows and figures from the turns of a campaign; `ripple` False leaves the meshes' facets out."""
    turns = rotations.read(campaign, progress)
    names = rotations.objects(turns[MEASURED])
    alike = similarity(turns, names)
    rows = [*_ratio_rows(config, turns, names), *_order_rows(config, turns, names), *_signature_rows(config, turns, names, alike)]
    rows += _distance_rows(config, turns, names)
    if ripple:
        rows += ripple_rows(config)
    figures: dict[str, Callable[[], Figure]] = {
        "turntable_ssim": lambda: _ssim_figure(names, alike),
        "turntable_ranking": lambda: _ranking_figure(turns, names),
    }
    headline = {"order of objects": "spearman", "distances between objects": "mantel_r", "signatures": "ssim_mean"}
    metrics = {headline[r["metric"]]: r["value"] for r in rows if r["metric"] in headline and r["case"] == "all objects"}
    return Result(TABLE.name, rows, figures, metrics, rotations.keys(*(some for d in DOMAINS for some in turns[d].values())))


def similarity(turns: dict[str, Turns], names: list[str]) -> dict[tuple[str, str], NDArray[np.float64]]:
    """SSIM of each measured signature of the first object with the simulated ones of the second at the same distance."""
    return {
        (first, second): np.array([
            statistics.ssim(one.signature.level, other.signature.level)
            for (name, distance), some in turns[MEASURED].items() if name == first
            for one in some for other in turns[TWIN].get((second, distance), ())
        ])
        for first in names for second in names
    }  # fmt: skip


def _ratio_rows(config: Config, turns: dict[str, Turns], names: list[str]) -> list[dict[str, Any]]:
    """The ratio of each object in each domain, and how far cans are from what has facets or is not round."""
    rows = []
    known = catalogue()
    cans = [name for name in names if rotations.is_can(name)]
    peaked = [name for name in names if known[name].shape != "symmetric"]
    for domain in DOMAINS:
        for name in names:
            measured = domain == MEASURED
            claim = Claim(paper=("0.03-0.18" if name in cans else "0.72-2.5" if name in peaked else "") if measured else "")
            found = statistics.mean(rotations.samples(turns[domain], RATIO, name), config.profile.resamples, config.seed)
            case = {"case": known[name].label, "distance_m": None, "of": LABELS[domain]}
            rows.append(row(config, case, "angular harmonic ratio", found, rotations.keys(rotations.chosen(turns[domain], [name])), claim))
        if cans and peaked:
            found = _gap(config, turns[domain], cans, peaked)
            case = {"case": "least peaked over least flat", "distance_m": None, "of": LABELS[domain]}
            source = rotations.keys(rotations.chosen(turns[domain], [*cans, *peaked]))
            rows.append(row(config, case, "ratio of harmonic ratios", found, source, SPLIT))
    return rows


def _gap(config: Config, turns: Turns, cans: list[str], peaked: list[str]) -> Estimate:
    """Smallest mean ratio among the peaked over the largest among the cans, recordings of each object drawn anew."""
    rng = np.random.default_rng(config.seed)
    drawn = {name: rotations.samples(turns, RATIO, name) for name in (*cans, *peaked)}

    def gap(values: dict[str, NDArray]) -> float:
        return min(values[name].mean() for name in peaked) / max(values[name].mean() for name in cans)

    value = gap(drawn)
    resampled = [gap({name: rng.choice(some, len(some)) for name, some in drawn.items()}) for _ in range(config.profile.resamples)]
    low, high = np.quantile(resampled, [0.025, 0.975])
    return Estimate(value, min(float(low), value), max(float(high), value), sum(len(some) for some in drawn.values()))


def _order_rows(config: Config, turns: dict[str, Turns], names: list[str]) -> list[dict[str, Any]]:
    """Spearman of the ratio over objects, pooled and at each distance, and the Mantel test of their distances in feature space."""
    rows = []
    clean = [name for name in names if np.mean([turn.localised for turn in rotations.chosen(turns[MEASURED], [name])]) >= 0.5]
    cases: list[tuple[str, list[str], float | None, Claim]] = [("all objects", names, None, ORDER)]
    cases += [("cleanly localised objects", clean, None, CLEAN)]
    cases += [("all objects at one distance", names, distance, NONE) for distance in rotations.distances_m(turns[MEASURED])]
    for label, some, distance, claim in cases:
        here = [name for name in some if all(distance is None or (name, distance) in turns[domain] for domain in DOMAINS)]
        if len(here) < 3:
            continue
        first, second = (rotations.object_means(turns[domain], RATIO, here, distance) for domain in DOMAINS)
        found = statistics.spearman(first, second, config.profile.resamples, config.seed)
        case = {"case": label, "distance_m": distance, "of": "both"}
        rows.append(row(config, case, "order of objects", found, _keys(turns, here, distance), claim))
    if len(names) > 2:
        first, second = (distance_matrix(turns[domain], names) for domain in DOMAINS)
        found = statistics.mantel(first, second, PERMUTATIONS, config.seed)
        case = {"case": "all objects", "distance_m": None, "of": "both"}
        rows.append(row(config, case, "distances between objects", found, _keys(turns, names), STRUCTURE))
    return rows


def distance_matrix(turns: Turns, names: list[str]) -> NDArray[np.float64]:
    """(objects, objects): Euclidean, between means over recordings of the shape features, each with unit spread over objects."""
    from scipy.spatial.distance import pdist, squareform

    values = np.stack([rotations.object_means(turns, feature, names) for feature in SHAPE_FEATURES], axis=1)
    spread = values.std(axis=0)
    return squareform(pdist((values - values.mean(axis=0)) / np.where(spread > 0, spread, 1.0)))


def _signature_rows(
    config: Config, turns: dict[str, Turns], names: list[str], alike: Mapping[tuple[str, str], NDArray]
) -> list[dict[str, Any]]:
    rows = []
    for name in names:
        case = {"case": catalogue()[name].label, "distance_m": None, "of": "both"}
        found = statistics.mean(alike[name, name], config.profile.resamples, config.seed)
        rows.append(row(config, case, "signature (SSIM)", found, _keys(turns, [name])))
    own = np.array([alike[name, name].mean() for name in names])
    case = {"case": "all objects", "distance_m": None, "of": "both"}
    rows.append(row(config, case, "signatures", statistics.mean(own, config.profile.resamples, config.seed), _keys(turns, names), ALIKE))
    if len(names) > 1:
        others = np.array([np.mean([alike[name, other].mean() for other in names if other != name]) for name in names])
        found = statistics.mean(own - others, config.profile.resamples, config.seed)
        rows.append(row(config, case, "own signature less others'", found, _keys(turns, names), OWN))
    return rows


def _distance_rows(config: Config, turns: dict[str, Turns], names: list[str]) -> list[dict[str, Any]]:
    """Variation over distance of each domain's ratio: of the reflector against that between objects, and of all objects in the mean."""
    rows = []
    seeds = config.profile.resamples, config.seed
    for domain in DOMAINS:
        between = statistics.coefficient_of_variation(_positive(rotations.object_means(turns[domain], RATIO, names)), *seeds).value
        claimed = Claim(_STABLE, "0.07", below=between) if domain == MEASURED else NONE
        for label, (low, high), claim in (("reflector, 0.6-2.1 m", STABLE_M, claimed), ("reflector, all distances", (0.0, np.inf), NONE)):
            values = _over_distance(turns[domain], REFLECTOR, low, high)
            if len(values) > 1:
                found = statistics.coefficient_of_variation(values, *seeds)
                case = {"case": label, "distance_m": None, "of": LABELS[domain]}
                source = [turn.key for turn in rotations.chosen(turns[domain], [REFLECTOR]) if low <= turn.case.distance_m <= high]
                rows.append(row(config, case, "variation over distance", found, source, claim))
        several = {name: values for name in names if len(values := _over_distance(turns[domain], name)) > 1}
        if several:
            found = statistics.mean([statistics.coefficient_of_variation(values, *seeds).value for values in several.values()], *seeds)
            case = {"case": "mean of objects", "distance_m": None, "of": LABELS[domain]}
            source = rotations.keys(rotations.chosen(turns[domain], list(several)))
            rows.append(row(config, case, "variation over distance", found, source))
    return rows


def _over_distance(turns: Turns, name: str, low_m: float = 0.0, high_m: float = np.inf) -> NDArray[np.float64]:
    """The ratio at each distance, mean over repetitions."""
    some = [turn for (known, distance), turn in turns.items() if known == name and low_m <= distance <= high_m]
    return _positive(np.array([np.mean([one.values[RATIO] for one in turn]) for turn in some]))


def _positive(values: NDArray) -> NDArray[np.float64]:
    """A body of revolution without noise has a ratio of exactly zero."""
    return np.maximum(values, 1e-12)


def _keys(turns: dict[str, Turns], names: list[str], distance_m: float | None = None) -> list[str]:
    return rotations.keys(*(rotations.chosen(turns[domain], names, distance_m) for domain in DOMAINS))


def _ssim_figure(names: list[str], alike: Mapping[tuple[str, str], NDArray]) -> Figure:
    """Bars of SSIM per object with its own twin, dots with the others' twins, and the means."""
    drawing, axes = figure(1, 1, width_in=PAGE_WIDTH_IN * 0.75, height_in=2.8)
    own = np.array([alike[name, name].mean() for name in names])
    place = np.arange(len(names))
    axes.bar(place, own, color=PALETTE[5], label=f"own twin, mean {own.mean():.2f}")
    for i, name in enumerate(names):
        others = [alike[name, other].mean() for other in names if other != name]
        axes.plot(
            np.full(len(others), i),
            others,
            ".",
            ms=5,
            color="white",
            mec="black",
            mew=0.6,
            label="other objects' twins" if i == 0 else None,
        )
    axes.axhline(0.76, color=PALETTE[1], lw=1.2, ls="--", label="mean of the paper, 0.76")
    axes.set(ylabel="SSIM of signatures", ylim=(0, 1.05))
    axes.set_xticks(place, [catalogue()[name].label for name in names], rotation=40, ha="right")
    drawing.legend(loc="outside upper center", ncols=3)
    return drawing


def _ranking_figure(turns: dict[str, Turns], names: list[str]) -> Figure:
    """The ratio of each object in both domains, ordered by the measured one, with its spread over recordings."""
    drawing, axes = figure(1, 1, width_in=PAGE_WIDTH_IN * 0.6, height_in=3.0)
    order = [names[i] for i in np.argsort(rotations.object_means(turns[MEASURED], RATIO, names))]
    place = np.arange(len(order))
    for domain, colour, marker, shift in ((MEASURED, PALETTE[0], "o", 0.12), (TWIN, PALETTE[1], "s", -0.12)):
        for i, name in enumerate(order):
            values = np.maximum(rotations.samples(turns[domain], RATIO, name), SHOWN)
            axes.plot([values.min(), values.max()], [i + shift] * 2, color=colour, lw=1)
        axes.plot(
            np.maximum(rotations.object_means(turns[domain], RATIO, order), SHOWN),
            place + shift,
            marker,
            ms=5,
            color=colour,
            label=LABELS[domain],
        )
    axes.set_yticks(place, [f"{catalogue()[name].label} ({catalogue()[name].shape})" for name in order])
    axes.set(xscale="log", xlabel=f"angular harmonic ratio ({SHOWN:g}: or less)")
    axes.grid(axis="x", color="0.9", lw=0.5)
    drawing.legend(loc="outside upper center", ncols=2)
    return drawing
