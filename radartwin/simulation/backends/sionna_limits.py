"""Warn about surfaces of a scene whose echoes Sionna RT computes wrongly, or suppress these warnings.

- Sionna treats each facet as an infinite mirror. A real flat face of area A at distance d returns at most 2 A/(lambda d) times the field of
  an infinite mirror, where lambda is the wavelength. If this ratio is below one, Sionna's echo of the face is too strong.
- A curved object or an object with corners mostly has no mirror reflection point on any of its facets, so Sionna returns no echo.
- Sionna adds diffuse paths as fields, with phases that follow from the path lengths. Near the mirror direction these paths are in phase, so
  the sum grows with the number of paths.
"""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from radartwin.scene.scene import Surface
from radartwin.simulation.backends.sionna_mesh import Mesh

COPLANAR_COSINE, COPLANAR_M = 1 - 1e-6, 1e-4


def warnings_for(
    surfaces: Sequence[Surface], mesh: Mesh, found: dict[str, np.ndarray], wavelength_m: float, diffuse: bool
) -> Iterator[str]:
    """Yield one warning for each limit of Sionna that affects the scene.

    Args:
        surfaces: surfaces of the scene.
        mesh: merged mesh of these surfaces.
        found: the N paths that `sionna_worker.trace` returned.
        wavelength_m: wavelength in metres.
        diffuse: whether Sionna traced diffuse paths.
    """
    silent = _silent(surfaces, mesh, found["face"])
    if silent:
        yield f"sionna: no path over {_listed(silent)}, because flat facets of corners and curved surfaces reflect no ray back to the radar"
    over = _too_small(surfaces, mesh, found, wavelength_m)
    if over:
        worst = max(over, key=lambda name: over[name])
        yield (
            f"sionna: the echo of {_listed(list(over))} has the level of an infinite mirror, "
            f"{'up to ' if len(over) > 1 else ''}{over[worst]:.1f} dB more than that of its area"
        )
    if diffuse and found["scattered"].any():
        yield "sionna: diffuse paths add coherently, so that their level grows with `rays` and is not the diffuse power"


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress the warnings of `warnings_for`, for callers whose results show the wrong and missing echoes."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "sionna:")
        yield


def _silent(surfaces: Sequence[Surface], mesh: Mesh, face: np.ndarray) -> list[str]:
    """Return the names of objects that no path hits."""
    with_paths = set(np.unique(mesh.surface[face[face >= 0]]).tolist())
    return [s.name or f"surface {i}" for i, s in enumerate(surfaces) if s.kind == "object" and i not in with_paths]


def _too_small(surfaces: Sequence[Surface], mesh: Mesh, found: dict[str, np.ndarray], wavelength_m: float) -> dict[str, float]:
    """Find surfaces whose echo is too strong, because a path reflects once at a flat face with an area below lambda d/2 (d: distance).

    Returns:
        Level of the traced echo minus the level that the area of the face can have, in dB, by surface name.
    """
    single = (found["face"] >= 0).sum(axis=1) == 1
    excess: dict[str, float] = {}
    corners = mesh.vertices[0][mesh.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1) / 2
    normal = cross / (2 * area)[:, None]
    for face in np.unique(found["face"][single, 0]):
        away = float(found["length_m"][single & (found["face"][:, 0] == face)].max()) / 2
        same = mesh.surface == mesh.surface[face]
        same &= np.abs(normal @ normal[face]) > COPLANAR_COSINE
        same &= np.abs((corners[:, 0] - corners[face, 0]) @ normal[face]) < COPLANAR_M
        share = 2 * float(area[same].sum()) / (wavelength_m * away)
        if share < 1:
            index = int(mesh.surface[face])
            name = surfaces[index].name or f"surface {index}"
            excess[name] = max(excess.get(name, 0.0), -20 * float(np.log10(share)))
    return excess


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(repr(name) for name in names[:3])
    return shown if len(names) <= 3 else f"{shown} and {len(names) - 3} more"
