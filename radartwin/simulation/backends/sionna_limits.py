"""What Sionna RT cannot return of a scene, seen from what it returned.

A facet reflects as an infinite mirror, or not at all. A flat face of area A at distance d returns at most 2 A/(lambda d) of a mirror's
field: below one, the mirror's level is too high. A curved or cornered object mostly has no mirror point on any facet. Diffuse paths carry
the phase of their length alone and are added as fields: about the mirror direction they agree, and their sum grows with their number.
"""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from radartwin.scene.scene import Surface

if TYPE_CHECKING:
    from radartwin.simulation.backends.sionna import Mesh

COPLANAR_COSINE, COPLANAR_M = 1 - 1e-6, 1e-4


def met(surfaces: Sequence[Surface], mesh: "Mesh", found: dict[str, np.ndarray], wavelength_m: float, diffuse: bool) -> Iterator[str]:
    """One sentence per limit that a scene met.

    Args:
        found: the worker's answer: pose (N,), face (N, D), length_m (N,).
    """
    silent = _silent(surfaces, mesh, found["face"])
    if silent:
        yield f"sionna: no path by way of {_listed(silent)}: facets that are corners or curves mirror nothing back to their source"
    over = _too_small(surfaces, mesh, found, wavelength_m)
    if over:
        worst = max(over, key=lambda name: over[name])
        yield (
            f"sionna: {_listed(list(over))} returns the level of an infinite mirror, "
            f"{'up to ' if len(over) > 1 else ''}{over[worst]:.1f} dB more than its area can"
        )
    if diffuse and found["scattered"].any():
        yield "sionna: diffuse paths are added coherently; their level grows with `rays` and is no power"


def _silent(surfaces: Sequence[Surface], mesh: "Mesh", face: np.ndarray) -> list[str]:
    """Objects that no path leads over."""
    heard = set(np.unique(mesh.surface[face[face >= 0]]).tolist())
    return [s.name or f"surface {i}" for i, s in enumerate(surfaces) if s.kind == "object" and i not in heard]


def _too_small(surfaces: Sequence[Surface], mesh: "Mesh", found: dict[str, np.ndarray], wavelength_m: float) -> dict[str, float]:
    """Excess in dB by name, of surfaces whose flat face under a single bounce is less than half a wavelength times its distance."""
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
