"""Environment ablation: is a simulated range profile closer to the measured range profile if the simulation includes the room?

Object and stand are simulated alone ("void"), in the scanned room with the configured materials (by default the labelled ones), and in the
same room of plasterboard. Paper (environment ablation, 2 m): the correlation with the measured profile is -0.24 in void and +0.42 in the
reconstructed scene; about 75 % of the energy arrives from beyond the target. `operating_points` searches for conditions in which these
figures occur.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from experiments.campaign.campaign import Campaign, joined, make_together
from experiments.campaign.cases import MEASURED, TWIN, VOID, Case
from experiments.campaign.frame import Frame, RecordingSource, stored
from experiments.campaign.schedule import RecordingTask
from experiments.cells import Cell, first_draw, keys, mean, table_rows
from experiments.drawing import PAGE_WIDTH_IN, PALETTE, Figure, error_bars, figure, range_map
from experiments.interface import Config, Progress, Result, Store, Table
from experiments.statistics import FISHER, SCALES, SHARE, SIGNED, ms_ssim
from experiments.turntable import operating_points
from experiments.verdicts import BELOW, NONE, Claim, RowList, within
from radartwin.config.materials import UniformMaterials
from radartwin.errors import ConfigError
from radartwin.features.profile import FAR_M, NEAR_M, beyond_target_share, profile_correlation

READS = ("distances_m",)  # options experiment.NAME of this experiment
TABLE = Table(
    name="environment",
    title="Effect of the room on the signal",
    caption="A corner reflector on a turntable in a laboratory room. Rows give the Pearson correlation of simulated and measured "
    "mean range profiles, for simulations in void and in the reconstructed room, and the share of energy that arrives from "
    "beyond the target. Rows with a ratio of target to room belong to one of the operating points nearest to the paper's figures: the leg "
    "of the reflector, the lobes of the measuring antennas, the energy of unscanned echoes over that of the room, and average, window and "
    "scale of the profiles. The column 'at operating point' repeats a row at the point that has the "
    "paper's figures, if there is such a point. Profiles span 0.3 to 5.5 m. Intervals are 95 % percentile bootstraps over the measured "
    "recordings (column items). Column n also counts the simulated recordings. Two similarities compare the first frames: that of the "
    "range-azimuth maps (MS-SSIM of levels in dB), and that of the complex signals of all channels.",
)

TARGET, ROOM_NAME = "corner_reflector", "lab"
# A side is a kind of recording in this table. For each side: the domain of its campaign (see `sources`).
SIDES = {"measured": MEASURED, "room": TWIN, "uniform": TWIN, "void": VOID}
SHOWN = ("measured", "room", "void")  # sides that the range-time figure shows
PAPER_DISTANCE_M = operating_points.DISTANCE_M  # distance for which the paper gives values
ROOM = Claim(paper="+0.42")
# bounds of gains on Fisher's scale, on which a gain of 0.1 asks for as much at every correlation
CLOSER = Claim("the room brings the profile closer to the measured one", "above 0", bound=0.1, null=0.0)
WIDENS = Claim("the gain in correlation increases with distance", "above 0", bound=0.1, null=0.0)
BEYOND = Claim("most of the energy arrives from beyond the target", "about 0.75", bound=0.5)
# the paper says that four bounces suffice to reproduce the measured share; a difference of a tenth of the energy counts
ENOUGH = within("four bounces reproduce the energy share beyond the target", -0.1, 0.1)
# the paper says "essentially uncorrelated or weakly anti-correlated"; this claim sets an upper bound on the interval
UNCORRELATED = Claim("without the room the profiles do not correlate", "-0.24", bound=0.1, direction=BELOW)
GAIN = "gain in Fisher's z"
CORRELATED = {"void": UNCORRELATED, "room": ROOM}


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Compute the table for the configured campaign. Raises ConfigError if the configuration sets options that the table does not use."""
    make_together(recordings(config, store, progress), config.jobs, progress)
    wanted_cases = operating_points.wanted(config)
    result = score(config, read(config, sources(Campaign(config, store, progress)), partial(stored, progress=progress)))
    points = {
        condition: stored(Campaign(condition.of(config), store, progress), wanted_cases, progress)
        for condition in operating_points.conditions(config)
    }
    return with_points(config, result, operating_points.read(config, points))


def recordings(config: Config, store: Store, progress: Progress) -> dict[str, RecordingTask]:
    check(config)
    campaigns, wanted_cases = sources(Campaign(config, store, progress)), operating_points.wanted(config)
    parts = [campaigns[side].missing([(SIDES[side], case)]) for side, case in wanted(config, campaigns)]
    parts += [Campaign(condition.of(config), store, progress).missing(wanted_cases) for condition in operating_points.conditions(config)]
    return joined(parts)


def sources(usual: Campaign) -> dict[str, Campaign]:
    """Return the campaign of each side. The simulated room of the side `uniform` is of plasterboard."""
    return dict.fromkeys(SIDES, usual) | {"uniform": usual.with_materials(UniformMaterials())}


def check(config: Config) -> None:
    """Raise ConfigError for options that the table would ignore. The options are checked before any simulation starts."""
    for key, value, fixed in (
        ("scene", config.scene.name, ROOM_NAME),
        ("scene.target", config.scene.target, TARGET),
        ("trajectory", config.trajectory.kind, "turntable"),
    ):
        if value != fixed:
            raise ConfigError(f"{key}={value} is not read by experiment=environment, which always has {key}={fixed}; leave it out")


def score(config: Config, frame: Frame) -> Result:
    """Build the rows for each distance: correlations on the amplitude scale and on the decibel scale, and energy shares."""
    distances, first = sorted(frame.distance_m.unique()), first_draw(frame)
    last, labels = distances[-1], {side: label for side, label in labels_of(config).items() if side in set(frame.side)}
    rows = table_rows(config, frame, partial(cells, labels))
    side_recordings = {
        side: next(first[(first.side == side) & (first.distance_m == last)].itertuples()) for side in SHOWN if side in labels
    }
    figures: dict[str, Callable[[], Figure]] = {
        "environment_range_time": lambda: _range_time_figure(side_recordings, last, labels),
        "environment_correlation": lambda: _correlation_figure(rows, distances, labels),
    }
    metrics = {
        f"correlation_{side}_{row['scale']}_{last:g}m": row["value"]
        for side, label in labels.items()
        for row in rows
        if row["metric"] == "profile correlation" and row["case"] == label and row["distance_m"] == last
    }
    return Result(TABLE.name, rows, figures, metrics, keys(frame))


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
        result, rows=[*result.rows, *more], figures=figures, keys=sorted({*result.keys, *(key for point in points for key in point.keys)})
    )


def read(config: Config, campaigns: Mapping[str, RecordingSource], read: Callable[..., Frame]) -> Frame:
    """Read the reflector's recordings with their side: measured, simulated with the room, with the room of plasterboard, and in void."""
    pairs = wanted(config, campaigns)
    parts = []
    for side, domain in SIDES.items():
        if cases := [(domain, case) for other, case in pairs if other == side]:
            parts.append(read(campaigns[side], cases).assign(side=side))
    return pd.concat(parts, ignore_index=True)


def wanted(config: Config, campaigns: Mapping[str, RecordingSource]) -> list[tuple[str, Case]]:
    """Return (side, case) of the reflector's recordings at the configured distances (default: all)."""
    left_out = {"void": ("room", "uniform"), "uniform": ("uniform",)}.get(config.materials.source, ())
    sides = [side for side in SIDES if side not in left_out]
    turntable = {"motion": "turntable", "room": ROOM_NAME, "object": TARGET}
    cases = [(side, case) for side in sides for case in campaigns[side].cases(SIDES[side], **turntable)]
    recorded = {side: {case.distance_m for other, case in cases if other == side} for side in sides}
    shared = set.intersection(*recorded.values())
    distances_m = set(config.experiment.distances_m) or set.union(*recorded.values())
    if missing := sorted(distances_m - shared):
        have = ", ".join(f"{distance:g}" for distance in sorted(set.union(*recorded.values()))) or "none"
        raise ConfigError(f"experiment.distances_m: the campaign has no turning {TARGET} at {missing[0]:g} m; it has {have}")
    if not distances_m:
        raise ConfigError(
            f"the campaign has no turning {TARGET} that is both measured and simulated; add its distances to profile.campaign"
        )
    return [(side, case) for side, case in cases if case.distance_m in distances_m]


def cells(labels: Mapping[str, str], frame: Frame) -> Iterator[Cell]:
    """Declare correlations without and with the room on each scale, their gain and its change with distance, and energy shares."""
    gains: dict[tuple[str, float], NDArray] = {}
    for distance, here in frame.groupby("distance_m"):
        at, range_m = {"distance_m": distance}, here.range_m.iloc[0]
        at_paper = distance == PAPER_DISTANCE_M
        for scale in operating_points.SCALES:
            mean_powers = {side: list(here.mean_power[here.side == side]) for side in labels}
            correlations = {
                side: np.array([profile_correlation(mean_powers[side][0], power, range_m, scale) for power in mean_powers["measured"]])
                for side in ("void", "room", "uniform")
                if side in labels
            }
            for side, values in correlations.items():
                of, claim = here[here.side.isin(["measured", side])], CORRELATED.get(side, NONE) if at_paper else NONE
                yield Cell({**at, "case": labels[side], "scale": scale}, "profile correlation", of, mean(values, SIGNED, FISHER), claim)
            for side in [side for side in correlations if side != "void"]:
                of = here[here.side.isin(["measured", side, "void"])]
                case = {**at, "case": f"{labels[side]} - void", "scale": scale}
                yield Cell(case, "gain in correlation", of, mean(correlations[side] - correlations["void"], (-2.0, 2.0)))
                gain = SCALES[FISHER][0](correlations[side]) - SCALES[FISHER][0](correlations["void"])
                yield Cell(case, GAIN, of, mean(gain), CLOSER if side == "room" else NONE)
                if side == "room":
                    gains[scale, distance] = gain
        shares = {
            side: np.array([beyond_target_share(row.mean_power, row.range_m, distance) for row in here[here.side == side].itertuples()])
            for side in labels
        }
        for side, label in labels.items():
            case, claim = {**at, "case": label, "scale": "power"}, BEYOND if at_paper and side == "measured" else NONE
            yield Cell(case, "energy share beyond the target", here[here.side == side], mean(shares[side], SHARE), claim)
        for side in correlations:
            of, case = here[here.side.isin(["measured", side])], {**at, "case": f"{labels[side]} - {labels['measured']}", "scale": "power"}
            if side == "room" and at_paper:
                less = shares[side].mean() - shares["measured"]
                yield Cell(case, "energy share beyond the target, simulated less measured", of, mean(less, SIGNED), ENOUGH)
            structure, signal = similarities(of, side)
            case = {**at, "case": labels[side]}
            yield Cell({**case, "scale": "db"}, "similarity of range-azimuth maps (MS-SSIM)", of, mean(structure, SHARE))
            yield Cell({**case, "scale": "complex"}, "complex similarity", of, mean(signal, SHARE))
    near, far = frame.distance_m.min(), frame.distance_m.max()
    if gains and near < far:
        of = frame[frame.side.isin(["measured", "room", "void"]) & frame.distance_m.isin([near, far])]
        for scale in operating_points.SCALES:
            count = min(len(gains[scale, near]), len(gains[scale, far]))
            change = gains[scale, far][:count] - gains[scale, near][:count]
            case = {"distance_m": far, "case": f"gain at {far:g} m - at {near:g} m", "scale": scale}
            yield Cell(case, "change of gain", of, mean(change), WIDENS)


def similarities(here: Frame, side: str) -> tuple[list[float], list[float]]:
    """Return two similarities (0 to 1) of the first frame of each measured recording to that of a side, over the ranges of the profiles:
    the MS-SSIM of the range-azimuth maps in dB, and |<a, b>| / (|a| |b|) of the channel signals, without gain and phase.
    """

    def first(recording: Any) -> tuple[NDArray, NDArray]:
        inside = (recording.range_m >= NEAR_M) & (recording.range_m <= FAR_M)
        power, signal = recording.azimuth_map[0][inside], recording.first_frame[0][:, inside]
        return np.clip(1 + np.log10(np.maximum(power / power.max(), 1e-30)) / 6, 0, 1), signal / np.linalg.norm(signal)

    (twin_map, twin_signal), measured = first(next(here[here.side == side].itertuples())), here[here.side == "measured"]
    pairs = [first(recording) for recording in measured.itertuples()]
    return [ms_ssim(twin_map, power) for power, _ in pairs], [float(abs(np.vdot(twin_signal, signal))) for _, signal in pairs]


def _add_operating_point(rows: Sequence[dict[str, Any]], best: operating_points.Point | None, labels: dict[str, str]) -> None:
    """Add the column "at_operating_point" to all rows: the mean at the point with the paper's figures, where it has the quantity."""
    for row in rows:
        row["at_operating_point"] = None
        if best and row["distance_m"] == PAPER_DISTANCE_M and row["scale"] in (best.scale, "power"):
            names = {("energy share beyond the target", labels["measured"]): "share"}
            names |= {("profile correlation", labels[side]): side for side in ("void", "room")}
            name = names.get((row["metric"], row["case"]))
            row["at_operating_point"] = float(best.values[name].mean()) if name else None


def _range_time_figure(side_recordings: Mapping[str, Any], distance: float, labels: dict[str, str]) -> Figure:
    """Draw power over turntable angle and range at one distance, as maps with one colour scale. The measured map comes first."""
    drawing, panels = figure(1, len(side_recordings), width_in=PAGE_WIDTH_IN, height_in=2.8, sharey=True, sharex=True)
    axis = side_recordings["measured"].range_m
    inside = (axis >= NEAR_M) & (axis <= FAR_M)
    top = max(10 * np.log10(recording.revolution[:, inside].max()) for recording in side_recordings.values())
    for panel, (side, recording) in zip(panels, side_recordings.items(), strict=True):
        level = 10 * np.log10(np.maximum(recording.revolution[:, inside], 1e-30))
        range_map(panel, level, (0, 360, float(axis[inside][0]), float(axis[inside][-1])), top, 70)
        panel.set(title=labels[side], xlabel="turntable angle (deg)", xticks=[0, 90, 180, 270, 360])
    line = {"arrowstyle": "-", "color": "white"}
    panels[0].annotate("reflector", (15, distance), (25, distance - 0.6), color="white", arrowprops=line)
    panels[0].set_ylabel("range (m)")
    drawing.colorbar(panels[0].images[0], ax=panels, label="received / transmitted power (dB)", pad=0.01)
    return drawing


def _correlation_figure(rows: Sequence[dict[str, Any]], distances: list[float], labels: dict[str, str]) -> Figure:
    """Draw the correlation of simulated with measured profiles against distance, with one panel for each scale (amplitude, decibels)."""
    drawing, panels = figure(1, len(operating_points.SCALES), width_in=PAGE_WIDTH_IN, height_in=2.6, sharey=True)
    styles = {"void": (PALETTE[1], "s"), "room": (PALETTE[0], "o"), "uniform": (PALETTE[2], "^")}
    row_of = {(r["case"], r["scale"], r["distance_m"]): r for r in rows if r["metric"] == "profile correlation"}
    for panel, scale in zip(panels, operating_points.SCALES, strict=True):
        for side, label in labels.items():
            if side != "measured":
                value, errors = error_bars(row_of[label, scale, distance] for distance in distances)
                colour, marker = styles[side]
                panel.errorbar(distances, value, yerr=errors, color=colour, marker=marker, ms=4, capsize=2, label=label)
        panel.axhline(0, color="0.6", lw=0.6)
        panel.set(title=f"profiles in {operating_points.SCALES[scale]}", xlabel="distance of the reflector (m)", ylim=(-0.5, 1.05))
    panels[0].set_ylabel("correlation with measured profile")
    panels[0].legend(loc="lower left")
    return drawing
