"""Check the capabilities of those radar simulation systems that this project can run. Each check of a capability takes seconds and
simulates no whole recording.

A check returns two values: the content of the system's cell in the table, and whether this content agrees with the paper's cell.
"""

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from radartwin.radar.chirp import Radar
from radartwin.scene import objects
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories import trajectory
from radartwin.simulation.backends.backend import Backend, backend
from radartwin.simulation.backends.sionna_scene import quiet
from radartwin.simulation.paths import Paths

Check = Callable[[], tuple[str, bool]]
ROOM_M = (4.0, 3.0, 2.5)
BOUNCES = 4  # number of bounces in RadarTwin's row of the paper's Table 1
FORMATS = (".glb", ".ply", ".obj")
CATEGORIES = 23  # number of MINC categories
RADAR = Radar.iwr1843(element="isotropic")


def _box(material: str = "concrete") -> Scene:
    mesh = objects.box((0.0, 0.0, 0.0), ROOM_M)
    mesh.invert()
    return Scene([Surface(mesh, material, "walls", role="room")])


def _traced(simulator: Backend, scene: Scene) -> list[Paths]:
    place = trajectory.look_at(np.array([1.23, 1.1, 1.05]), np.array([4.0, 1.4, 1.2]))
    with quiet():
        return simulator.paths(scene, RADAR, place[None])


def _tracer() -> Backend:
    return backend("mitsuba", room="tubes", rays=50_000, max_bounces=BOUNCES)


def _multipath(simulator: Callable[[], Backend], bounces: int | None = None) -> tuple[str, bool]:
    """Check that paths have more than one bounce, or the given largest number of bounces."""
    most = max(int(part.bounces.max()) for part in _traced(simulator(), _box()))
    return (f"yes ({most}-bounce)" if most > 1 else "no (1-bounce)"), most > 1 if bounces is None else most == bounces


def _ray_tracing() -> tuple[str, bool]:
    """Check that rays from the radar find the nearest surface of a room, its floor, at its true range."""
    nearest = min(float(part.length_m.min()) / 2 for part in _traced(_tracer(), _box()))
    return "ray tracing", abs(nearest - 1.05) < 0.02


def _mesh_formats() -> tuple[str, bool]:
    """Check that a room's mesh keeps its surface area in every supported file format."""
    from radartwin.reconstruct.scan_file import load_scan

    mesh, read = _box().surfaces[0].mesh, []
    with tempfile.TemporaryDirectory() as folder:
        for suffix in FORMATS:
            mesh.export(Path(folder) / f"room{suffix}")
            scanned, _ = load_scan(Path(folder) / f"room{suffix}", unit="m", up="z")
            read.append(bool(np.isclose(scanned.area, mesh.area, rtol=1e-4)))
    return f"3D scene repr. ({', '.join(FORMATS)})", all(read)


def _scanned_room() -> tuple[str, bool]:
    """Check that a mesh as from a phone scan (one piece of small noisy triangles) is reconstructed as a room with walls."""
    from radartwin.reconstruct.build import ScanOptions, reconstruct

    mesh: Any = _box().surfaces[0].mesh.subdivide_to_size(0.12)
    mesh.vertices += np.random.default_rng(0).normal(0, 0.003, mesh.vertices.shape)
    with tempfile.TemporaryDirectory() as folder:
        mesh.export(Path(folder) / "scan.ply")
        scene = reconstruct(Path(folder) / "scan.ply", options=ScanOptions(unit="m", up="z"))
    area = sum(s.mesh.area for s in scene)
    walls = 2 * (ROOM_M[0] * ROOM_M[1] + ROOM_M[0] * ROOM_M[2] + ROOM_M[1] * ROOM_M[2])
    return "yes", bool(len(scene) >= 6 and abs(area - walls) < 0.05 * walls)


def _labelled() -> tuple[str, bool]:
    """Check that the vision-language model's recorded answers map to materials of the package, and that every category has a material."""
    from radartwin import materials
    from radartwin.label.material_sources import material_source
    from radartwin.materials.minc import MINC, names_in
    from radartwin.scene import rooms

    scene = material_source("vlm")(rooms.room("lab", detail="shell"))
    answered = all(s.provenance["source"] == "vlm" for s in scene)
    several = len({str(s.material) for s in scene}) > 1
    known = all(name in materials.MATERIAL_NAMES for row in MINC.values() for name in names_in(row.material))
    return "VLM -> ITU", answered and several and known and len(MINC) == CATEGORIES


def _no_measurement() -> tuple[str, bool]:
    """Check that no module that reconstructs scenes, assigns materials or simulates imports a module that reads measured recordings."""
    from radartwin.source_files import closure

    reached = closure(("radartwin.reconstruct.build", "radartwin.label.material_sources", "radartwin.simulation.simulate"))
    return "yes", not any(name.startswith(("radartwin.recordings", "radartwin.testbed")) for name in reached)


def _targets() -> tuple[str, bool]:
    """Check that the catalogue has objects of more than one shape class and more than one material class."""
    entries = objects.catalogue().values()
    classes = [{getattr(entry, kind) for entry in entries} for kind in ("shape", "material_class")]
    return "objects & materials", all(len(kinds) > 1 for kinds in classes)


def _per_surface(simulator: Callable[[], Backend], words: str, matters: bool) -> tuple[str, bool]:
    """Check whether a metal room returns more power than the same room of wood."""
    metal, wood = (sum(float(np.abs(p.amplitude).max()) for p in _traced(simulator(), _box(m))) for m in ("metal", "wood"))
    per_surface = metal > 1.5 * wood
    return (words if per_surface == matters else "per surface" if per_surface else "uniform"), per_surface == matters


def _sionna() -> Backend:
    return backend("sionna", rays=100_000, max_bounces=BOUNCES)


def _naive() -> Backend:
    return backend("rfgenesis", version="shipped", grid=32)


CHECKS: dict[str, dict[str, Check]] = {
    "RadarTwin": {
        "mechanism": _ray_tracing, "scene input": _mesh_formats, "material model": _labelled,
        "multipath": partial(_multipath, _tracer, BOUNCES), "real scene": _scanned_room, "no RF data": _no_measurement, "target": _targets,
    },
    "Sionna RT": {"material model": partial(_per_surface, _sionna, "per-surf.", True), "multipath": partial(_multipath, _sionna)},
    "RF-Genesis": {"material model": partial(_per_surface, _naive, "uniform", False), "multipath": partial(_multipath, _naive)},
}  # fmt: skip
