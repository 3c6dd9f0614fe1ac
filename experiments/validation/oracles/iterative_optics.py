"""Echoes of metal faces by iterative physical optics: each face is lit by the currents of all other faces, order by order.

    J_1 = 2 n x H_i,   J_(m+1) = 2 n x H(J_m),   H(J) = integral of (jk - 1/R) exp(j k R)/(4 pi R) (R^ x J) dS,   E_s = sum over m of E(J_m)

Symbols: J -> surface current, n -> normal on the lit side, H_i -> magnetic field of the source, R -> distance. Every order is a quadrature
over the true faces, so that the diffraction of light which misses a face is included, unlike geometric optics on the way to the last face.
The faces must all see each other and the source, as the inner faces of a corner reflector do. Time factor exp(-j omega t).

Ref: F. Obelleiro-Basteiro, J. L. Rodriguez, R. J. Burkholder, IEEE Trans. AP 43 (1995) 356.
"""

from collections.abc import Sequence

import numba
import numpy as np

CELLS_PER_WAVELENGTH = 3.0  # along each edge of a face; every cell is two triangles, so that the points are closer than a third


def iterative_echo(faces: Sequence[np.ndarray], place: np.ndarray, axis: np.ndarray, wavelength: float, orders: int) -> complex:
    """Return the received amplitude of faces at a radar, with the phase exp(+j k L), as `nearfield.panel_quadrature` does.

    Args:
        faces: corners (n, 3) of each convex face, in metres. place: (3,) of the radar. axis: (3,) of its linear antenna.
        wavelength: metres. orders: number of reflections.
    """
    wavenumber = 2 * np.pi / wavelength
    grids = [_points(np.asarray(face, float), wavelength / CELLS_PER_WAVELENGTH) for face in faces]
    normals = []
    for points, _, normal in grids:
        normals.append(normal * np.sign((place - points[0]) @ normal))
    currents = [_lit(points, normal, place, axis, wavenumber) for (points, _, _), normal in zip(grids, normals, strict=True)]
    total = 0j
    for order in range(orders):
        total += sum(_received(grid[0], grid[1], current, place, axis, wavenumber) for grid, current in zip(grids, currents, strict=True))
        if order + 1 < orders:
            currents = [
                sum(
                    (_onto(grids[s][0], grids[s][1], currents[s], grids[t][0], normals[t], wavenumber) for s in range(len(grids)) if s != t),
                    np.zeros(grids[t][0].shape, complex),
                )
                for t in range(len(grids))
            ]
    return complex(total)


def _points(face: np.ndarray, spacing_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the middles (N, 3) of small triangles of a convex face, their areas (N,), and the unit normal of the face."""
    normal = np.cross(face[1] - face[0], face[2] - face[0])
    points, areas = [], []
    for b, c in zip(face[1:-1], face[2:], strict=True):
        a, count = face[0], int(np.ceil(max(np.linalg.norm(b - face[0]), np.linalg.norm(c - face[0])) / spacing_m))
        for upper in (0, 1):
            i, j = np.nonzero(np.add.outer(np.arange(count), np.arange(count)) < count - upper)
            u, v = ((index + (1 + upper) / 3) / count for index in (i, j))
            points.append(a + u[:, None] * (b - a) + v[:, None] * (c - a))
            areas.append(np.full(len(u), np.linalg.norm(np.cross(b - a, c - a)) / 2 / count**2))
    return np.concatenate(points), np.concatenate(areas), normal / np.linalg.norm(normal)


def _lit(points: np.ndarray, normal: np.ndarray, source: np.ndarray, axis: np.ndarray, wavenumber: float) -> np.ndarray:
    """Return the currents 2 n x H (N, 3) of a source whose electric field is its axis across the ray over the distance."""
    ray = points - source
    distance = np.linalg.norm(ray, axis=1, keepdims=True)
    ray /= distance
    electric = axis - (ray @ axis)[:, None] * ray
    electric = electric / np.linalg.norm(electric, axis=1, keepdims=True) * np.exp(1j * wavenumber * distance) / distance
    return 2 * np.cross(normal, np.cross(ray, electric))


def _received(
    points: np.ndarray, areas: np.ndarray, current: np.ndarray, place: np.ndarray, axis: np.ndarray, wavenumber: float
) -> complex:
    """Return the amplitude of the field of currents at the place, along the antenna's axis across each ray."""
    ray = place - points
    distance = np.linalg.norm(ray, axis=1)
    ray /= distance[:, None]
    across = axis - (ray @ axis)[:, None] * ray
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return complex((1j / (8 * np.pi)) * np.sum(areas * np.exp(1j * wavenumber * distance) / distance * np.einsum("ni,ni->n", current, across)))


@numba.njit(parallel=True, fastmath=True)
def _onto(points, areas, current, targets, normal, wavenumber):
    """Return the currents 2 n x H (M, 3) that currents (N, 3) at points induce at targets (M, 3) of a face."""
    out = np.zeros((len(targets), 3), np.complex128)
    for m in numba.prange(len(targets)):
        h_x, h_y, h_z = 0j, 0j, 0j
        for n in range(len(points)):
            x, y, z = targets[m, 0] - points[n, 0], targets[m, 1] - points[n, 1], targets[m, 2] - points[n, 2]
            distance = np.sqrt(x * x + y * y + z * z)
            phase = wavenumber * distance
            # gradient of the Green function along the ray, over the distance, because x, y, z are not normalised
            g = areas[n] * complex(-1 / distance, wavenumber) * complex(np.cos(phase), np.sin(phase)) / (4 * np.pi * distance * distance)
            h_x += g * (y * current[n, 2] - z * current[n, 1])
            h_y += g * (z * current[n, 0] - x * current[n, 2])
            h_z += g * (x * current[n, 1] - y * current[n, 0])
        out[m, 0] = 2 * (normal[1] * h_z - normal[2] * h_y)
        out[m, 1] = 2 * (normal[2] * h_x - normal[0] * h_z)
        out[m, 2] = 2 * (normal[0] * h_y - normal[1] * h_x)
    return out
