"""Operating points: where do the paper's figures of the environment ablation occur together, if the target is weaker or stronger?

In the paper, at 2 m, about 75 % of the energy lies beyond the target. The correlation with the measured range profile is -0.24 without the
room (void) and +0.42 with the room. In the virtual measurements, a smaller share of the energy lies beyond the target. An operating point
is a choice of three conditions that change the ratio of target to room. The first is the leg of the corner reflector, whose echo grows with
the fourth power of the leg. The second is whether the measuring antennas have side and back lobes. The third is whether the power is the
mean or the median over the frames. Measurement and both simulations contain the reflector of this leg.

The ratio of target to room is the energy in the target gate over the energy behind the gate, in the measured profile. Placement, start
angle and person are drawn anew for every recording, so that the ratio does not depend on the leg alone. The acceptance limits `LIMITS` were
written before the first score. A point is accepted on a scale (amplitude or decibels) if the means of all three figures over the recordings
are inside the limits. Both correlations are computed on this scale.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from experiments import statistics
from experiments.campaign.cases import BENCH_ROOM, MEASURED, REFLECTOR, TWIN, VOID, Case, draws
from experiments.campaign.frame import Frame
from experiments.claims import Claim, RowList
from experiments.drawing import legend_above
from radartwin.config.config import Config
from radartwin.features.profile import beyond_target_share, gate_energies, profile_correlation
from radartwin.plotting.style import PAGE_WIDTH_IN, PALETTE, figure
from radartwin.scene.objects.catalogue import OTHER_LEGS_M, REFLECTOR_LEG_M

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DISTANCE_M = 2.0
DRAWS = 3  # largest number of measured recordings at each leg, each from another draw of the campaign
LEGS_M = {"quick": (0.05, 0.07, REFLECTOR_LEG_M, 0.12), "paper": tuple(sorted((*OTHER_LEGS_M, REFLECTOR_LEG_M)))}
LOBES = {"quick": (True,), "paper": (True, False)}  # with and without the antennas' side and back lobes
STATISTICS = {"mean": "mean_power", "median": "median_power"}  # column of the frame with the power of the range bins
SCALES = {"amplitude": "amplitude", "db": "decibels"}
FIGURES = ("share", VOID, "room")
PAPER = {"share": 0.75, VOID: -0.24, "room": 0.42}
# Acceptance limits. The paper gives the share as "about 75 %", and calls the profile in void "essentially uncorrelated or weakly
# anti-correlated". The limits of the room's correlation are 0.42 plus and minus 0.22 to 0.23, so that they exclude both "uncorrelated"
# and the correlations above 0.8 of the campaign's own reflector.
LIMITS = {"share": (0.65, 0.85), VOID: (-1.0, 0.1), "room": (0.20, 0.65)}
TOGETHER = Claim("the paper's three figures occur together at an operating point", "0.75, -0.24, +0.42", bound=0.5, null=0.0, least=1)


@dataclass(frozen=True, eq=False)
class Point:
    """The figures of one operating point on one scale, for each of N measured recordings.

    Attributes:
        leg_m: leg of the corner reflector in metres.
        lobes: whether the measuring antennas have side and back lobes.
        statistic: "mean" or "median" of the power over frames.
        scale: scale of the correlations, "amplitude" or "db".
        ratio_db: energy of the target over the energy beyond it, in decibels.
        values: {"share", "void", "room"}: (N,) energy share beyond the target, and correlations with the measured profile.
        keys: store keys of the recordings.
    """

    leg_m: float
    lobes: bool
    statistic: str
    scale: str
    ratio_db: float
    values: Mapping[str, np.ndarray]
    keys: Sequence[str]

    @property
    def name(self) -> str:
        return f"leg {100 * self.leg_m:g} cm, {'with' if self.lobes else 'no'} lobes, {self.statistic} of frames"

    @property
    def accepted(self) -> bool:
        return all(low <= float(np.mean(self.values[name])) <= high for name, (low, high) in LIMITS.items())

    @property
    def departure(self) -> float:
        """Root mean square, over the three figures, of (mean - paper's figure) / (upper limit - paper's figure)."""
        parts = [(np.mean(self.values[name]) - PAPER[name]) / (LIMITS[name][1] - PAPER[name]) for name in FIGURES]
        return float(np.sqrt(np.mean(np.square(parts))))


def without_lobes(config: Config) -> Config:
    """Return the configuration whose measuring antennas have the nominal pattern."""
    measured = config.measured
    return replace(config, measured=replace(measured, gap=replace(measured.gap, antenna=0.0)))


def compared_lobes(config: Config) -> tuple[bool, ...]:
    """Return the antennas that the table compares: True for antennas with side and back lobes, False for antennas without.

    The result is empty if the table has no operating points. The table has operating points if the testbed measures at the paper's distance
    and the simulation has a room.
    """
    chosen = config.experiment.distances_m
    if config.measured.provider != "testbed" or config.materials.source == VOID or (chosen and DISTANCE_M not in chosen):
        return ()
    return tuple(one for one in LOBES.get(config.profile.name, ()) if config.measured.gap.antenna or not one)


def wanted(config: Config) -> list[tuple[str, Case]]:
    """Return (domain, case) of all recordings that the operating points of one antenna read."""
    return [one for leg in LEGS_M[config.profile.name] for one in _recordings(config, leg)]


def _reflector(leg_m: float) -> str:
    return REFLECTOR if leg_m == REFLECTOR_LEG_M else f"{REFLECTOR}_{100 * leg_m:g}cm"


def _recordings(config: Config, leg_m: float) -> list[tuple[str, Case]]:
    first = Case(_reflector(leg_m), BENCH_ROOM, "turntable", DISTANCE_M)
    measured = draws(config.profile.campaign, False)[:DRAWS] if config.measured.draw is None else [config.measured.draw]
    return [*((MEASURED, replace(first, draw=k)) for k in measured), (TWIN, first), (VOID, first)]


def read(config: Config, frames: Mapping[bool, Frame]) -> list[Point]:
    """Compute the figures of all operating points.

    Args:
        frames: recordings with (True) and without (False) the side and back lobes of the measuring antennas. The points of an antenna
            without a frame are left out.
    """
    found = [(lobes, frames.get(lobes), leg) for lobes in compared_lobes(config) for leg in LEGS_M[config.profile.name]]
    return [
        _point(frame[frame.object == _reflector(leg)], leg, lobes, statistic, scale)
        for lobes, frame, leg in found if frame is not None
        for statistic in STATISTICS for scale in SCALES
    ]  # fmt: skip


def _point(rows: Frame, leg_m: float, with_lobes: bool, statistic: str, scale: str) -> Point:
    profiles = rows[STATISTICS[statistic]]
    measured, (room,), (void,) = (profiles[rows.domain == domain] for domain in (MEASURED, TWIN, VOID))
    range_m = rows.range_m.iloc[0]
    values = {
        "share": np.array([beyond_target_share(one, range_m, DISTANCE_M) for one in measured]),
        VOID: np.array([profile_correlation(void, one, range_m, scale) for one in measured]),
        "room": np.array([profile_correlation(room, one, range_m, scale) for one in measured]),
    }
    inside, whole = np.transpose([gate_energies(one, range_m, DISTANCE_M) for one in measured])
    ratio = 10 * np.log10(np.mean(inside) / np.mean(values["share"] * whole))
    return Point(leg_m, with_lobes, statistic, scale, float(ratio), values, list(rows.key))


def best(points: Sequence[Point]) -> Point | None:
    """Return the accepted point with the smallest departure from the paper's figures, or None if no point is accepted."""
    return min((one for one in points if one.accepted), key=lambda one: one.departure, default=None)


def add_rows(rows: RowList, points: Sequence[Point]) -> None:
    """Add the figures of every point, and one row with the number of points at which the paper's figures occur together."""
    for one in points:
        case = {"distance_m": DISTANCE_M, "target_to_room_db": one.ratio_db}
        if one.scale == "amplitude":
            share = {**case, "case": f"measured, {one.name}", "scale": "power"}
            rows.add_mean(share, "energy share beyond the target", one.values["share"], one.keys, limits=statistics.SHARE)
        for name in (VOID, "room"):
            rows.add_mean(
                {**case, "case": f"{name}, {one.name}", "scale": one.scale},
                "profile correlation",
                one.values[name],
                one.keys,
                limits=statistics.SIGNED,
                on=statistics.FISHER,
            )
    chosen, count = best(points), sum(one.accepted for one in points)
    shown = chosen or min(points, key=lambda one: one.departure)
    means = ", ".join(f"{np.mean(shown.values[name]):+.2f}" for name in FIGURES)
    text = f"{'best' if chosen else 'none, nearest'}: {shown.name}, {SCALES[shown.scale]}: {means}"
    case = {"distance_m": DISTANCE_M, "target_to_room_db": shown.ratio_db, "case": text, "scale": shown.scale}
    keys = [key for one in points for key in one.keys]
    rows.add(case, "operating points with the paper's figures", statistics.exact(count, len(points)), keys, TOGETHER)


def draw(points: Sequence[Point]) -> Figure:
    """Draw the energy share and both correlations against the ratio of target to room, beside the paper's figures and the limits."""
    drawing, panels = figure(1, 1 + len(SCALES), width_in=PAGE_WIDTH_IN, height_in=2.9, sharex=True)
    colours = {"share": "0.2", VOID: PALETTE[1], "room": PALETTE[0]}
    shown = [("amplitude", ("share",)), *((scale, (VOID, "room")) for scale in SCALES)]
    for panel, (scale, names) in zip(panels, shown, strict=True):
        for name in names:
            low, high = LIMITS[name]
            panel.axhspan(max(low, -0.5), high, color=colours[name], alpha=0.12, lw=0)
            panel.axhline(PAPER[name], color=colours[name], lw=0.6, ls=":")
            for statistic, marker in zip(STATISTICS, "os", strict=True):
                for with_lobes, line, ending in ((True, "-", ""), (False, "--", ", no lobes")):
                    some = [one for one in points if (one.scale, one.statistic, one.lobes) == (scale, statistic, with_lobes)]
                    some = sorted(some, key=lambda one: one.ratio_db)
                    style = {"color": colours[name], "marker": marker, "ms": 4, "ls": line, "label": f"{name}, {statistic}{ending}"}
                    if some:
                        panel.plot([one.ratio_db for one in some], [np.mean(one.values[name]) for one in some], **style)
        panel.set(xlabel="target to room (dB)")
    panels[0].set(ylabel="energy share beyond the target", ylim=(0, 1))
    for panel, scale in zip(panels[1:], SCALES.values(), strict=True):
        panel.set(ylabel=f"correlation, {scale}", ylim=(-0.5, 1.05))
    legend_above(drawing, panels[1], 4)
    return drawing
