"""Full-wave fields of furnished metal rooms in two dimensions, and the score of a three-dimensional simulation against these fields.

A folder holds scenes.json and the fields of its scenes: vertical strips of metal (extruded from z = -1.6 m to +1.6 m), a line source, a
line receiver, and the field at 64 frequencies of the chirp. A path of length L between points has sqrt(-j lambda/L) times the amplitude
between lines. A linear map of the samples, the least-squares solution over paths at 0.2 m to 2.6 m, applies this factor with an error below
0.01 dB; a factor of the range profile would be wrong by 0.4 dB.
"""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import trimesh

from experiments.validation.oracles.case import REFERENCE, SPEED_OF_LIGHT
from radartwin.scene.scene import Scene, Surface

GIVEN = REFERENCE / "fullwave_2d"
HALF_HEIGHT_M = 1.6
EVERY = 4  # the files hold every fourth sample of a chirp
BINS = 4096
NEAR_M, FAR_M = 0.2, 1.25  # range in which a simulation is scored
CONVERTED_M = np.linspace(0.2, 2.6, 600)  # ranges at which the conversion from line to point sources is fitted
DYNAMIC_DB = 40.0
NOTHING = 1e-10  # level, relative to the strongest bin, of bins in which a simulation has no signal


@dataclass(frozen=True)
class Compared:
    """Range profiles (B,) of a full-wave field, converted to point sources, and of a simulation, at ranges (B,) in metres."""

    range_m: np.ndarray
    truth: np.ndarray
    simulated: np.ndarray

    @property
    def profile_db(self) -> float:
        """Return the rms difference in dB of the two profiles within DYNAMIC_DB of the strongest bin."""
        strong = np.abs(self.truth) > np.abs(self.truth).max() * 10 ** (-DYNAMIC_DB / 20)
        simulated = np.maximum(np.abs(self.simulated[strong]), NOTHING * np.abs(self.truth).max())
        difference_db = 20 * np.log10(simulated / np.abs(self.truth[strong]))
        return float(np.sqrt(np.mean(difference_db**2)))

    @property
    def error(self) -> float:
        """Return the complex error relative to the full-wave profile, after one common phase is fitted."""
        common = np.vdot(self.simulated, self.truth)
        return float(np.linalg.norm(self.simulated * common / abs(common) - self.truth) / np.linalg.norm(self.truth))


def strips(folder: Path, name: str) -> dict[str, np.ndarray]:
    """Return the strips (S, 2, 2) of each surface of a scene: start and end in the sensor frame, in metres."""
    return {part: np.array(lines) for part, lines in json.loads((folder / "scenes.json").read_text())["scenes"][name].items()}


def names(folder: Path) -> list[str]:
    """Return the names of the scenes in a folder."""
    return list(json.loads((folder / "scenes.json").read_text())["scenes"])


def extruded(lines: np.ndarray, half_height_m: float = HALF_HEIGHT_M) -> trimesh.Trimesh:
    """Return the vertical surface over strips (S, 2, 2) from -half_height_m to +half_height_m, without top and bottom."""
    corners = [[(*p, -half_height_m), (*q, -half_height_m), (*q, half_height_m), (*p, half_height_m)] for p, q in lines]
    faces = [[4 * i + k for k in three] for i in range(len(lines)) for three in ((0, 1, 2), (0, 2, 3))]
    return trimesh.Trimesh(np.round(np.concatenate(corners), 5), faces)


def scene(folder: Path, name: str) -> Scene:
    """Return the surfaces of a scene in the sensor frame, in metres."""
    return Scene([Surface(extruded(lines), "metal", part, role="room") for part, lines in strips(folder, name).items()])


def field(folder: Path, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the frequencies (F,) in Hz and the full-wave field (F,) of a scene."""
    frequency, real, imag = np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1).T
    return frequency, real + 1j * imag


def compare(folder: Path, name: str, samples: np.ndarray) -> Compared:
    """Compare the samples (N,) of the first channel and chirp with the full-wave field of a scene."""
    frequency, truth = field(folder, name)
    window = np.hanning(len(frequency) + 1)[:-1]
    ranges = np.arange(BINS) * SPEED_OF_LIGHT / (2 * (frequency[1] - frequency[0]) * BINS)
    kept = (ranges > NEAR_M) & (ranges < FAR_M)
    profiles = (np.fft.fft(signal * window, BINS)[kept] for signal in (to_points(frequency, truth), samples[::EVERY]))
    return Compared(ranges[kept], *profiles)


def to_points(frequency_hz: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Convert samples (F,) at frequencies (F,) from a line source and line receiver to a point source and point receiver."""
    return samples @ _conversion(tuple(frequency_hz))


@cache
def _conversion(frequencies_hz: tuple[float, ...]) -> np.ndarray:
    wavelength = SPEED_OF_LIGHT / np.array(frequencies_hz)
    lines = np.exp(4j * np.pi * CONVERTED_M[:, None] / wavelength)
    factor = np.sqrt(-1j * wavelength / (2 * CONVERTED_M[:, None]))
    return np.linalg.lstsq(lines * factor, lines * factor**2, rcond=1e-3)[0]
