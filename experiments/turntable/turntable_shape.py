"""Shape: do objects differ in the modulation of their echo over a revolution in the same way in simulation and measurement?

The table compares the harmonic ratio of each object (power of harmonics 1 to 6 over harmonic 0) and its order over objects, the distances
between objects in the space of all rotation features except brightness (Mantel test), and the range-Doppler signatures (SSIM), and gives
the change of the reflector's ratio with distance. An object is cleanly localised if its strongest echo lies in the target gate in half of
its measured recordings or more; the paper gives no criterion.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from experiments import statistics
from experiments.campaign.cases import COMPARED, LABELS, MEASURED, REFLECTOR, TWIN
from experiments.campaign.frame import Column, Frame
from experiments.cells import Cell, joined_rows, mantel, mean, paired, per, rank_correlation, using
from experiments.drawing import DOMAIN_STYLES, PAGE_WIDTH_IN, PALETTE, Figure, figure, legend_above
from experiments.framed import framed
from experiments.interface import Config, Progress, Result, Store, Table
from experiments.statistics import Estimate
from experiments.turntable.facet_ripple import ripple_rows
from experiments.verdicts import BELOW, NONE, Claim
from radartwin.errors import InputError
from radartwin.scene.objects.catalogue import catalogue

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

MOTIONS = ("turntable",)
RATIO = "harmonic_ratio"
SHAPE_FEATURES = (RATIO, *(f"harmonic_{m}" for m in range(1, 7)), "crest_factor", "entropy", "azimuth_extent_rad")
LOWEST = 1e-12  # the harmonic ratio of a round object without noise is exactly zero
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


def cells(config: Config, frame: Frame) -> Iterator[Cell]:
    """Declare the cells of one draw. Raises InputError if the recordings differ in the number of frames per revolution."""
    if len(frames := sorted({len(signature) for signature in frame.signature})) > 1:
        raise InputError(
            f"revolutions of {' and '.join(map(str, frames))} frames cannot be compared; record all turntables at one frame rate and period"
        )
    yield from _ratios(frame)
    yield from _orders(frame)
    yield from _signatures(frame)
    yield from _distances(frame)


def _case(label: str, of: str = "both", distance_m: float | None = None) -> dict[str, str | float | None]:
    return {"case": label, "distance_m": distance_m, "of": of}


def _ratios(frame: Frame) -> Iterator[Cell]:
    """Declare the harmonic ratio of each object and domain, and the factor between objects that are not round (peaked) and the cans."""
    can, peaked = frame.object.map(is_can), frame["shape"] != "symmetric"
    for domain in COMPARED:
        of = frame[frame.domain == domain]
        for name, rows in of.groupby("object", sort=False):
            paper = ("0.03-0.18" if can[rows.index[0]] else "0.72-2.5" if peaked[rows.index[0]] else "") if domain == MEASURED else ""
            case = _case(catalogue()[name].label, LABELS[domain])
            yield Cell(case, "angular harmonic ratio", rows, mean(RATIO, statistics.POSITIVE), Claim(paper=paper))
        if can.any() and peaked.any():
            case = _case("peaked over cans", LABELS[domain])
            yield Cell(case, "ratio of harmonic ratios", of[(can | peaked)[of.index]], _separation, SPLIT)


def _separation(rows: Frame, resamples: int, seed: int) -> Estimate:
    """Estimate the geometric mean of the harmonic ratios of peaked objects over that of the cans, with a bootstrap over objects."""
    logs = np.log(per(RATIO)(rows).clip(lower=LOWEST))
    cans = logs.index.map(is_can)
    estimate = statistics.difference(logs[~cans].to_numpy(), logs[cans].to_numpy(), resamples, seed)
    assert estimate.drawn is not None
    ratios = (np.exp(log_ratio) for log_ratio in (estimate.value, estimate.low, estimate.high))
    return replace(estimate, **dict(zip(("value", "low", "high"), map(float, ratios), strict=True)), drawn=np.exp(estimate.drawn),
                   limits=statistics.POSITIVE, scale=statistics.LOG)  # fmt: skip


def _orders(frame: Frame) -> Iterator[Cell]:
    """Declare rank correlations of the harmonic ratio over objects (pooled and for each distance), and the Mantel test in feature space."""
    localised = frame[frame.domain == MEASURED].groupby("object").localised.mean()
    clean = frame[frame.object.isin(localised.index[localised >= 0.5])]
    cases = [("all objects", None, frame, ORDER), ("cleanly localised objects", None, clean, CLEAN)]
    cases += [("all objects at one distance", distance, here, NONE) for distance, here in frame.groupby("distance_m")]
    order = rank_correlation(per(RATIO, MEASURED), per(RATIO, TWIN))
    for label, distance, rows, claim in cases:
        if rows.object.nunique() > 2:
            yield Cell(_case(label, distance_m=distance), "order of objects", rows, order, claim)
    if frame.object.nunique() > 2:
        yield Cell(_case("all objects"), "distances between objects", frame, mantel(SHAPE_FEATURES), STRUCTURE)


def is_can(name: str) -> bool:
    """Return whether an object is one of the six cans that differ only in height."""
    return "can_" in name


def similarity(frame: Frame) -> Frame:
    """Return `paired` recordings at equal distance, with the SSIM of their signatures in the column `ssim`."""
    pairs = paired(frame[["domain", "object", "distance_m", "signature"]], ["distance_m"])
    return pairs.assign(ssim=[statistics.ssim(*both) for both in zip(pairs.signature, pairs.signature_twin, strict=True)])


def own_and_others(similar: Frame) -> tuple[Column, Frame]:
    """Return the mean SSIM of each object with its own simulation, and with those of others (objects, objects; NaN for itself)."""
    means = similar.groupby(["object", "object_twin"], sort=False).ssim.mean().unstack().reindex(similar.object.unique())
    itself = means.index.to_numpy()[:, None] == means.columns.to_numpy()
    return means.where(itself).max(axis=1), means.mask(itself)


def _signatures(frame: Frame) -> Iterator[Cell]:
    similar = similarity(frame)
    for name, rows in frame.groupby("object", sort=False):
        own_ssim = similar.ssim[(similar.object == name) & (similar.object_twin == name)].to_numpy()
        yield Cell(_case(catalogue()[name].label), "signature (SSIM)", rows, mean(own_ssim, statistics.SIGNED))
    own_ssim, others = own_and_others(similar)
    yield Cell(_case("all objects"), "signatures", frame, mean(own_ssim, statistics.SIGNED), ALIKE)
    if len(own_ssim) > 1:
        yield Cell(_case("all objects"), "own signature less others'", frame, mean(own_ssim - others.mean(axis=1)), OWN)


def _distances(frame: Frame) -> Iterator[Cell]:
    """Declare the variation of the ratio with distance, of the reflector (claimed to be below that between objects) and of objects."""
    metric = "variation over distance"
    for domain in COMPARED:
        of = frame[frame.domain == domain]
        ratios = of.groupby(["object", "distance_m"], sort=False)[RATIO].mean().clip(lower=LOWEST).unstack().reindex(of.object.unique())
        objects, spread = ratios.mean(axis=1), (ratios.std(axis=1) / ratios.mean(axis=1)).dropna()
        claimed = Claim(_STABLE, "0.07", bound=float(objects.std() / objects.mean()), direction=BELOW) if domain == MEASURED else NONE
        for label, (low, high), claim in (("reflector, 0.6-2.1 m", STABLE_M, claimed), ("reflector, all distances", (0.0, np.inf), NONE)):
            rows = of[(of.object == REFLECTOR) & of.distance_m.between(low, high)]
            if rows.distance_m.nunique() > 1:
                values = ratios.loc[REFLECTOR, rows.distance_m.unique()]
                yield Cell(_case(label, LABELS[domain]), metric, rows, using(statistics.coefficient_of_variation, values), claim)
        if len(spread):
            rows = of[of.object.isin(spread.index)]
            yield Cell(_case("mean of objects", LABELS[domain]), metric, rows, mean(spread, statistics.POSITIVE))


def _ssim_figure(similar: Frame) -> Figure:
    """Draw the SSIM of each measured object with its own simulation as bars, and with the simulations of other objects as dots."""
    drawing, axes = figure(1, 1, width_in=PAGE_WIDTH_IN * 0.75, height_in=2.8)
    own_ssim, others = own_and_others(similar)
    place = np.arange(len(own_ssim))
    axes.bar(place, own_ssim, color=PALETTE[5], label=f"own twin, mean {own_ssim.mean():.2f}")
    for i, values in enumerate(others.to_numpy()):
        label = "other objects' twins" if i == 0 else None
        axes.plot(np.full(len(values), i), values, ".", ms=5, color="white", mec="black", mew=0.6, label=label)
    axes.axhline(0.76, color=PALETTE[1], lw=1.2, ls="--", label="mean of the paper, 0.76")
    axes.set(ylabel="SSIM of signatures", ylim=(0, 1.05))
    axes.set_xticks(place, [catalogue()[name].label for name in own_ssim.index], rotation=40, ha="right")
    drawing.legend(loc="outside upper center", ncols=3)
    return drawing


def _ranking_figure(frame: Frame) -> Figure:
    """Draw the harmonic ratio of each object, measured and simulated, with its extremes over recordings, sorted by the measured ratio."""
    drawing, axes = figure(1, 1, width_in=PAGE_WIDTH_IN * 0.6, height_in=3.0)
    order = per(RATIO, MEASURED)(frame).sort_values().index
    place = np.arange(len(order))
    for (domain, (colour, marker)), shift in zip(DOMAIN_STYLES.items(), (0.12, -0.12), strict=True):
        of = frame[frame.domain == domain]
        span = of.groupby("object")[RATIO].agg(["min", "max"]).clip(lower=LOWEST_SHOWN)
        for i, name in enumerate(order):
            axes.plot(span.loc[name], [i + shift] * 2, color=colour, lw=1)
        means = per(RATIO)(of)[order].clip(lower=LOWEST_SHOWN)
        axes.plot(means, place + shift, marker, ms=5, color=colour, label=LABELS[domain])
    axes.set_yticks(place, [f"{catalogue()[name].label} ({catalogue()[name].shape})" for name in order])
    axes.set(xscale="log", xlabel=f"angular harmonic ratio (at least {LOWEST_SHOWN:g})")
    axes.grid(axis="x", color="0.9", lw=0.5)
    legend_above(drawing, axes, 2)
    return drawing


ALL = "all objects"
METRICS = {
    "spearman": {"metric": "order of objects", "case": ALL},
    "mantel_r": {"metric": "distances between objects", "case": ALL},
    "ssim_mean": {"metric": "signatures", "case": ALL},
}
FIGURES = {"turntable_ssim": lambda first: _ssim_figure(similarity(first)), "turntable_ranking": _ranking_figure}
_run, recordings, score = framed(TABLE, {"motions": MOTIONS}, cells, FIGURES, METRICS)


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Compute the table, with the rows of the module facet_ripple."""
    result = _run(config, store, progress)
    return replace(result, rows=[*result.rows, *joined_rows([ripple_rows(config)])])
