"""Echoes of metal corner reflectors by iterative physical optics: each face is lit by the currents of all other faces, order by order.

    J_1 = 2 n x H_i,   J_(m+1) = 2 n x H(J_m),   H(J) = integral of (jk - 1/R) exp(j k R)/(4 pi R) (R^ x J) dS,   E_s = sum over m of E(J_m)

Symbols: J -> surface current, n -> normal on the lit side, H_i -> magnetic field of the source, R -> distance. Every order is a quadrature
over the true faces, so that the diffraction of light which misses a face is included, unlike geometric optics on the way to the last face.
The faces must all see each other and the source, as the inner faces of a corner reflector do. Time factor exp(-j omega t).

Ref: F. Obelleiro-Basteiro, J. L. Rodriguez, R. J. Burkholder, IEEE Trans. AP 43 (1995) 356.
"""

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

CELLS_PER_WAVELENGTH = 2.25  # along each edge of a face; every cell is two triangles


class _Face(NamedTuple):
    """Hold the middles (N, 3) and the areas (N,) of small triangles of a face, and the face's unit normal on the lit side."""

    points: np.ndarray
    areas: np.ndarray
    normal: np.ndarray


def iterative_echoes(faces: Sequence[np.ndarray], places: np.ndarray, axis: np.ndarray, wavelength: float, orders: int) -> np.ndarray:
    """Return the received amplitudes (P,) of faces at radars, with the phase exp(+j k L), as `nearfield.panel_quadrature` does.

    The error of the sums falls with the square of the number of cells. Two numbers of cells, 2 to 3, give the limit of small cells.

    Args:
        faces: corners (n, 3) of each convex face, in metres. places: (P, 3) of the radars. axis: (3,) of their linear antennas.
        wavelength: metres. orders: number of reflections.
    """
    coarse, fine = (_echoes([_divided(face, places[0], wavelength, n) for face in faces], places, axis, wavelength, orders) for n in (2, 3))
    return (9 * fine - 4 * coarse) / 5


def _echoes(faces: Sequence[_Face], places: np.ndarray, axis: np.ndarray, wavelength: float, orders: int) -> np.ndarray:
    """Return the received amplitudes (P,) of divided faces."""
    wavenumber = 2 * np.pi / wavelength
    waves = [_waves(face.points, places, axis, wavenumber) for face in faces]
    # currents 2 n x (k x E), whose received field along the antenna's axis across the ray has the weight j/(8 pi) and the same wave
    currents = [2 * np.cross(face.normal, np.cross(ray, field)) for face, (ray, field) in zip(faces, waves, strict=True)]
    pairs = list(combinations(range(len(faces)), 2)) if orders > 1 else []
    gradients = {(s, t): _gradient(faces[s].points, faces[t].points, wavenumber) for s, t in pairs}
    total = np.zeros(len(places), complex)
    for order in range(orders):
        for face, (_, field), current in zip(faces, waves, currents, strict=True):
            total += 1j / (8 * np.pi) * np.einsum("n,pni,pni->p", face.areas, current, field)
        if order + 1 < orders:
            induced = [np.zeros_like(current) for current in currents]
            for (s, t), gradient in gradients.items():
                induced[s] += _induced(faces[t], currents[t], faces[s], gradient)
                induced[t] += _induced(faces[s], currents[s], faces[t], gradient.T)
            currents = induced
    return total


def _divided(face: np.ndarray, place: np.ndarray, wavelength: float, share: int) -> _Face:
    """Return a convex face in small triangles, `share` thirds of CELLS_PER_WAVELENGTH along its edges."""
    corners = np.asarray(face, float)
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    points, areas = [], []
    for b, c in zip(corners[1:-1], corners[2:], strict=True):
        a = corners[0]
        longest = max(np.linalg.norm(b - a), np.linalg.norm(c - a))
        count = share * int(np.ceil(longest / wavelength * CELLS_PER_WAVELENGTH / 3))
        for upper in (0, 1):
            i, j = np.nonzero(np.add.outer(np.arange(count), np.arange(count)) < count - upper)
            u, v = ((index + (1 + upper) / 3) / count for index in (i, j))
            points.append(a + u[:, None] * (b - a) + v[:, None] * (c - a))
            areas.append(np.full(len(u), np.linalg.norm(np.cross(b - a, c - a)) / 2 / count**2))
    return _Face(np.concatenate(points), np.concatenate(areas), normal * np.sign((place - corners[0]) @ normal) / np.linalg.norm(normal))


def _waves(points: np.ndarray, places: np.ndarray, axis: np.ndarray, wavenumber: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the rays (P, N, 3) from places to points, and the fields (P, N, 3) of antennas: the axis across the ray over the distance."""
    ray = points - places[:, None]
    distance = np.linalg.norm(ray, axis=2, keepdims=True)
    ray /= distance
    across = axis - (ray @ axis)[..., None] * ray
    return ray, across / np.linalg.norm(across, axis=2, keepdims=True) * np.exp(1j * wavenumber * distance) / distance


def _gradient(here: np.ndarray, there: np.ndarray, wavenumber: float) -> np.ndarray:
    """Return the slope (N, M) of the Green function along the way between points (N, 3) and (M, 3), over their distance."""
    gradient = np.empty((len(here), len(there)), np.complex64)
    here, there, wavenumber = here.astype(np.float32), there.astype(np.float32), np.float32(wavenumber)
    for row, point in zip(gradient, here, strict=True):
        distance = np.sqrt(((there - point) ** 2).sum(axis=1))
        phase, weight = wavenumber * distance, np.float32(1 / (4 * np.pi)) / distance**3
        cosine, sine = np.cos(phase), np.sin(phase)
        row.real, row.imag = -weight * (cosine + phase * sine), weight * (phase * cosine - sine)
    return gradient


def _induced(source: _Face, currents: np.ndarray, face: _Face, gradient: np.ndarray) -> np.ndarray:
    """Return the currents 2 n x H (P, M, 3) that currents (P, N, 3) of another face induce on a face.

    For points x and y of the faces, the sum over y of g (x - y) x J is x times the sum of g J, less the sum of g y x J.
    """
    moments = source.areas[:, None] * np.concatenate([currents, np.cross(source.points, currents)], axis=2)
    columns = moments.transpose(1, 0, 2).reshape(len(source.points), -1).astype(np.complex64)
    sums = (gradient @ columns).reshape(len(face.points), len(currents), 6).transpose(1, 0, 2)
    return 2 * np.cross(face.normal, np.cross(face.points, sums[..., :3]) - sums[..., 3:])
