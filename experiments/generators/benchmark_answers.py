"""Write the frozen problems of the benchmark: `python -m experiments.generators.benchmark_answers [--output FOLDER]` (two core-minutes).

Five problems are those of experiments/speed/problems.py, but the empty room has image sources of up to ORDERS bounces. The sixth holds the
full-wave rooms: thirty seeded ones (experiments/validation/oracles/furnished.py), and nine of the project's reference data, which must lie
beside the checkout. No answer uses RadarTwin's tracer. Raise VERSION whenever an answer, a scene or the score changes, and its first number
if old and new scores cannot be compared.
"""

import argparse
import hashlib
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.speed import problems as speed
from experiments.validation.oracles import fullwave, furnished
from radartwin.benchmark import frozen_problems
from radartwin.features.profile import FAR_M, NEAR_M
from radartwin.io import files
from radartwin.scene.scene import Scene
from radartwin.scene.storage import material_to_json

VERSION = "1.0"
ORDERS = 12  # bounces of the image sources; paths of 13 to 16 bounces change the signal by 2e-4 of its norm
ROOMS = "fullwave_rooms"
GATE_M = (NEAR_M, FAR_M)  # range gate of the features of the study
# The full-wave fields lack the waves from the upper and lower ends of the walls, 1.6 m above and below the radar.
FULL_WAVE_GATE_M = (fullwave.NEAR_M, fullwave.FAR_M)
# For each problem: the method of the answer, the signal error of the answer, and how this error is known (docs/benchmark.md).
FIELDS = "two-dimensional full wave (method of moments), converted to point sources"
RESTS_ON = {
    "canonical": (
        "Mie series (sphere); series and Fresnel integral (cylinder); physical optics by near-field quadrature (plate, trihedral)", 0.07,
        "rms of the four targets: sphere 1e-6 (series); cylinder 4e-3 (finite length); plate 0.021 and trihedral 0.144 (physical optics "
        "against the method of moments on the same sections in two dimensions)",
    ),
    "near": ("physical optics by near-field quadrature, all orders of the three faces", 0.06,
             "physical optics against the method of moments on the same section in two dimensions"),
    "empty_room": (
        f"image sources of up to {ORDERS} bounces, vector reflection at each wall", 1e-3,
        "truncation 2e-4; reflection coefficients at the centre of the sweep 2e-4; curvature of the wave 3e-4 per bounce (an estimate)",
    ),
    "object_in_room": (FIELDS, 0.02, "discretisation 2e-3, conversion 4e-3, upper and lower ends of the box 0.02"),
    "furnished_drive": (FIELDS, 0.005, "discretisation 2e-3, conversion 4e-3"),
    ROOMS: (FIELDS, 0.02, "discretisation 2e-3 (thirty seeded rooms) or 0.02 (nine given rooms), conversion 4e-3"),
}  # fmt: skip


def rooms() -> speed.Problem:
    """Return the problem of the full-wave rooms. Each room is one frame of the first transmitter and the first receiver of the IWR1843."""
    radar = furnished.radar()
    first = replace(speed.FULL_WAVE, tx_positions_m=radar.tx_positions_m[:1], rx_positions_m=radar.rx_positions_m[:1])

    def part(folder: Path, name: str) -> speed.Part:
        def reference() -> np.ndarray:
            return fullwave.to_points(*fullwave.field(folder, name))[None, None, None, None]

        return speed.Part(name, fullwave.scene(folder, name), np.eye(4)[None], {}, 1, first, reference)

    parts = [part(folder, name) for folder in (furnished.ROOMS, fullwave.GIVEN) for name in fullwave.names(folder)]
    return speed.Problem(ROOMS, "39 furnished metal rooms", speed.MOMENTS, parts, 1, True, True)


def problems() -> Iterator[speed.Problem]:
    """Yield the problems of the benchmark."""
    turning, driven, exact, full_wave = 30, 25, 11, 3
    yield speed.canonical(turning, exact)
    yield speed.near(turning, exact)
    yield speed.empty_room(driven, full_wave, ORDERS)
    yield speed.object_in_room(turning, full_wave)
    yield speed.furnished_drive(driven, full_wave)
    yield rooms()


def arrays_and_entry(problem: speed.Problem) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return the arrays of a problem's file and the problem's entry in answers.json."""
    arrays: dict[str, np.ndarray] = {}
    scenarios: dict[str, list[dict[str, Any]]] = {}
    for part in problem.parts:
        arrays |= _scene_arrays(part.name, part.scene)
        arrays[f"{part.name}/sensor"] = part.sensor
        arrays |= {f"{part.name}/motion/{name}": poses for name, poses in part.motion.items()}
        arrays[f"{part.name}/answer"] = problem.reference(part)[:, 0, 0, 0].astype(np.complex64)
        scenarios[part.name] = [{"name": s.name, "material": material_to_json(s.material), "role": s.role} for s in part.scene]
    key = problem.name.replace(" ", "_")
    rests_on, known, by = RESTS_ON[key]
    gate = FULL_WAVE_GATE_M if problem.truth == speed.MOMENTS else GATE_M
    radar = problem.parts[0].radar
    names = ("start_frequency_hz", "slope_hz_per_s", "sample_rate_hz", "num_samples", "frame_rate_hz", "chirp_interval")
    ends = {"tx_positions_m": radar.tx_positions_m[0], "rx_positions_m": radar.rx_positions_m[0]}
    described = {name: getattr(radar, name) for name in names} | {name: list(map(float, place)) for name, place in ends.items()}
    entry = {
        "title": problem.title, "file": f"{key}.npz", "rests_on": rests_on, "known_error": known, "known_by": by,
        "gate_m": list(gate), "radar": described, "scenarios": scenarios,
    }  # fmt: skip
    return arrays, entry


def _scene_arrays(name: str, scene: Scene) -> dict[str, np.ndarray]:
    out = {}
    for number, surface in enumerate(scene):
        mesh = surface.mesh
        for kind, array in (("vertices", mesh.vertices), ("faces", mesh.faces.astype(np.int32)), ("normals", mesh.vertex_normals)):
            out[f"{name}/surface_{number}/{kind}"] = np.array(array)
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description="Write the frozen problems and answers of the benchmark.")
    parser.add_argument("--output", type=Path, default=frozen_problems.FOLDER, help="folder of the files (default: the package's)")
    folder = parser.parse_args().output
    if not fullwave.GIVEN.is_dir():
        parser.error(f"the reference data {fullwave.GIVEN} are missing; copy them, because they hold nine of the full-wave rooms")
    entries = {}
    for problem in problems():
        arrays, entry = arrays_and_entry(problem)
        content = frozen_problems.packed(arrays)
        files.write_atomically(folder / entry["file"], content)
        name = entry["file"].removesuffix(".npz")
        entries[name] = {"title": entry["title"], "sha256": hashlib.sha256(content).hexdigest(), **entry}
        print(f"{name}: {len(entry['scenarios'])} scenarios, {len(content):,} bytes", flush=True)
    index = {"format": frozen_problems.FORMAT, "version": VERSION, "licence": "Apache-2.0", "problems": entries}
    files.write_atomically(folder / frozen_problems.INDEX, json.dumps(index, indent=1) + "\n")


if __name__ == "__main__":
    main()
