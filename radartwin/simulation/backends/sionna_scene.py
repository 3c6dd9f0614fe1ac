"""Convert a scene to the mesh and the reflection tables that Sionna RT traces, and warn about surfaces whose echoes it computes wrongly.

- Sionna treats each facet as an infinite mirror. A real flat face of area A at distance d returns at most 2 A/(lambda d) times the field of
  an infinite mirror, where lambda is the wavelength. If this ratio is below one, Sionna's echo of the face is too strong.
- A curved object or an object with corners mostly has no mirror reflection point on any of its facets, so Sionna returns no echo.
"""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from radartwin.materials import Layered, reflection
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Surface
from radartwin.simulation import reflection_table
from radartwin.simulation.geometry import MIN_AREA_M2
from radartwin.simulation.poses import ObjectPoses

COSINES = 4096  # least number of cosines of incidence in a reflection table, for errors below 3e-3 up to 89.7 degrees on stud walls
COPLANAR_COSINE, COPLANAR_M = 1 - 1e-6, 1e-4


@dataclass(frozen=True)
class SionnaScene:
    """Hold the surfaces of a scene as one mesh with V vertices and T triangles, and the coefficients of their D different materials."""

    vertices: np.ndarray  # (F, V, 3) vertex positions in the world at F frames, in metres, or (1, V, 3) if no surface moves
    faces: np.ndarray  # (T, 3) vertex indices of the triangles
    surface: np.ndarray  # (T,) index of the scene surface to which each triangle belongs
    poses: Mapping[int, np.ndarray]  # poses (F, 4, 4) of the moving surfaces in the world, by surface index
    te: np.ndarray  # (D, C, Q) TE reflection coefficients at C equally spaced cosines of incidence from 0 to 1
    tm: np.ndarray  # (D, C, Q) TM reflection coefficients
    row: np.ndarray  # (T,) table row of each triangle
    frequencies_hz: np.ndarray  # (Q,) frequency nodes


def convert(surfaces: Sequence[Surface], motion: ObjectPoses, radar: Radar) -> SionnaScene:
    """Merge all surfaces to one mesh, without faces smaller than MIN_AREA_M2. The power that rough surfaces scatter is lost."""
    moving = {i: motion[s.name] for i, s in enumerate(surfaces) if s.name in motion}
    frames = max((len(poses) for poses in moving.values()), default=1)
    vertices, faces, index, count = [np.zeros((frames, 0, 3))], [np.zeros((0, 3), int)], [np.zeros(0, int)], 0
    for i, surface in enumerate(surfaces):
        kept = np.asarray(surface.mesh.faces)[surface.mesh.area_faces > MIN_AREA_M2]
        points, pose = np.asarray(surface.mesh.vertices, float), moving.get(i, np.eye(4)[None])
        vertices.append(np.broadcast_to(np.einsum("fij,vj->fvi", pose[:, :3, :3], points) + pose[:, None, :3, 3], (frames, *points.shape)))
        faces.append(kept + count)
        index.append(np.full(len(kept), i))
        count += len(points)
    owner = np.concatenate(index)
    te, tm, row, frequencies = reflection_tables([(s.material, s.roughness_m) for s in surfaces], radar)
    return SionnaScene(np.concatenate(vertices, axis=1), np.concatenate(faces), owner, moving, te, tm, row[owner], frequencies)


def reflection_tables(
    entries: Sequence[tuple[str | Layered, float]], radar: Radar
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Tabulate the reflection coefficients of the D different pairs (material, rms roughness in metres) in `entries`.

    Returns:
        TE coefficients and TM coefficients (D, C, Q) complex64 at C cosines of incidence, the table row of each entry, and the frequency
        nodes (Q,) in Hz.
    """
    high = radar.start_frequency_hz + radar.sampled_bandwidth_hz
    distinct = list(dict.fromkeys(entries))
    table = reflection_table.build(distinct, radar.start_frequency_hz, high)
    cosines, frequencies = reflection_table.grid_of_cosines(max(COSINES, table.te.shape[1])), table.frequencies_hz
    both = [np.stack(reflection(material, cosines[:, None], frequencies, rough)) for material, rough in distinct]
    te, tm = np.swapaxes(np.array(both, np.complex64), 0, 1)
    return te, tm, np.array([distinct.index(entry) for entry in entries]), frequencies


def limits(surfaces: Sequence[Surface], mesh: SionnaScene, traced: Mapping[str, np.ndarray], wavelength_m: float) -> Iterator[str]:
    """Yield one warning for each limit of Sionna that affects the paths `traced`, which `sionna_worker.trace` returned."""
    names, reached = [s.name or f"surface {i}" for i, s in enumerate(surfaces)], mesh.surface[traced["face"][traced["face"] >= 0]]
    silent = [names[i] for i, s in enumerate(surfaces) if s.kind == "object" and i not in reached]
    if silent:
        yield f"sionna: no path over {_listed(silent)}, because flat facets of corners and curved surfaces reflect no ray back to the radar"
    if excess := {names[surface]: level for surface, level in _excess_db(mesh, traced, wavelength_m).items()}:
        yield (
            f"sionna: the echo of {_listed(list(excess))} has the level of an infinite mirror, "
            f"{'up to ' if len(excess) > 1 else ''}{max(excess.values()):.1f} dB more than that of its area"
        )


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress the warnings of `limits`, for callers whose results show the wrong and missing echoes."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "sionna:")
        yield


def _excess_db(mesh: SionnaScene, traced: Mapping[str, np.ndarray], wavelength_m: float) -> dict[int, float]:
    """Find surfaces whose echo is too strong, because a path reflects once at a flat face with an area below lambda d/2 (d: distance).

    Returns:
        Level of the traced echo minus the level that the area of the face can have, in dB, by surface index.
    """
    single = (traced["face"] >= 0).sum(axis=1) == 1
    excess: dict[int, float] = {}
    corners = mesh.vertices[0][mesh.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1) / 2
    normal = cross / (2 * area)[:, None]
    for face in np.unique(traced["face"][single, 0]):
        away = float(traced["length_m"][single & (traced["face"][:, 0] == face)].max()) / 2
        same = mesh.surface == mesh.surface[face]
        same &= np.abs(normal @ normal[face]) > COPLANAR_COSINE
        same &= np.abs((corners[:, 0] - corners[face, 0]) @ normal[face]) < COPLANAR_M
        share = 2 * float(area[same].sum()) / (wavelength_m * away)
        if share < 1:
            surface = int(mesh.surface[face])
            excess[surface] = max(excess.get(surface, 0.0), -20 * float(np.log10(share)))
    return excess


def _listed(names: Sequence[str]) -> str:
    quoted = ", ".join(repr(name) for name in names[:3])
    return quoted if len(names) <= 3 else f"{quoted} and {len(names) - 3} more"
