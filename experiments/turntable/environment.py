"""Environment ablation: is a simulated range profile closer to the measured range profile if the simulation includes the room?

The first simulation ("void") contains only the object and its stand. The second simulation contains the object and its stand in the scanned
room with the configured materials, by default the labelled materials. The third simulation has the same room of plasterboard. Paper
(environment ablation, 2 m): the correlation with the measured profile is -0.24 in void and +0.42 in the reconstructed scene; about 75 % of
the energy arrives from beyond the target. The module `operating_points` searches for conditions in which these figures occur.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments import draws
from experiments.campaign.campaign import Campaign, joined, make_together
from experiments.campaign.cases import Case
from experiments.campaign.schedule import RecordingTask
from experiments.campaign.source import RecordingSource
from experiments.claims import BELOW, NONE, Claim, RowList
from experiments.drawing import error_bars, range_map
from experiments.statistics import FISHER, SCALES, SHARE, SIGNED
from experiments.turntable import operating_points
from radartwin.config.config import Config
from radartwin.errors import ConfigError
from radartwin.features.log import angles
from radartwin.features.profile import FAR_M, NEAR_M, beyond_target_share, profile_correlation
from radartwin.io.progress import Progress
from radartwin.plotting.style import PAGE_WIDTH_IN, PALETTE, figure
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure

READS = ("distances_m",)  # options experiment.NAME of this experiment
TABLE = Table(
    name="environment",
    title="Effect of the room on the signal",
    caption="A corner reflector on a turntable in a laboratory room. Rows give the Pearson correlation of simulated and measured "
    "mean range profiles, for simulations in void and in the reconstructed room, and the share of energy that arrives from "
    "beyond the target. Rows with a ratio of target to room belong to one operating point: the leg of the reflector, the lobes of the "
    "measuring antennas, and the mean or median of the frames. The column 'at operating point' repeats a row at the point that has the "
    "paper's figures, if there is such a point. Profiles span 0.3 to 5.5 m. Intervals are 95 % percentile bootstraps over the measured "
    "recordings (column items). Column n also counts the simulated recordings.",
)

GAIN = "gain in Fisher's z"
TARGET, ROOM_NAME = "corner_reflector", "lab"
# A side is a kind of recording in this table. For each side: the domain of the campaign, and the materials of the room (None stands for the
# configured materials).
SIDES = {"measured": ("measured", None), "room": ("twin", None), "uniform": ("twin", "uniform"), "void": ("void", None)}
SHOWN = ("measured", "room", "void")  # sides that the range-time figure shows
PAPER_DISTANCE_M = operating_points.DISTANCE_M  # distance for which the paper gives values
ROOM = Claim(paper="+0.42")
# bounds of gains on Fisher's scale, on which a gain of 0.1 asks for as much at every correlation
CLOSER = Claim("the room brings the profile closer to the measured one", "above 0", bound=0.1, null=0.0)
WIDENS = Claim("the gain in correlation increases with distance", "above 0", bound=0.1, null=0.0)
BEYOND = Claim("most of the energy arrives from beyond the target", "about 0.75", bound=0.5)
# the paper says "essentially uncorrelated or weakly anti-correlated"; this claim sets an upper bound on the interval
UNCORRELATED = Claim("without the room the profiles do not correlate", "-0.24", bound=0.1, direction=BELOW)


@dataclass(frozen=True, eq=False)
class Profiles:
    """Range profiles of one recording over range_m (B,): the mean profile (B,), and the power of the first revolution (F, B)."""

    key: str
    mean: np.ndarray
    revolution: np.ndarray
    range_m: np.ndarray


Recordings = Mapping[tuple[str, float], Sequence[Profiles]]  # key: side, distance


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Compute the table for the configured campaign. Raises ConfigError if the configuration sets options that the table does not use."""
    check(config)
    make_together(recordings(config, store, progress), config.jobs, progress)

    result = draws.scored(config, store, progress, lambda campaign: score(config, campaign, progress))
    sources = {True: Campaign(config, store, progress), False: _without_lobes(config, store, progress)}
    return with_points(config, result, operating_points.read(config, sources, progress))


def recordings(config: Config, store: Store, progress: Progress) -> dict[str, RecordingTask]:
    check(config)
    sources = {True: Campaign(config, store, progress), False: _without_lobes(config, store, progress)}
    parts = [sources[True].missing([(SIDES[side][0], case)], SIDES[side][1]) for side, case in wanted(config, sources[True])]
    parts += [sources[lobes].missing(operating_points.wanted(config)) for lobes in operating_points.compared_lobes(config)]
    return joined(parts)


def _without_lobes(config: Config, store: Store, progress: Progress) -> Campaign:
    return Campaign(operating_points.without_lobes(config), store, progress)


def check(config: Config) -> None:
    """Raise ConfigError for options that the table would ignore. The options are checked before any simulation starts."""
    for key, value, used in (
        ("scene", config.scene.name, ROOM_NAME),
        ("scene.target", config.scene.target, TARGET),
        ("trajectory", config.trajectory.kind, "turntable"),
    ):
        if value != used:
            raise ConfigError(f"{key}={value} is not read by experiment=environment, which always has {key}={used}; leave it out")


def score(config: Config, source: RecordingSource, progress: Progress) -> Result:
    """Build the rows for each distance: correlations on the amplitude scale and on the decibel scale, and energy shares.

    Raises:
        ConfigError: the campaign has no turntable recordings of the corner reflector at one of the distances.
    """
    recordings = read(config, source, progress)
    distances = sorted({distance for _, distance in recordings})
    last = distances[-1]
    labels = {side: label for side, label in labels_of(config).items() if (side, last) in recordings}
    rows = RowList(config)
    gains: dict[tuple[str, float], np.ndarray] = {}
    for distance in distances:
        _add_correlations(rows, recordings, distance, labels, gains)
        for side, label in labels.items():
            shares = [beyond_target_share(one.mean, one.range_m, distance) for one in recordings[side, distance]]
            claim = BEYOND if distance == PAPER_DISTANCE_M and side == "measured" else NONE
            case = {"distance_m": distance, "case": label, "scale": "power"}
            rows.add_mean(case, "energy share beyond the target", shares, _keys(recordings, [side], distance), claim, SHARE)
    _add_gain_changes(rows, recordings, gains)
    figures: dict[str, Callable[[], Figure]] = {
        "environment_range_time": lambda: _range_time_figure(
            {side: recordings[side, last][0] for side in SHOWN if side in labels}, last, labels
        ),
        "environment_correlation": lambda: _correlation_figure(rows, distances, labels),
    }  # fmt: skip
    metrics = {
        f"correlation_{side}_{one['scale']}_{last:g}m": one["value"]
        for side, label in labels.items()
        for one in rows
        if one["metric"] == "profile correlation" and one["case"] == label and one["distance_m"] == last
    }
    keys = {one.key for some in recordings.values() for one in some}
    return Result("environment", rows, figures, metrics, sorted(keys))


def labels_of(config: Config) -> dict[str, str]:
    """Return the name of each side (kind of recording) that the table prints."""
    sides = {"measured": f"measured ({config.measured.provider})", "room": f"room ({config.materials.source})"}
    return sides | {"uniform": "room (uniform)", "void": "void"}


def with_points(config: Config, result: Result, points: Sequence[operating_points.Point]) -> Result:
    """Add the rows, the figure and the column of the operating points to the result. Without operating points, it stays the same."""
    if not points:
        return result
    _add_operating_point(result.rows, operating_points.best(points), labels_of(config))
    more = RowList(config)
    operating_points.add_rows(more, points)
    figures = {**result.figures, "environment_operating_points": lambda: operating_points.draw(points)}
    return replace(
        result, rows=[*result.rows, *more], figures=figures, keys=sorted({*result.keys, *(key for one in points for key in one.keys)})
    )


def read(config: Config, source: RecordingSource, progress: Progress) -> Recordings:
    """Read the reflector's recordings: measured, simulated with the room, with the room of plasterboard, and without the room ("void").

    Each of these kinds of recordings must exist at each distance.
    """
    chosen = wanted(config, source)
    found: dict[tuple[str, float], list[Profiles]] = {}
    for side, case in progress.over(chosen, "environment recordings"):
        domain, materials = SIDES[side]
        key, processed = source.processed(domain, case, materials)
        angle = angles(source.log(case, domain), processed.num_frames)
        revolution = processed.power[angle < angle[0] + 2 * np.pi - 1e-9]
        profiles = Profiles(key, processed.power.mean(axis=0, dtype=float), revolution, processed.range_m)
        found.setdefault((side, case.distance_m), []).append(profiles)
    return found


def wanted(config: Config, source: RecordingSource) -> list[tuple[str, Case]]:
    """Return (side, case) of the reflector's recordings at the configured distances (default: all)."""
    left_out = {"void": ("room", "uniform"), "uniform": ("uniform",)}.get(config.materials.source, ())
    sides = [side for side in SIDES if side not in left_out]
    cases = [(side, case) for side in sides for case in source.cases(SIDES[side][0], motion="turntable", room=ROOM_NAME, object=TARGET)]
    recorded = {side: {case.distance_m for other, case in cases if other == side} for side in sides}
    shared = set.intersection(*recorded.values())
    chosen = set(config.experiment.distances_m) or set.union(*recorded.values())
    if missing := sorted(chosen - shared):
        have = ", ".join(f"{distance:g}" for distance in sorted(set.union(*recorded.values()))) or "none"
        raise ConfigError(f"experiment.distances_m: the campaign has no turning {TARGET} at {missing[0]:g} m; it has {have}")
    if not chosen:
        raise ConfigError(
            f"the campaign has no turning {TARGET} that is both measured and simulated; add its distances to profile.campaign"
        )
    return [(side, case) for side, case in cases if case.distance_m in chosen]


def _keys(recordings: Recordings, sides: Sequence[str], *distances: float) -> list[str]:
    return [one.key for distance in distances for side in sides for one in recordings[side, distance]]


def _add_correlations(
    rows: RowList, recordings: Recordings, distance: float, labels: dict[str, str], gains: dict[tuple[str, float], np.ndarray]
) -> None:
    """Add the correlation of the simulated profiles, without and with the room, with the measured profiles on each scale.

    The function also adds the increase of the correlation due to the simulated room, and writes the increase of Fisher's z into `gains`.
    """
    for scale in operating_points.SCALES:
        correlations = {}
        for side, claim in (("void", UNCORRELATED), ("room", ROOM), ("uniform", NONE)):
            if side in labels:
                twin = recordings[side, distance][0]
                correlations[side] = np.array([
                    profile_correlation(twin.mean, one.mean, one.range_m, scale) for one in recordings["measured", distance]
                ])  # fmt: skip
                case = {"distance_m": distance, "case": labels[side], "scale": scale}
                claim = claim if distance == PAPER_DISTANCE_M else NONE
                rows.add_mean(
                    case, "profile correlation", correlations[side], _keys(recordings, ["measured", side], distance), claim, SIGNED, FISHER
                )
        for side, claim in (("room", CLOSER), ("uniform", NONE)):
            if side in labels:
                case = {"distance_m": distance, "case": f"{labels[side]} - void", "scale": scale}
                keys = _keys(recordings, ["measured", side, "void"], distance)
                rows.add_mean(case, "gain in correlation", correlations[side] - correlations["void"], keys, limits=(-2.0, 2.0))
                gain = SCALES[FISHER][0](correlations[side]) - SCALES[FISHER][0](correlations["void"])
                rows.add_mean(case, GAIN, gain, keys, claim)
                if side == "room":
                    gains[scale, distance] = gain


def _add_gain_changes(rows: RowList, recordings: Recordings, gains: Mapping[tuple[str, float], np.ndarray]) -> None:
    """Add the gain of Fisher's z due to the room at the largest distance minus that at the smallest distance, if the distances differ."""
    distances = [distance for _, distance in gains]
    if not gains or min(distances) == max(distances):
        return
    near, far = min(distances), max(distances)
    for scale in operating_points.SCALES:
        count = min(len(gains[scale, near]), len(gains[scale, far]))
        change = gains[scale, far][:count] - gains[scale, near][:count]
        case = {"distance_m": far, "case": f"gain at {far:g} m - at {near:g} m", "scale": scale}
        rows.add_mean(case, "change of gain", change, _keys(recordings, ["measured", "room", "void"], near, far), WIDENS)


def _add_operating_point(rows: Sequence[dict[str, Any]], best: operating_points.Point | None, labels: dict[str, str]) -> None:
    """Add the column "at_operating_point" to all rows. If the operating point with the paper's figures gives the quantity of a row, the
    column has the mean at this point, otherwise None.
    """
    for row in rows:
        row["at_operating_point"] = None
        if best and row["distance_m"] == PAPER_DISTANCE_M and row["scale"] in (best.scale, "power"):
            names = {("energy share beyond the target", labels["measured"]): "share"}
            names |= {("profile correlation", labels[side]): side for side in ("void", "room")}
            name = names.get((row["metric"], row["case"]))
            row["at_operating_point"] = float(best.values[name].mean()) if name else None


def _range_time_figure(shown: dict[str, Profiles], distance: float, labels: dict[str, str]) -> Figure:
    """Draw power over turntable angle and range at one distance, as maps with one colour scale. The measured map comes first."""
    drawing, panels = figure(1, len(shown), width_in=PAGE_WIDTH_IN, height_in=2.8, sharey=True, sharex=True)
    axis = shown["measured"].range_m
    inside = (axis >= NEAR_M) & (axis <= FAR_M)
    top = max(10 * np.log10(one.revolution[:, inside].max()) for one in shown.values())
    for panel, (side, one) in zip(panels, shown.items(), strict=True):
        level = 10 * np.log10(np.maximum(one.revolution[:, inside], 1e-30))
        range_map(panel, level, (0, 360, float(axis[inside][0]), float(axis[inside][-1])), top, 70)
        panel.set(title=labels[side], xlabel="turntable angle (deg)", xticks=[0, 90, 180, 270, 360])
    line = {"arrowstyle": "-", "color": "white"}
    panels[0].annotate("reflector", (15, distance), (25, distance - 0.6), color="white", fontsize=7, arrowprops=line)
    panels[0].set_ylabel("range (m)")
    drawing.colorbar(panels[0].images[0], ax=panels, label="received / transmitted power (dB)", pad=0.01)
    return drawing


def _correlation_figure(rows: Sequence[dict[str, Any]], distances: list[float], labels: dict[str, str]) -> Figure:
    """Draw the correlation of simulated with measured profiles against distance, with one panel for each scale (amplitude, decibels)."""
    drawing, panels = figure(1, len(operating_points.SCALES), width_in=PAGE_WIDTH_IN, height_in=2.6, sharey=True)
    styles = {"void": (PALETTE[1], "s"), "room": (PALETTE[0], "o"), "uniform": (PALETTE[2], "^")}
    found = {(r["case"], r["scale"], r["distance_m"]): r for r in rows if r["metric"] == "profile correlation"}
    for panel, scale in zip(panels, operating_points.SCALES, strict=True):
        for side, label in labels.items():
            if side != "measured":
                value, errors = error_bars(found[label, scale, distance] for distance in distances)
                colour, marker = styles[side]
                panel.errorbar(distances, value, yerr=errors, color=colour, marker=marker, ms=4, capsize=2, label=label)
        panel.axhline(0, color="0.6", lw=0.6)
        panel.set(title=f"profiles in {operating_points.SCALES[scale]}", xlabel="distance of the reflector (m)", ylim=(-0.5, 1.05))
    panels[0].set_ylabel("correlation with measured profile")
    panels[0].legend(loc="lower left")
    return drawing
