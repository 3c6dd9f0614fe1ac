"""Environment ablation: is a range profile more like the measured one when the room is simulated too?

A corner reflector turns once in front of the radar at each distance. Measured: the testbed's room with its clutter, layers and imperfect
radar. Simulated twice: object and stand alone (void), and with the twin's room (as scanned, with the configured materials). Compared: mean
range profiles by Pearson correlation, and the share of energy that arrives from beyond the target. Paper: environment ablation, void
against reconstructed scene, -0.24 against +0.42 at 2 m and about 75 % of the energy beyond the target.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from experiments import turntable
from experiments.claims import NONE, Claim
from experiments.statistics import bootstrap_mean
from radartwin.config import Config
from radartwin.experiment import Result
from radartwin.features.profile import FAR_M, NEAR_M, beyond_target_share, profile_correlation, range_time
from radartwin.plotting import PAGE_WIDTH_IN, PALETTE, figure
from radartwin.progress import Progress
from radartwin.store import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure


PAPER_DISTANCE_M = 2.0  # where the paper gives figures
ROOM = Claim(paper="+0.42")
CLOSER = Claim("the room brings the profile closer to the measured one", "above 0", above=0.0)
WIDENS = Claim("the gain widens with distance", "above 0", above=0.0)
BEYOND = Claim("most of the energy arrives from beyond the target", "about 0.75", above=0.5)
# "essentially uncorrelated or weakly anti-correlated", taken as a bound on the interval
UNCORRELATED = Claim("without the room the profiles do not correlate", "-0.24", below=0.1)
SCALES = {"amplitude": "amplitude", "db": "decibels"}


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Score the ablation at every distance; rows hold both scales of the correlation, and the energy shares."""
    turntable.check(config)
    source = config.materials.source
    labels = {"measured": "measured (testbed)", "room": f"room ({source})", "void": "void"}
    if source == "void":
        del labels["room"]
    distances = config.experiment.distances_m
    repeats = {"measured": config.profile.repeats}
    cases = [(domain, distance, i) for distance in distances for domain in labels for i in range(repeats.get(domain, 1))]
    maps: dict[tuple[str, float], list[np.ndarray]] = {}
    keys: dict[tuple[str, float], list[str]] = {}
    axis = np.zeros(0)
    for domain, distance, repeat in progress.over(cases, "environment recordings"):
        product, recording = turntable.fetch(config, store, domain, distance, repeat)
        power, axis = range_time(recording)
        keys.setdefault((domain, distance), []).append(product.key)
        maps.setdefault((domain, distance), []).append(power)
    rows = _rows(config, {case: [power.mean(axis=0) for power in powers] for case, powers in maps.items()}, axis, labels, keys)
    last = distances[-1]
    figures: dict[str, Callable[[], Figure]] = {
        "environment_range_time": lambda: _range_time_figure({d: maps[d, last][0] for d in labels}, axis, last, labels),
        "environment_correlation": lambda: _correlation_figure(rows, distances, labels),
    }
    metrics = {
        f"correlation_{domain}_{row['scale']}_{last:g}m": row["value"]
        for domain, label in labels.items()
        for row in rows
        if row["metric"] == "profile correlation" and row["case"] == label and row["distance_m"] == last
    }
    return Result("environment", rows, figures, metrics, [key for made in keys.values() for key in made])


def _rows(config: Config, profiles: dict, axis: np.ndarray, labels: dict[str, str], keys: dict) -> list[dict]:
    """Table rows: per distance and scale void, room and their difference; per distance the energy share in each domain."""
    rows: list[dict] = []
    gains: dict[tuple[str, float], np.ndarray] = {}
    distances = config.experiment.distances_m

    def add(
        where: tuple[float, str, str], metric: str, samples: Sequence[float] | np.ndarray, sources: Iterable, claim: Claim = NONE
    ) -> None:
        """One row at (distance, case, scale); `sources` are the (domain, distance) whose recordings it comes from."""
        low, value, high = bootstrap_mean(np.asarray(samples), config.profile.resamples, config.seed)
        distance, case, scale = where
        rows.append({
            "distance_m": distance, "case": case, "scale": scale, "claim": claim.text, "metric": metric,
            "run_keys": " ".join(key[:8] for source in sources for key in keys[source]), "paper": claim.paper, "value": value,
            "low": low, "high": high, "n": len(samples), "domain": "testbed", "verdict": claim.verdict(low, high, len(samples)),
        })  # fmt: skip

    for distance in distances:
        measured = profiles["measured", distance]
        reported = distance == PAPER_DISTANCE_M
        sources = {domain: [("measured", distance), (domain, distance)] for domain in labels}
        for scale in SCALES:
            score = {
                domain: np.array([profile_correlation(profiles[domain, distance][0], one, axis, scale) for one in measured])
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
            shares = [beyond_target_share(one, axis, distance) for one in profiles[domain, distance]]
            claim = BEYOND if reported and domain == "measured" else NONE
            add((distance, label, "power"), "energy share beyond the target", shares, [(domain, distance)], claim)
    near, far = min(distances), max(distances)
    if gains and near < far:
        for scale in SCALES:
            where = (far, f"gain at {far:g} m - at {near:g} m", scale)
            sources = [(domain, distance) for distance in (near, far) for domain in labels]
            add(where, "change of gain", gains[scale, far] - gains[scale, near], sources, WIDENS)
    return rows


def _range_time_figure(maps: dict[str, np.ndarray], axis: np.ndarray, distance: float, labels: dict[str, str]) -> Figure:
    """Range-time maps at one distance, measured first, on one scale."""
    drawing, panels = figure(1, len(maps), width_in=PAGE_WIDTH_IN, height_in=2.8, sharey=True, sharex=True)
    inside = (axis >= NEAR_M) & (axis <= FAR_M)
    top = max(10 * np.log10(power[:, inside].max()) for power in maps.values())
    for panel, (domain, power) in zip(panels, maps.items(), strict=True):
        level = 10 * np.log10(np.maximum(power[:, inside], 1e-30))
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
