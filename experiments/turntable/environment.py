"""Environment ablation: is a range profile more like the measured one when the room is simulated too?

A corner reflector turns in front of the radar at each distance. Measured: the campaign's recordings of it, from the testbed the room with
its clutter, layers and imperfect radar. Simulated twice: object and stand alone (void), and with the twin's room (as scanned, with the
configured materials). Compared: mean range profiles by Pearson correlation, and the share of energy that arrives from beyond the target.
Paper: environment ablation, void against reconstructed scene, -0.24 against +0.42 at 2 m and about 75 % of the energy beyond the target.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments import statistics
from experiments.claims import NONE, Claim, row
from experiments.recognition.readings import Campaign
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

TABLE = Table(
    name="environment",
    title="The room in the signal",
    caption="A corner reflector on a turntable in a laboratory room. Rows give the Pearson correlation of mean range profiles with the "
    "measured domain, for simulations in void and in the reconstructed room, and the share of energy beyond the target. "
    "Profiles span 0.3 to 5.5 m. Intervals are 95 % percentile bootstraps over the n measured recordings. A row for which the "
    "paper states no claim is untestable.",
)

TARGET, ROOM_NAME = "corner_reflector", "lab"
DOMAINS = {"measured": "measured", "room": "twin", "void": "void"}  # of the table, and of the campaign
PAPER_DISTANCE_M = 2.0  # where the paper gives figures
ROOM = Claim(paper="+0.42")
CLOSER = Claim("the room brings the profile closer to the measured one", "above 0", above=0.0)
WIDENS = Claim("the gain widens with distance", "above 0", above=0.0)
BEYOND = Claim("most of the energy arrives from beyond the target", "about 0.75", above=0.5)
# "essentially uncorrelated or weakly anti-correlated", taken as a bound on the interval
UNCORRELATED = Claim("without the room the profiles do not correlate", "-0.24", below=0.1)
SCALES = {"amplitude": "amplitude", "db": "decibels"}


@dataclass(frozen=True, eq=False)
class Shown:
    """One recording: its mean range profile (B,), and the power of its first turn (F, B) over range_m (B,)."""

    key: str
    profile: np.ndarray
    turn: np.ndarray
    range_m: np.ndarray


Recordings = Mapping[tuple[str, float], Sequence[Shown]]  # by domain of the table and distance


def run(config: Config, store: Store, progress: Progress) -> Result:
    from experiments.campaign.campaign import Campaign as Recorded

    check(config)
    return score(config, Recorded(config, store, progress), progress)


def check(config: Config) -> None:
    """Refuse what would not be read, before anything is simulated. Raises ConfigError."""
    for key, value, read in (
        ("scene", config.scene.name, ROOM_NAME),
        ("scene.target", config.scene.target, TARGET),
        ("trajectory", config.trajectory.kind, "turntable"),
    ):
        if value != read:
            raise ConfigError(
                f"{key}={value} is not read by experiment=environment, which scores the campaign's {key}={read}; leave it out"
            )


def score(config: Config, campaign: Campaign, progress: Progress) -> Result:
    """Rows hold both scales of the correlation at every distance, and the energy shares.

    Raises:
        ConfigError: the campaign has no such recordings.
    """
    recordings = read(config, campaign, progress)
    distances = sorted({distance for _, distance in recordings})
    source, last = config.materials.source, distances[-1]
    labels = {"measured": f"measured ({config.measured.provider})", "room": f"room ({source})", "void": "void"}
    labels = {domain: label for domain, label in labels.items() if (domain, last) in recordings}
    rows = _rows(config, recordings, distances, labels)
    figures: dict[str, Callable[[], Figure]] = {
        "environment_range_time": lambda: _range_time_figure({d: recordings[d, last][0] for d in labels}, last, labels),
        "environment_correlation": lambda: _correlation_figure(rows, distances, labels),
    }
    metrics = {
        f"correlation_{domain}_{one['scale']}_{last:g}m": one["value"]
        for domain, label in labels.items()
        for one in rows
        if one["metric"] == "profile correlation" and one["case"] == label and one["distance_m"] == last
    }
    return Result(TABLE.name, rows, figures, metrics, [one.key for some in recordings.values() for one in some])


def read(config: Config, campaign: Campaign, progress: Progress) -> Recordings:
    """The reflector's turns by domain and distance, at the configured distances (none: all) that both domains have."""
    domains = [domain for domain in DOMAINS if not (domain == "room" and config.materials.source == "void")]
    turning = {"motion": "turntable", "room": ROOM_NAME, "object": TARGET}
    cases = [(domain, case) for domain in domains for case in campaign.cases(DOMAINS[domain], **turning)]
    found = {case.distance_m for _, case in cases}
    chosen = set(config.experiment.distances_m) or found
    common = [d for d in chosen if all(any(other == domain and case.distance_m == d for other, case in cases) for domain in domains)]
    if missing := sorted(chosen - set(common)):
        have = ", ".join(f"{distance:g}" for distance in sorted(found)) or "none"
        raise ConfigError(f"experiment.distances_m: the campaign has no turning {TARGET} at {missing[0]:g} m; it has {have}")
    if not common:
        raise ConfigError(f"the campaign has no turning {TARGET} that is both measured and simulated")
    out: dict[tuple[str, float], list[Shown]] = {}
    wanted = [(domain, case) for domain, case in cases if case.distance_m in common]
    campaign.prepare([(DOMAINS[domain], case) for domain, case in wanted])
    for domain, case in progress.over(wanted, "environment recordings"):
        key, processed = campaign.processed(DOMAINS[domain], case)
        turned = angles(campaign.log(case, DOMAINS[domain]), processed.num_frames)
        turn = processed.power[turned < turned[0] + 2 * np.pi - 1e-9]
        shown = Shown(key, processed.power.mean(axis=0, dtype=float), turn, processed.range_m)
        out.setdefault((domain, case.distance_m), []).append(shown)
    return out


def _rows(config: Config, recordings: Recordings, distances: list[float], labels: dict[str, str]) -> list[dict[str, Any]]:
    """Table rows: per distance and scale void, room and their difference; per distance the energy share in each domain."""
    rows: list[dict[str, Any]] = []
    gains: dict[tuple[str, float], np.ndarray] = {}

    def add(where: tuple[float, str, str], metric: str, samples: Sequence[float] | np.ndarray, sources: Iterable, claim: Claim = NONE):
        """One row at (distance, case, scale); `sources` are the (domain, distance) whose recordings it comes from."""
        found = statistics.mean(samples, config.profile.resamples, config.seed)
        case: dict[str, Any] = dict(zip(("distance_m", "case", "scale"), where, strict=True))
        rows.append(row(config, case, metric, found, [one.key for source in sources for one in recordings[source]], claim))

    for distance in distances:
        reported = distance == PAPER_DISTANCE_M
        sources = {domain: [("measured", distance), (domain, distance)] for domain in labels}
        for scale in SCALES:
            score = {
                domain: _correlations(recordings["measured", distance], recordings[domain, distance][0], scale)
                for domain in labels
                if domain != "measured"
            }
            for domain, claim in (("void", UNCORRELATED), ("room", ROOM)):
                if domain in score:
                    where = (distance, labels[domain], scale)
                    add(where, "profile correlation", score[domain], sources[domain], claim if reported else NONE)
            if "room" in score:
                gains[scale, distance] = score["room"] - score["void"]
                where = (distance, f"{labels['room']} - void", scale)
                add(where, "gain in correlation", gains[scale, distance], [(domain, distance) for domain in labels], CLOSER)
        for domain, label in labels.items():
            shares = [beyond_target_share(one.profile, one.range_m, distance) for one in recordings[domain, distance]]
            claim = BEYOND if reported and domain == "measured" else NONE
            add((distance, label, "power"), "energy share beyond the target", shares, [(domain, distance)], claim)
    near, far = min(distances), max(distances)
    if gains and near < far:
        for scale in SCALES:
            count = min(len(gains[scale, near]), len(gains[scale, far]))
            change = gains[scale, far][:count] - gains[scale, near][:count]
            where = (far, f"gain at {far:g} m - at {near:g} m", scale)
            add(where, "change of gain", change, [(domain, distance) for distance in (near, far) for domain in labels], WIDENS)
    return rows


def _correlations(measured: Sequence[Shown], simulated: Shown, scale: str) -> np.ndarray:
    """Of each measured profile with the simulated one."""
    return np.array([profile_correlation(simulated.profile, one.profile, one.range_m, scale) for one in measured])


def _range_time_figure(shown: dict[str, Shown], distance: float, labels: dict[str, str]) -> Figure:
    """Range-time maps of a turn at one distance, measured first, on one scale."""
    drawing, panels = figure(1, len(shown), width_in=PAGE_WIDTH_IN, height_in=2.8, sharey=True, sharex=True)
    axis = shown["measured"].range_m
    inside = (axis >= NEAR_M) & (axis <= FAR_M)
    top = max(10 * np.log10(one.turn[:, inside].max()) for one in shown.values())
    for panel, (domain, one) in zip(panels, shown.items(), strict=True):
        level = 10 * np.log10(np.maximum(one.turn[:, inside], 1e-30))
        extent = (0, 360, float(axis[inside][0]), float(axis[inside][-1]))
        panel.imshow(level.T, origin="lower", aspect="auto", extent=extent, vmin=top - 70, vmax=top, interpolation="nearest")
        panel.set(title=labels[domain], xlabel="turntable angle (deg)", xticks=[0, 90, 180, 270, 360])
    line = {"arrowstyle": "-", "color": "white"}
    panels[0].annotate("reflector", (15, distance), (25, distance - 0.6), color="white", fontsize=7, arrowprops=line)
    panels[0].set_ylabel("range (m)")
    drawing.colorbar(panels[0].images[0], ax=panels, label="received / transmitted power (dB)", pad=0.01)
    return drawing


def _correlation_figure(rows: list[dict], distances: list[float], labels: dict[str, str]) -> Figure:
    """Correlation with the measured profile against distance, one panel per scale."""
    drawing, panels = figure(1, len(SCALES), width_in=PAGE_WIDTH_IN, height_in=2.6, sharey=True)
    looks = {"void": (PALETTE[1], "s"), "room": (PALETTE[0], "o")}
    found = {(r["case"], r["scale"], r["distance_m"]): r for r in rows if r["metric"] == "profile correlation"}
    for panel, scale in zip(panels, SCALES, strict=True):
        for domain, label in labels.items():
            if domain == "measured":
                continue
            chosen = [found[label, scale, distance] for distance in distances]
            value, low, high = (np.array([row[column] for row in chosen]) for column in ("value", "low", "high"))
            colour, marker = looks[domain]
            panel.errorbar(distances, value, yerr=[value - low, high - value], color=colour, marker=marker, ms=4, capsize=2, label=label)
        panel.axhline(0, color="0.6", lw=0.6)
        panel.set(title=f"profiles in {SCALES[scale]}", xlabel="distance of the reflector (m)", ylim=(-0.5, 1.05))
    panels[0].set_ylabel("correlation with measured profile")
    panels[0].legend(loc="lower left")
    return drawing
