"""Shape: do objects differ in the modulation of their echo over a revolution in the same way in simulation and measurement?

The table compares the harmonic ratio of each object between measurement and simulation, and the ranking of the objects by this ratio
(Spearman). The harmonic ratio is the power of harmonics 1 to 6 of the echo's modulation over a revolution, relative to harmonic 0. The
table also compares the distances between objects in the space of all rotation features except brightness (Mantel test), and the
range-Doppler signatures of a revolution. The signature of a measured object is compared by SSIM with the simulation of the same object and
of other objects. Further rows give the change of the corner reflector's harmonic ratio with distance. The corresponding sections of the
paper are "disentangled fidelity, shape" and "turntable fidelity". An object counts as cleanly localised if the strongest echo over all
ranges lies in the target gate in at least half of its measured recordings; the paper gives no criterion.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from experiments import draws, statistics
from experiments.campaign.cases import COMPARED, LABELS, MEASURED, REFLECTOR, TWIN
from experiments.campaign.source import RecordingSource
from experiments.claims import BELOW, NONE, Claim, RowList
from experiments.drawing import DOMAIN_STYLES, legend_above
from experiments.statistics import Estimate
from experiments.turntable import rotations
from experiments.turntable.facet_ripple import ripple_rows
from experiments.turntable.rotations import Turns
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
    caption="Objects on a turntable in the laboratory. Rows give the angular harmonic ratio (power at 1 to 6 cycles per revolution "
    "over the DC power, in the target gate, noise subtracted), the rank correlation of this ratio between the domains, the "
    "agreement of the distances between objects in the space of all shape features (Mantel test), the similarity of the "
    "range-Doppler signatures of a revolution (SSIM), the variation of the ratio with distance, and the ripple that flat "
    "facets add. The Doppler transform runs over frames, so the Doppler of the rim folds at the frame rate, equally in both "
    "domains. Intervals are 95 % bootstraps over items. n counts recordings.",
)

RATIO = "harmonic_ratio"
SHAPE_FEATURES = (RATIO, *(f"harmonic_{m}" for m in range(1, 7)), "crest_factor", "entropy", "azimuth_extent_rad")
PERMUTATIONS = 999  # the smallest possible p is then 0.001, as in the paper
LOWEST_SHOWN = 1e-4  # lower end of the axis of harmonic ratios; a simulated can has a ratio of zero

SPLIT = Claim("cans are flatter than the reflector and the bottles", "0.72 / 0.18 = 4", bound=1.5, null=1.0)
ORDER = Claim("the order of objects is kept", "0.76", bound=0.0)
CLEAN = Claim("the order of cleanly localised objects is kept", "0.89", bound=0.0)
STRUCTURE = Claim("distances between objects are kept", "r 0.85, p 0.001", bound=0.0)
ALIKE = Claim("", "0.76")
OWN = Claim("a measured signature is more similar to the simulation of the same object than to that of other objects", bound=0.05, null=0.0)
_STABLE = "the reflector's ratio is stable with distance: it varies less than between objects"
STABLE_M = (0.6, 2.1)  # the paper's distances; at smaller distances the wavefront is curved across the reflector
Similarity = Mapping[tuple[str, str], NDArray[np.float64]]  # [measured object, simulated object]: SSIM values


def run(config: Config, store: Store, progress: Progress) -> Result:
    return draws.scored(config, store, progress, lambda campaign: score(config, campaign, progress))


def score(config: Config, source: RecordingSource, progress: Progress, ripple: bool = True) -> Result:
    """Build the table rows and figures. `ripple` adds the rows of the module facet_ripple."""
    turns = rotations.read(source, progress)
    names = rotations.objects(turns[MEASURED])
    similar = similarity(turns, names)
    rows = RowList(config)
    _add_ratios(rows, turns, names)
    _add_orders(rows, turns, names)
    _add_signatures(rows, turns, names, similar)
    _add_distances(rows, turns, names)
    if ripple:
        rows += ripple_rows(config)
    figures: dict[str, Callable[[], Figure]] = {
        "turntable_ssim": lambda: _ssim_figure(names, similar),
        "turntable_ranking": lambda: _ranking_figure(turns, names),
    }
    headline = {"order of objects": "spearman", "distances between objects": "mantel_r", "signatures": "ssim_mean"}
    metrics = {headline[r["metric"]]: r["value"] for r in rows if r["metric"] in headline and r["case"] == "all objects"}
    return Result("turntable_shape", rows, figures, metrics, rotations.keys_of_both(turns))


def similarity(turns: dict[str, Turns], names: list[str]) -> Similarity:
    """Compute for each pair of objects the SSIM of the measured signatures of the first with the simulated signatures of the second."""
    return {
        (first, second): np.array([
            statistics.ssim(one.signature, other.signature)
            for (name, distance), some in turns[MEASURED].items() if name == first
            for one in some for other in turns[TWIN].get((second, distance), ())
        ])
        for first in names for second in names
    }  # fmt: skip


def _case(label: str, of: str = "both", distance_m: float | None = None) -> dict[str, str | float | None]:
    return {"case": label, "distance_m": distance_m, "of": of}


def _add_ratios(rows: RowList, turns: dict[str, Turns], names: list[str]) -> None:
    """Add the harmonic ratio of each object in each domain, and the factor between the ratios of objects that are not round (`peaked`) and
    of the cans.
    """
    known = catalogue()
    cans = [name for name in names if rotations.is_can(name)]
    peaked = [name for name in names if known[name].shape != "symmetric"]
    for domain in COMPARED:
        for name in names:
            paper = ("0.03-0.18" if name in cans else "0.72-2.5" if name in peaked else "") if domain == MEASURED else ""
            values, source = rotations.samples(turns[domain], RATIO, name), rotations.keys(turns[domain], [name])
            rows.add_mean(
                _case(known[name].label, LABELS[domain]), "angular harmonic ratio", values, source, Claim(paper=paper), statistics.POSITIVE
            )
        if cans and peaked:
            found = _separation(rows.config, turns[domain], cans, peaked)
            source = rotations.keys(turns[domain], [*cans, *peaked])
            rows.add(_case("peaked over cans", LABELS[domain]), "ratio of harmonic ratios", found, source, SPLIT)


def _separation(config: Config, turns: Turns, cans: list[str], peaked: list[str]) -> Estimate:
    """Estimate the geometric mean of the harmonic ratios of the `peaked` objects over that of the cans, from the mean ratio of each object,
    with a bootstrap over objects.
    """
    logs = (np.log(_positive(rotations.object_means(turns, RATIO, names))) for names in (peaked, cans))
    found = statistics.difference(*logs, config.profile.resamples, config.seed)
    ratios = (np.exp(one) for one in (found.value, found.low, found.high))
    return replace(found, **dict(zip(("value", "low", "high"), map(float, ratios), strict=True)), drawn=np.exp(found.drawn),
                   limits=statistics.POSITIVE, scale=statistics.LOG)  # fmt: skip


def _add_orders(rows: RowList, turns: dict[str, Turns], names: list[str]) -> None:
    """Add rank correlations of the harmonic ratio over objects (pooled and for each distance), and the Mantel test in feature space."""
    clean = [name for name in names if np.mean([turn.localised for turn in rotations.chosen(turns[MEASURED], [name])]) >= 0.5]
    cases: list[tuple[str, list[str], float | None, Claim]] = [("all objects", names, None, ORDER)]
    cases += [("cleanly localised objects", clean, None, CLEAN)]
    cases += [("all objects at one distance", names, distance, NONE) for distance in rotations.distances_m(turns[MEASURED])]
    for label, some, distance, claim in cases:
        here = [name for name in some if distance is None or (name, distance) in turns[MEASURED]]
        if len(here) < 3:
            continue
        first, second = (rotations.object_means(turns[domain], RATIO, here, distance) for domain in COMPARED)
        found = statistics.spearman(first, second, rows.config.seed)
        source = rotations.keys_of_both(turns, here, distance)
        rows.add(_case(label, distance_m=distance), "order of objects", found, source, claim)
    if len(names) > 2:
        first, second = (distance_matrix(turns[domain], names) for domain in COMPARED)
        found = statistics.mantel(first, second, rows.config.seed)
        rows.add(_case("all objects"), "distances between objects", found, rotations.keys_of_both(turns, names), STRUCTURE)


def distance_matrix(turns: Turns, names: list[str]) -> NDArray[np.float64]:
    """Return Euclidean distances (objects, objects) between mean shape features, each scaled to unit standard deviation over objects."""
    from scipy.spatial.distance import pdist, squareform

    values = np.stack([rotations.object_means(turns, feature, names) for feature in SHAPE_FEATURES], axis=1)
    spread = values.std(axis=0)
    return squareform(pdist((values - values.mean(axis=0)) / np.where(spread > 0, spread, 1.0)))


def _add_signatures(rows: RowList, turns: dict[str, Turns], names: list[str], similar: Similarity) -> None:
    for name in names:
        source = rotations.keys_of_both(turns, [name])
        rows.add_mean(_case(catalogue()[name].label), "signature (SSIM)", similar[name, name], source, NONE, statistics.SIGNED)
    own = np.array([similar[name, name].mean() for name in names])
    every = rotations.keys_of_both(turns, names)
    rows.add_mean(_case("all objects"), "signatures", own, every, ALIKE, statistics.SIGNED)
    if len(names) > 1:
        others = np.array([np.mean([similar[name, other].mean() for other in names if other != name]) for name in names])
        rows.add_mean(_case("all objects"), "own signature less others'", own - others, every, OWN)


def _add_distances(rows: RowList, turns: dict[str, Turns], names: list[str]) -> None:
    """Add rows on the variation of the harmonic ratio with distance, for the corner reflector and as a mean over objects.

    The claim is that the harmonic ratio of the corner reflector varies less with distance than the harmonic ratio varies between objects.
    """
    seeds = rows.config.profile.resamples, rows.config.seed
    metric = "variation over distance"
    for domain in COMPARED:
        between = statistics.coefficient_of_variation(_positive(rotations.object_means(turns[domain], RATIO, names)), *seeds).value
        claimed = Claim(_STABLE, "0.07", bound=between, direction=BELOW) if domain == MEASURED else NONE
        for label, (low, high), claim in (("reflector, 0.6-2.1 m", STABLE_M, claimed), ("reflector, all distances", (0.0, np.inf), NONE)):
            values = _over_distance(turns[domain], REFLECTOR, low, high)
            if len(values) > 1:
                found = statistics.coefficient_of_variation(values, *seeds)
                source = [turn.key for turn in rotations.chosen(turns[domain], [REFLECTOR]) if low <= turn.case.distance_m <= high]
                rows.add(_case(label, LABELS[domain]), metric, found, source, claim)
        several = {name: values for name in names if len(values := _over_distance(turns[domain], name)) > 1}
        if several:
            variations = [statistics.coefficient_of_variation(values, *seeds).value for values in several.values()]
            rows.add_mean(
                _case("mean of objects", LABELS[domain]),
                metric,
                variations,
                rotations.keys(turns[domain], list(several)),
                NONE,
                statistics.POSITIVE,
            )


def _over_distance(turns: Turns, name: str, low_m: float = 0.0, high_m: float = np.inf) -> NDArray[np.float64]:
    """Return the harmonic ratio of one object at each distance, as a mean over repetitions."""
    some = [turn for (known, distance), turn in turns.items() if known == name and low_m <= distance <= high_m]
    return _positive(np.array([np.mean([one.values[RATIO] for one in turn]) for turn in some]))


def _positive(values: NDArray) -> NDArray[np.float64]:
    """Raise the values to at least 1e-12, because the harmonic ratio of a round object without noise is exactly zero."""
    return np.maximum(values, 1e-12)


def _ssim_figure(names: list[str], similar: Similarity) -> Figure:
    """Draw the SSIM of each measured object with its own simulation as bars, and with the simulations of other objects as dots."""
    drawing, axes = figure(1, 1, width_in=PAGE_WIDTH_IN * 0.75, height_in=2.8)
    own = np.array([similar[name, name].mean() for name in names])
    place = np.arange(len(names))
    axes.bar(place, own, color=PALETTE[5], label=f"own twin, mean {own.mean():.2f}")
    for i, name in enumerate(names):
        others = [similar[name, other].mean() for other in names if other != name]
        label = "other objects' twins" if i == 0 else None
        axes.plot(np.full(len(others), i), others, ".", ms=5, color="white", mec="black", mew=0.6, label=label)
    axes.axhline(0.76, color=PALETTE[1], lw=1.2, ls="--", label="mean of the paper, 0.76")
    axes.set(ylabel="SSIM of signatures", ylim=(0, 1.05))
    axes.set_xticks(place, [catalogue()[name].label for name in names], rotation=40, ha="right")
    drawing.legend(loc="outside upper center", ncols=3)
    return drawing


def _ranking_figure(turns: dict[str, Turns], names: list[str]) -> Figure:
    """Draw the harmonic ratio of each object, measured and simulated, with its extremes over recordings, sorted by the measured ratio."""
    drawing, axes = figure(1, 1, width_in=PAGE_WIDTH_IN * 0.6, height_in=3.0)
    order = [names[i] for i in np.argsort(rotations.object_means(turns[MEASURED], RATIO, names))]
    place = np.arange(len(order))
    for (domain, (colour, marker)), shift in zip(DOMAIN_STYLES.items(), (0.12, -0.12), strict=True):
        for i, name in enumerate(order):
            values = np.maximum(rotations.samples(turns[domain], RATIO, name), LOWEST_SHOWN)
            axes.plot([values.min(), values.max()], [i + shift] * 2, color=colour, lw=1)
        means = np.maximum(rotations.object_means(turns[domain], RATIO, order), LOWEST_SHOWN)
        axes.plot(means, place + shift, marker, ms=5, color=colour, label=LABELS[domain])
    axes.set_yticks(place, [f"{catalogue()[name].label} ({catalogue()[name].shape})" for name in order])
    axes.set(xscale="log", xlabel=f"angular harmonic ratio ({LOWEST_SHOWN:g}: or less)")
    axes.grid(axis="x", color="0.9", lw=0.5)
    legend_above(drawing, axes, 2)
    return drawing
