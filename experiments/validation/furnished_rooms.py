"""Score the simulator in furnished metal rooms against full-wave fields: nine given rooms and thirty seeded rooms.

The command `python -m experiments.validation.furnished_rooms [--output DIR]` prints a table with one line per room: the rms difference of
the range profiles over 40 dB, the complex error, the number of paths and the seconds of the simulation. Two more lines give medians and
worst values. The command also draws the room with the largest profile difference.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from experiments.validation.oracles import fullwave, furnished
from experiments.validation.oracles.case import Case, Finding, Untestable
from radartwin.plotting.style import PAGE_WIDTH_IN, PALETTE, figure, save
from radartwin.scene.scene import Scene
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.signal.synthesis import received
from radartwin.simulation.simulate import trace_paths

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Score:
    """The result of one furnished room."""

    folder: Path
    name: str
    compared: fullwave.Compared
    paths: int
    seconds: float  # wall time of the simulation


def simulated(scene: Scene) -> tuple[np.ndarray, int]:
    """Return the samples (N,) of the first channel and chirp of a radar at the origin, and the number of paths."""
    radar = furnished.radar()
    parts, poses = trace_paths(scene, radar, np.eye(4)[None], None, TraceSettings())
    return received(parts, radar, len(poses))[0, 0, 0, 0], sum(len(part.pose) for part in parts)


@cache
def score(folder: Path, name: str) -> Score:
    """Simulate a room of a folder and compare it with its full-wave field."""
    scene = fullwave.scene(folder, name)
    started = time.perf_counter()
    samples, paths = simulated(scene)
    return Score(folder, name, fullwave.compare(folder, name, samples), paths, time.perf_counter() - started)


def rooms() -> list[tuple[Path, str]]:
    """Return folder and name of all rooms. The given rooms are absent if the reference data are not beside the checkout."""
    folders = [folder for folder in (fullwave.GIVEN, furnished.ROOMS) if folder.is_dir()]
    return [(folder, name) for folder in folders for name in fullwave.names(folder)]


def worst(full: bool) -> Score:
    """Return the seeded room with the largest profile difference. If `full` is false, only the first room of each kind counts."""
    names = fullwave.names(furnished.ROOMS)[: None if full else len(furnished.KINDS)]
    return max((score(furnished.ROOMS, name) for name in names), key=lambda one: one.compared.profile_db)


def table(scores: Iterable[Score]) -> str:
    """Return the table of scores as text, with the median and the worst of each column."""
    rows = [(s.name, s.compared.profile_db, s.compared.error, s.paths, s.seconds) for s in scores]
    values = np.array([row[1:] for row in rows])
    rows += [("median", *np.median(values, axis=0)), ("worst", *values.max(axis=0))]
    lines = [f"{name:22s} {db:10.2f} {error:10.3f} {paths:6.0f} {seconds:8.2f}" for name, db, error, paths, seconds in rows]
    return "\n".join([f"{'room':22s} profile dB {'complex':>10s} {'paths':>6s} {'seconds':>8s}", *lines])


def drawing(shown: Score) -> Figure:
    """Draw the layout of a room and the range profiles of the full-wave field and of the simulation."""
    canvas, (left, right) = figure(1, 2, width_in=PAGE_WIDTH_IN, height_in=2.6)
    for number, (part, lines) in enumerate(fullwave.strips(shown.folder, shown.name).items()):
        for one, (start, end) in enumerate(lines):
            label = part.replace("_", " ") if not one else None
            left.plot([start[0], end[0]], [start[1], end[1]], color=PALETTE[number % len(PALETTE)], label=label)
    left.plot(0, 0, "^", color="0.3", label="radar")
    left.set(aspect="equal", xlabel="x (m)", ylabel="y (m)", title=shown.name.replace("_", " "))
    left.legend(loc="upper left", bbox_to_anchor=(1, 1))
    compared, peak = shown.compared, np.abs(shown.compared.truth).max()
    for profile, label, colour, width in ((compared.truth, "full wave", "0.6", 2.5), (compared.ours, "this simulator", PALETTE[0], 0.9)):
        right.plot(compared.range_m, 20 * np.log10(np.abs(profile) / peak), label=label, color=colour, lw=width)
    title = f"profile {compared.profile_db:.1f} dB, complex error {compared.error:.2f}"
    right.set(xlabel="range (m)", ylabel="level (dB)", ylim=(-60, 5), title=title)
    right.legend(loc="lower left")
    return canvas


def _worst(measure: str, folder: Path, few: int, full: bool) -> Finding:
    """Return the worst value of a property of `Compared` over the rooms of a folder, or over its first `few` rooms."""
    if not folder.is_dir():
        raise Untestable(f"the folder {folder} is missing")
    chosen = fullwave.names(folder)[: None if full else few]
    found = max(float(getattr(score(folder, name).compared, measure)) for name in chosen)
    return Finding(0.0, found, found, len(chosen))


SETS = {
    "given": ("nine given metal rooms", "full-wave fields of the reference data", fullwave.GIVEN, 9),
    "seeded": ("thirty seeded metal rooms", "method of moments in two dimensions", furnished.ROOMS, len(furnished.KINDS)),
}
MEASURES = {
    "profile_db": ("profile", "range profile over 40 dB", "rms difference in the worst room (dB)", 1.5, "dB"),
    "error": ("complex", "signal after one common phase", "complex error in the worst room", 0.06, ""),
}
CASES = [
    Case(f"furnished-{name}-{short}", "furnished rooms", f"{words}: {quantity}", oracle, metric, limit, unit,
         partial(_worst, measure, folder, few))
    for name, (words, oracle, folder, few) in SETS.items()
    for measure, (short, quantity, metric, limit, unit) in MEASURES.items()
]  # fmt: skip


def main() -> None:
    """Print the table of all rooms and draw the worst room."""
    parser = argparse.ArgumentParser(description="Score the simulator in furnished metal rooms against full-wave fields.")
    parser.add_argument("--output", type=Path, default=Path("outputs"), help="folder of the figure")
    folder = parser.parse_args().output
    scores = [score(*one) for one in rooms()]
    print(table(scores))
    save(drawing(max(scores, key=lambda one: one.compared.profile_db)), folder / "figures" / "furnished_rooms_worst")


if __name__ == "__main__":
    main()
