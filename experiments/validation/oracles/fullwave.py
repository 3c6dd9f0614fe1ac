"""Full-wave fields of furnished metal rooms in two dimensions, and the score of a three-dimensional simulation against these fields.

The scenes and fields are files (shared/reference/fullwave_2d): vertical strips of metal, a line source, a line receiver, and the field from
the method of moments at 64 frequencies of the chirp. The strips are extruded to surfaces from z = -1.6 m to z = +1.6 m. A path of length L
between points has sqrt(j lambda/L) times the amplitude that it has between lines, so the range profile of the full-wave field is multiplied
by sqrt(lambda/(2 range)). This conversion alone has an error of 0.6 dB and 0.027.
"""

import json
from pathlib import Path

import numpy as np
import trimesh

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.scene.scene import Scene, Surface

HALF_HEIGHT_M = 1.6
EVERY = 4  # the files hold every fourth sample of a chirp
BINS = 4096
NEAR_M, FAR_M = 0.2, 1.25  # range in which a simulation is scored
DYNAMIC_DB = 40.0


def names(folder: Path) -> list[str]:
    """Return the names of the scenes in the folder of the reference files."""
    return list(json.loads((folder / "scenes.json").read_text())["scenes"])


def scene(folder: Path, name: str) -> Scene:
    """Return the surfaces of a scene in the sensor frame, in metres."""
    surfaces = []
    for part, strips in json.loads((folder / "scenes.json").read_text())["scenes"][name].items():
        corners = [[(*p, -HALF_HEIGHT_M), (*q, -HALF_HEIGHT_M), (*q, HALF_HEIGHT_M), (*p, HALF_HEIGHT_M)] for p, q in strips]
        faces = [[4 * i + k for k in three] for i in range(len(strips)) for three in ((0, 1, 2), (0, 2, 3))]
        mesh = trimesh.Trimesh(np.round(np.concatenate(corners), 5), faces)
        surfaces.append(Surface(mesh, "metal", part, role="room"))
    return Scene(surfaces)


def score(folder: Path, name: str, samples: np.ndarray) -> tuple[float, float]:
    """Compare the samples (N,) of the first channel and chirp with the full-wave field.

    Returns:
        The rms difference in dB of the range profiles within DYNAMIC_DB of the strongest bin, and the complex error relative to the
        full-wave profile after one common phase.
    """
    frequency, real, imag = np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1).T
    window = np.hanning(len(frequency) + 1)[:-1]
    ranges = np.arange(BINS) * SPEED_OF_LIGHT / (2 * (frequency[1] - frequency[0]) * BINS)
    spread = np.sqrt(SPEED_OF_LIGHT / frequency[0] / (2 * np.maximum(ranges, 1e-3)))
    used = (ranges > NEAR_M) & (ranges < FAR_M)
    truth = (np.fft.fft((real + 1j * imag) * window, BINS) * spread)[used]
    ours = np.fft.fft(samples[::EVERY] * window, BINS)[used]
    strong = np.abs(truth) > np.abs(truth).max() * 10 ** (-DYNAMIC_DB / 20)
    difference_db = 20 * np.log10(np.abs(ours[strong]) / np.abs(truth[strong]))
    common = np.vdot(ours, truth)
    error = np.linalg.norm(ours * common / abs(common) - truth) / np.linalg.norm(truth)
    return float(np.sqrt(np.mean(difference_db**2))), float(error)
