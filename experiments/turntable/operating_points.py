"""Operating points: where do the paper's figures of the environment ablation occur together, if the target is weaker or stronger?

At 2 m, the paper has about 75 % of the energy beyond the target, and correlations of -0.24 (void) and +0.42 (room). An operating point is a
choice of the reflector's leg, of the measuring antennas' side and back lobes, of the energy of static echoes that the scan does not know
over that of the room (gap `unscanned_echoes`), of the average over frames (AVERAGES of experiments.campaign.columns), and of window and
scale of the correlated profiles. The acceptance limits `LIMITS` were written before the first score; a point is accepted if the means of
all three figures are inside.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from experiments import statistics
from experiments.campaign.cases import BENCH_ROOM, MEASURED, REFLECTOR, TWIN, VOID, Case, draws
from experiments.campaign.columns import AVERAGES
from experiments.campaign.frame import Frame
from experiments.drawing import PAGE_WIDTH_IN, Figure, figure, legend_above
from experiments.verdicts import Claim, RowList
from radartwin.config.config import Config
from radartwin.features.profile import beyond_target_share, gate_energies, profile_correlation
from radartwin.scene.objects.catalogue import OTHER_LEGS_M, REFLECTOR_LEG_M

DISTANCE_M = 2.0
LEGS_M = {"quick": (0.05, 0.07, REFLECTOR_LEG_M, 0.12), "paper": tuple(sorted((*OTHER_LEGS_M, REFLECTOR_LEG_M)))}
LOBES = {"quick": (True,), "paper": (True, False)}  # with and without the antennas' side and back lobes
UNSCANNED = {"quick": (0.0, 2.0), "paper": (0.0, 1.0, 2.0, 3.0, 5.0)}  # strengths of the gap `unscanned_echoes`
WINDOWS_M = {"all ranges": np.inf, "1 m around the target": 1.0}  # largest distance of a range bin from the target
SCALES = {"amplitude": "amplitude", "db": "decibels"}
SHOWN = 12  # number of points with rows: those nearest to the paper's figures
FIGURES = ("share", VOID, "room")
PAPER = {"share": 0.75, VOID: -0.24, "room": 0.42}
# Acceptance limits. The paper gives the share as "about 75 %", and calls the profile in void "essentially uncorrelated or weakly
# anti-correlated". The limits of the room's correlation are 0.42 plus and minus 0.22 to 0.23, so that they exclude both "uncorrelated"
# and the correlations above 0.8 of the campaign's own reflector.
LIMITS = {"share": (0.65, 0.85), VOID: (-1.0, 0.1), "room": (0.20, 0.65)}
TOGETHER = Claim("the paper's three figures occur together at an operating point", "0.75, -0.24, +0.42", bound=0.5, null=0.0, least=1)


class Condition(NamedTuple):
    """Conditions of the measurement: side and back lobes of the antennas, and the strength of the gap `unscanned_echoes`."""

    lobes: bool
    unscanned: float

    def of(self, config: Config) -> Config:
        """Return the configuration whose measurements have these conditions."""
        gap = replace(config.measured.gap, unscanned_echoes=self.unscanned)
        return replace(config, measured=replace(config.measured, gap=gap if self.lobes else replace(gap, antenna=0.0)))


@dataclass(frozen=True, eq=False)
class Point:
    """The figures of one operating point, for each of N measured recordings."""

    leg_m: float  # leg of the corner reflector
    condition: Condition
    average: str  # average of the power over frames, a key of AVERAGES
    window: str  # a key of WINDOWS_M
    scale: str  # a key of SCALES
    ratio_db: float  # energy of the target over the energy beyond it
    values: Mapping[str, np.ndarray]  # by FIGURES: (N,) energy share beyond the target, and correlations with the measured profile
    keys: Sequence[str]  # store keys of the recordings

    @property
    def name(self) -> str:
        lobes, more = "with" if self.condition.lobes else "no", self.condition.unscanned
        return f"leg {100 * self.leg_m:g} cm, {lobes} lobes, unscanned echoes {more:g}, {self.average} of frames, {self.window}"

    @property
    def accepted(self) -> bool:
        return all(low <= float(np.mean(self.values[name])) <= high for name, (low, high) in LIMITS.items())

    @property
    def together(self) -> np.ndarray:
        """Whether all three figures of a recording are inside the limits, (N,)."""
        return np.all([(low <= self.values[name]) & (self.values[name] <= high) for name, (low, high) in LIMITS.items()], axis=0)

    @property
    def departure(self) -> float:
        """Root mean square, over the three figures, of (mean - paper's figure) / (upper limit - paper's figure)."""
        parts = [(np.mean(self.values[name]) - PAPER[name]) / (LIMITS[name][1] - PAPER[name]) for name in FIGURES]
        return float(np.sqrt(np.mean(np.square(parts))))


def conditions(config: Config) -> tuple[Condition, ...]:
    """Return the compared conditions; none if the profile has none, the testbed does not measure at the paper's distance, or the
    simulation has no room.
    """
    distances_m, profile = config.experiment.distances_m, config.profile
    unfit = config.measured.provider != "testbed" or config.materials.source == VOID
    if not profile.operating_points or unfit or (distances_m and DISTANCE_M not in distances_m):
        return ()
    lobes = [lobe for lobe in LOBES.get(profile.name, ()) if config.measured.gap.antenna or not lobe]
    return tuple(Condition(*pair) for pair in itertools.product(lobes, UNSCANNED.get(profile.name, ())))


def wanted(config: Config) -> list[tuple[str, Case]]:
    """Return (domain, case) of all recordings that the operating points of one condition read."""
    measured = draws(config.profile.campaign, False) if config.measured.draw is None else [config.measured.draw]
    firsts = [Case(_reflector(leg), BENCH_ROOM, "turntable", DISTANCE_M) for leg in LEGS_M[config.profile.name]]
    return [pair for case in firsts for pair in (*((MEASURED, replace(case, draw=k)) for k in measured), (TWIN, case), (VOID, case))]


def _reflector(leg_m: float) -> str:
    return REFLECTOR if leg_m == REFLECTOR_LEG_M else f"{REFLECTOR}_{100 * leg_m:g}cm"


def read(config: Config, frames: Mapping[Condition, Frame]) -> list[Point]:
    """Compute the figures of all operating points from the frame of each condition."""
    return [
        _point(frame[frame.object == _reflector(leg)], leg, condition, average, window, scale)
        for condition, frame in frames.items() for leg in LEGS_M[config.profile.name]
        for average, window, scale in itertools.product(AVERAGES, WINDOWS_M, SCALES)
    ]  # fmt: skip


def _point(rows: Frame, leg_m: float, condition: Condition, average: str, window: str, scale: str) -> Point:
    range_m, profiles = rows.range_m.iloc[0], rows[f"{average}_power"]
    near = np.abs(range_m - DISTANCE_M) <= WINDOWS_M[window]
    measured, (room,), (void,) = (profiles[rows.domain == domain] for domain in (MEASURED, TWIN, VOID))
    correlations = {
        name: np.array([profile_correlation(profile[near], power[near], range_m[near], scale) for power in measured])
        for name, profile in ((VOID, void), ("room", room))
    }
    values = {"share": np.array([beyond_target_share(power, range_m, DISTANCE_M) for power in measured]), **correlations}
    inside, whole = np.transpose([gate_energies(power, range_m, DISTANCE_M) for power in measured])
    ratio = 10 * np.log10(np.mean(inside) / np.mean(values["share"] * whole))
    return Point(leg_m, condition, average, window, scale, float(ratio), values, list(rows.key))


def best(points: Sequence[Point]) -> Point | None:
    """Return the accepted point with the smallest departure from the paper's figures, or None if no point is accepted."""
    return min((point for point in points if point.accepted), key=lambda point: point.departure, default=None)


def add_rows(rows: RowList, points: Sequence[Point]) -> None:
    """Add the figures of the nearest points, the largest share of recordings with the paper's figures, and the number of points."""
    nearest = sorted(points, key=lambda point: (not point.accepted, point.departure))
    for point in nearest[:SHOWN]:
        case = {"distance_m": DISTANCE_M, "target_to_room_db": point.ratio_db, "scale": point.scale}
        share = {**case, "case": f"measured, {point.name}, {SCALES[point.scale]}"}
        rows.add_mean(share, "energy share beyond the target", point.values["share"], point.keys, limits=statistics.SHARE)
        for name in (VOID, "room"):
            limits = {"limits": statistics.SIGNED, "on": statistics.FISHER}
            rows.add_mean({**case, "case": f"{name}, {point.name}"}, "profile correlation", point.values[name], point.keys, **limits)
    most = max(nearest, key=lambda point: point.together.sum())
    case = {"distance_m": DISTANCE_M, "target_to_room_db": most.ratio_db, "case": f"measured, {most.name}", "scale": most.scale}
    share = statistics.share(int(most.together.sum()), len(most.together))
    rows.add(case, "share of recordings with the paper's figures, largest", share, most.keys)
    closest, count = nearest[0], sum(point.accepted for point in points)
    means = ", ".join(f"{np.mean(closest.values[name]):+.2f}" for name in FIGURES)
    text = f"{'best' if closest.accepted else 'none, nearest'}: {closest.name}, {SCALES[closest.scale]}: {means}"
    case = {"distance_m": DISTANCE_M, "target_to_room_db": closest.ratio_db, "case": text, "scale": closest.scale}
    keys = [key for point in points for key in point.keys]
    rows.add(case, "operating points with the paper's figures", statistics.exact(count, len(points)), keys, TOGETHER)


def draw(points: Sequence[Point]) -> Figure:
    """Draw both correlations of every operating point, with the energy share as colour, the limits as a box, and the paper's figures."""
    drawing, panels = figure(1, len(SCALES), width_in=PAGE_WIDTH_IN, height_in=3.2, sharex=True, sharey=True)
    for panel, (scale, label) in zip(panels, SCALES.items(), strict=True):
        for window, marker in zip(WINDOWS_M, "os", strict=True):
            of_window = [point for point in points if (point.scale, point.window) == (scale, window)]
            share, void, room = ([np.mean(point.values[name]) for point in of_window] for name in FIGURES)
            dots = panel.scatter(void, room, c=share, marker=marker, s=14, vmin=0, vmax=1, cmap="coolwarm", label=window)
        (left, right), (low, high) = LIMITS[VOID], LIMITS["room"]
        panel.fill_between((max(left, -0.5), right), low, high, color="0.5", alpha=0.2, lw=0, label="as in the paper")
        panel.plot(PAPER[VOID], PAPER["room"], "k*", ms=9, label="paper, share 0.75")
        panel.set(xlabel="correlation without the room", title=label, xlim=(-0.5, 1.05), ylim=(-0.5, 1.05))
    panels[0].set_ylabel("correlation with the room")
    drawing.colorbar(dots, ax=panels, label="energy share beyond the target", pad=0.01)
    legend_above(drawing, panels[0], 4)
    return drawing
