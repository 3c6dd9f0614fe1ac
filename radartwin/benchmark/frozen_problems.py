"""Read the frozen problems of the benchmark and check their SHA-256 checksums.

    frozen/answers.json    version, licence, and for each problem: title, radar, surfaces, method and known error of the answer
    frozen/PROBLEM.npz     meshes, poses and answers of the scenarios of a problem

An answer holds the samples of one isotropic transmitter and one isotropic receiver, which are at different positions only in the problem
fullwave_rooms (docs/benchmark.md). The names of the arrays are
SCENARIO/answer (S, N) complex, SCENARIO/sensor (F or 1, 4, 4), SCENARIO/motion/SURFACE (F, 4, 4), and SCENARIO/surface_I/vertices (V, 3),
faces (T, 3) and normals (V, 3). S frames have an answer. The other frames, up to F, only serve to time a method.
`experiments/generators/benchmark_answers.py` computes the files again.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from radartwin.errors import InputError, MissingError
from radartwin.io import files, untrusted_json
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene
from radartwin.scene.storage import material_from_json
from radartwin.scene.surface import Surface

FOLDER = Path(__file__).parent / "frozen"
INDEX, FORMAT = "answers.json", "radartwin benchmark answers 1"
Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Scenario:
    """One recording of a problem."""

    name: str
    scene: Scene  # in world coordinates; a surface named in `motion` is in its own coordinates
    sensor: Array  # (F, 4, 4) sensor-to-world poses, or (1, 4, 4) if the radar is at rest
    motion: Mapping[str, Array]  # (F, 4, 4) object-to-world poses of each moving surface
    radar: Radar  # one transmitter, one receiver, one chirp per frame and isotropic elements
    answer: Array  # (S, N) complex samples of the first S frames, in amplitude units

    @property
    def scored(self) -> int:
        """Number of frames that have an answer."""
        return len(self.answer)

    @property
    def frames(self) -> int:
        """Number of frames of the whole recording."""
        return max(len(poses) for poses in (self.sensor, *self.motion.values()))

    def poses(self, frames: int) -> tuple[Array, dict[str, Array]]:
        """Return the sensor poses and the motion of the first `frames` frames."""
        return self.sensor[:frames], {name: poses[:frames] for name, poses in self.motion.items()}


@dataclass(frozen=True, eq=False)
class Problem:
    """A group of scenarios whose errors are averaged."""

    name: str
    title: str
    rests_on: str  # method by which the answer is computed
    known_error: float  # signal error of the answer itself; `known_by` in answers.json states how it is known
    gate_m: tuple[float, float]  # nearest and farthest range in which the answer is valid and methods are scored
    radar: Radar
    scenarios: tuple[Scenario, ...]


@cache
def index(folder: Path = FOLDER) -> dict[str, Any]:
    """Read answers.json. Raises MissingError or InputError."""
    return described(folder / INDEX, FORMAT, "install radartwin again")


def described(path: Path, expected: str, remedy: str) -> dict[str, Any]:
    """Read a JSON object whose key `format` has the expected value. Raises MissingError or InputError with a message that ends with
    `remedy`.
    """
    if not path.is_file():
        raise MissingError(f"{path}: no such file; {remedy}")
    try:
        content = untrusted_json.read(path)
    except ValueError as error:
        raise InputError(f"{path} is no JSON ({error}); {remedy}") from error
    if not isinstance(content, dict) or content.get("format") != expected:
        raise InputError(f"{path}: 'format' must be '{expected}'; {remedy}")
    return content


def version(folder: Path = FOLDER) -> str:
    return str(index(folder)["version"])


def names(folder: Path = FOLDER) -> list[str]:
    return list(index(folder)["problems"])


@cache
def problem(name: str, folder: Path = FOLDER) -> Problem:
    """Read one problem. Raises InputError for an unknown name or a wrong checksum, and MissingError.

    >>> problem("near").scenarios[0].answer.shape
    (11, 256)
    """
    entries = index(folder)["problems"]
    if name not in entries:
        raise InputError(f"problem {name!r} is not known; choose one of {', '.join(entries)}")
    entry = entries[name]
    arrays = checked_arrays(folder, entry, f"{INDEX} of version {version(folder)}", "install radartwin again")
    radar = radar_of(entry["radar"])
    scenarios = tuple(_scenario(key, surfaces, arrays, radar) for key, surfaces in entry["scenarios"].items())
    near, far = entry["gate_m"]
    return Problem(name, entry["title"], entry["rests_on"], entry["known_error"], (near, far), radar, scenarios)


def checked_arrays(folder: Path, entry: Mapping[str, Any], where: str, remedy: str) -> dict[str, Array]:
    """Read the .npz file of an entry of an index. Raises MissingError, or InputError if the file has another checksum than the entry."""
    path = files.inside(folder, entry["file"])
    if not path.is_file():
        raise MissingError(f"{path}: no such file, but {where} names it; {remedy}")
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    if digest != entry.get("sha256"):
        raise InputError(f"{path} has the SHA-256 checksum {digest[:12]}..., not that of {where}; {remedy}")
    return files.read_arrays(path)


def problems(folder: Path = FOLDER) -> list[Problem]:
    """Return all problems of the benchmark."""
    return [problem(name, folder) for name in names(folder)]


def radar_of(described: Mapping[str, Any]) -> Radar:
    """Return the radar of a problem: one chirp per frame, one transmitter and one receiver, both isotropic."""
    positions: dict[str, Any] = {name: (tuple(described[name]),) for name in ("tx_positions_m", "rx_positions_m")}
    rates = {name: described[name] for name in ("start_frequency_hz", "slope_hz_per_s", "sample_rate_hz", "num_samples", "frame_rate_hz")}
    return Radar(name="benchmark", num_chirps=1, chirp_interval=described["chirp_interval"], element="isotropic", **rates, **positions)


def _scenario(name: str, surfaces: list[dict[str, Any]], arrays: Mapping[str, Array], radar: Radar) -> Scenario:
    made = []
    for number, surface in enumerate(surfaces):
        part = f"{name}/surface_{number}"
        mesh = trimesh.Trimesh(arrays[f"{part}/vertices"], arrays[f"{part}/faces"], vertex_normals=arrays[f"{part}/normals"], process=False)
        made.append(Surface(mesh, material_from_json(surface["material"]), surface["name"], role=surface["role"]))
    start = f"{name}/motion/"
    motion = {key.removeprefix(start): value for key, value in arrays.items() if key.startswith(start)}
    return Scenario(name, Scene(made), arrays[f"{name}/sensor"], motion, radar, arrays[f"{name}/answer"])


def packed(arrays: Mapping[str, Array]) -> bytes:
    """Return the bytes of an .npz file. Equal arrays give equal bytes, because the entries carry no time."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            content = io.BytesIO()
            np.lib.format.write_array(content, np.ascontiguousarray(array), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), content.getvalue(), zipfile.ZIP_DEFLATED)
    return out.getvalue()
