"""Score the simulator in furnished metal rooms against full-wave fields: nine given rooms and thirty seeded rooms.

Each room is simulated twice: for a radar at rest, and as the middle frame of a track.
"""

from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from experiments.drawing import PAGE_WIDTH_IN, PALETTE, Figure, figure
from experiments.validation.oracles import fullwave, furnished
from experiments.validation.oracles.case import Case, Finding, Untestable
from radartwin.scene.scene import Scene
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.signal.synthesis import received
from radartwin.simulation.simulate import trace_paths

FRAMES, STEP_M = 51, 0.01  # frames of a track, and distance between its poses
SLOW_HZ = 1e-3  # frame rate of a track


@dataclass(frozen=True)
class Score:
    """The result of one furnished room."""

    folder: Path
    name: str
    compared: fullwave.Compared  # for a radar at rest
    on_track: fullwave.Compared  # in the middle frame of a track

    def worst(self, measure: str) -> float:
        """Return the larger value of a property of `Compared`, at rest and on the track."""
        return max(float(getattr(comparison, measure)) for comparison in (self.compared, self.on_track))


def simulated(scene: Scene, frames: int) -> np.ndarray:
    """Return the samples (N,) of the first channel and chirp of a radar at the origin, at rest or in the middle of a slow track along y."""
    radar, middle = replace(furnished.radar(), frame_rate_hz=SLOW_HZ), frames // 2
    track = np.repeat(np.eye(4)[None], frames, axis=0)
    track[:, 1, 3] = STEP_M * (np.arange(frames) - middle)
    parts = [part.frames(middle, middle + 1) for part in trace_paths(scene, radar, track, None, TraceSettings())[0]]
    return received(parts, radar, 1)[0, 0, 0, 0]


@cache
def score(folder: Path, name: str) -> Score:
    """Simulate a room of a folder at rest and on a track, and compare both with its full-wave field."""
    scene = fullwave.scene(folder, name)
    return Score(folder, name, *(fullwave.compare(folder, name, simulated(scene, frames)) for frames in (1, FRAMES)))


def worst(full: bool) -> Score:
    """Return the seeded room with the largest profile difference. If `full` is false, only the first room of each kind counts."""
    names = fullwave.names(furnished.ROOMS)[: None if full else len(furnished.KINDS)]
    return max((score(furnished.ROOMS, name) for name in names), key=lambda room_score: room_score.worst("profile_db"))


def drawing(room_score: Score) -> Figure:
    """Draw the layout of a room and the range profiles of the full-wave field and of the simulation."""
    canvas, (left, right) = figure(1, 2, width_in=PAGE_WIDTH_IN, height_in=2.6)
    for number, (part, lines) in enumerate(fullwave.strips(room_score.folder, room_score.name).items()):
        for line, (start, end) in enumerate(lines):
            label = part.replace("_", " ") if not line else None
            left.plot([start[0], end[0]], [start[1], end[1]], color=PALETTE[number % len(PALETTE)], label=label)
    left.plot(0, 0, "^", color="0.3", label="radar")
    left.set(aspect="equal", xlabel="x (m)", ylabel="y (m)", title=room_score.name.replace("_", " "))
    left.legend(loc="upper left", bbox_to_anchor=(1, 1))
    compared, peak = room_score.compared, np.abs(room_score.compared.truth).max()
    for profile, label, colour, width in (
        (compared.truth, "full wave", "0.6", 2.5),
        (compared.simulated, "this simulator", PALETTE[0], 0.9),
    ):
        right.plot(compared.range_m, 20 * np.log10(np.abs(profile) / peak), label=label, color=colour, lw=width)
    title = f"error of the profile {compared.profile_db:.1f} dB, of the signal {compared.error:.2f}"
    right.set(xlabel="range (m)", ylabel="level (dB)", ylim=(-60, 5), title=title)
    right.legend(loc="lower left")
    return canvas


def _worst(measure: str, folder: Path, few: int, full: bool) -> Finding:
    """Return the worst value of a property of `Compared` over the rooms of a folder, or over its first `few` rooms."""
    if not folder.is_dir():
        raise Untestable(f"the folder {folder} is missing")
    names = fullwave.names(folder)[: None if full else few]
    largest = max(score(folder, name).worst(measure) for name in names)
    return Finding(0.0, largest, largest, len(names))


SETS = {
    "given": ("nine given metal rooms", "full-wave fields of the reference data", fullwave.GIVEN, 9),
    "seeded": ("thirty seeded metal rooms", "method of moments in two dimensions", furnished.ROOMS, len(furnished.KINDS)),
}
MEASURES = {
    "profile_db": ("profile", "range profile over 40 dB, at rest and on a track", "rms difference in the worst room (dB)", 1.5, "dB"),
    "error": ("complex", "signal after one common phase, at rest and on a track", "complex error in the worst room", 0.06, ""),
}
CASES = [
    Case(f"furnished-{name}-{short}", "furnished rooms", f"{words}: {quantity}", oracle, metric, limit, unit,
         partial(_worst, measure, folder, few))
    for name, (words, oracle, folder, few) in SETS.items()
    for measure, (short, quantity, metric, limit, unit) in MEASURES.items()
]  # fmt: skip
