"""Echoes of metal corner reflectors by iterative physical optics: each face is lit by the currents of all other faces, order by order.

    J_1 = 2 n x H_i,   J_(m+1) = 2 n x H(J_m),   H(J) = integral of (jk - 1/R) exp(j k R)/(4 pi R) (R^ x J) dS,   E_s = sum over m of E(J_m)

Symbols: J -> surface current, n -> normal on the lit side, H_i -> magnetic field of the source, R -> distance. Every order is a quadrature
over the true faces, so that the diffraction of light which misses a face is included, unlike geometric optics on the way to the last face.
Time factor exp(-j omega t).

Two perpendicular faces share a fold. The field of one on the other depends on the difference of the places along the fold, so that the sum
along the fold is a convolution.

Ref: F. Obelleiro-Basteiro, J. L. Rodriguez, R. J. Burkholder, IEEE Trans. AP 43 (1995) 356.
"""

from itertools import combinations

import numpy as np
import scipy.fft

from experiments.validation.oracles.nearfield import panel_quadrature

CELLS_PER_WAVELENGTH = 4.5  # along each edge; the product of current and Green function has up to two cycles per wavelength
AXIS = np.array([0.0, 0.0, 1.0])  # of the antennas
ORDERS = {"dihedral": 2, "trihedral": 3}
# unit vectors along the edges that meet in the corner; the first of a dihedral is its fold
DIHEDRAL = np.array([[0, 0, 1], [np.sqrt(0.5), np.sqrt(0.5), 0], [np.sqrt(0.5), -np.sqrt(0.5), 0]])
TRIHEDRAL = np.sqrt(np.array([[1, 0, 2], [1, 1.5, 0.5], [1, 1.5, 0.5]]) / 3) * [[1, 1, 1], [1, 1, -1], [1, -1, -1]]


def corner_echoes(shape: str, size_m: float, places: np.ndarray, wavelength: float) -> np.ndarray:
    """Return the amplitudes (P,) of a "dihedral", "trihedral" or "plate" (one face) with edges of `size_m` at radars at `places` (P, 3),
    from which all inner faces are seen, with the phase exp(+j k L), as `nearfield.panel_quadrature` does.

    The error of the sums falls with the square of the number of cells. Two numbers of cells, 2 to 3, give the limit of small cells.
    """
    counts = int(np.ceil(size_m / wavelength * CELLS_PER_WAVELENGTH / 3)) * np.array([2, 3])
    if shape == "plate":
        y, z = 0.5 * size_m * np.array([[-1, 1, 1, -1], [-1, -1, 1, 1]])
        plate = np.stack([0 * y, y, z], axis=1)
        return np.array([panel_quadrature(plate, place, wavelength) for place in np.atleast_2d(places)])
    coarse, fine = (_echoes(shape, size_m, np.atleast_2d(places), wavelength, n, ORDERS[shape]) for n in counts)
    return (9 * fine - 4 * coarse) / 5


def _echoes(shape: str, size_m: float, places: np.ndarray, wavelength: float, n: int, orders: int) -> np.ndarray:
    """Return the amplitudes (P,) from n x n cells on each face."""
    apex, axes = np.zeros(3), TRIHEDRAL
    if shape == "dihedral":
        apex, axes = -size_m / 2 * AXIS, DIHEDRAL
    if ((places - apex) @ axes.T <= 0)[:, 1 if shape == "dihedral" else 0 :].any():
        raise ValueError(f"a {shape}'s inner faces are not all seen from every place")
    wavenumber, cells = 2 * np.pi / wavelength, (np.arange(n) + 0.5) * size_m / n
    pairs = [(0, 1), (0, 2)] if shape == "dihedral" else list(combinations(range(3), 2))
    area = np.full((n, n), (size_m / n) ** 2)
    if shape == "trihedral":  # half a cell on the longest edge
        area *= 0.5 * (np.sign(n - 1 - np.add.outer(np.arange(n), np.arange(n))) + 1)
    slopes = _slopes(cells, wavenumber)
    # (axis along the current, face) -> current (cells of the face's first axis, cells of its second axis, P), and the received field
    current, field = {}, {}
    for i, j in pairs:
        points = apex + cells[:, None, None] * axes[i] + cells[:, None] * axes[j]
        ray, wave = _waves(points, places, wavenumber)
        flow = 2 * np.cross(axes[3 - i - j], np.cross(ray, wave))
        for axis in (i, j):
            current[axis, i, j], field[axis, i, j] = area[..., None] * (flow @ axes[axis]), wave @ axes[axis]
    total = np.zeros(len(places), complex)
    for order in range(orders):
        total += 1j / (8 * np.pi) * sum((current[key] * field[key]).sum(axis=(0, 1)) for key in current)
        if order + 1 < orders:
            induced = {key: np.zeros_like(value) for key, value in current.items()}
            for source in pairs:
                for face in pairs:
                    if source != face:
                        _induce(source, face, current, cells, slopes, induced)
            current = {key: area[..., None] * value for key, value in induced.items()}
    return total


def _waves(points: np.ndarray, places: np.ndarray, wavenumber: float) -> tuple[np.ndarray, np.ndarray]:
    """Return rays (..., P, 3) from places to points, and the fields (..., P, 3) of antennas: the axis across the ray over the distance."""
    ray = points[..., None, :] - places
    distance = np.linalg.norm(ray, axis=-1, keepdims=True)
    ray /= distance
    across = AXIS - (ray @ AXIS)[..., None] * ray
    return ray, across / np.linalg.norm(across, axis=-1, keepdims=True) * np.exp(1j * wavenumber * distance) / distance


def _slopes(cells: np.ndarray, wavenumber: float) -> np.ndarray:
    """Return the spectrum (2n, n, n) along the fold of the Green function's slope over the distance, for two perpendicular faces."""
    along = np.arange(len(cells) + 1) * (cells[1] - cells[0])
    distance = np.sqrt(along[:, None, None] ** 2 + cells[:, None] ** 2 + cells**2)
    slope = (1j * wavenumber - 1 / distance) * np.exp(1j * wavenumber * distance) / (4 * np.pi * distance**2)
    mirrored = np.concatenate([slope, slope[-2:0:-1]]).astype(np.complex64)
    return np.asarray(scipy.fft.fft(mirrored, axis=0, overwrite_x=True))


def _induce(source: tuple, face: tuple, current: dict, cells: np.ndarray, slopes: np.ndarray, induced: dict) -> None:
    """Add the currents 2 n x H that the currents of one face induce on another one.

    The faces have the axes (x, y) and (x, z). H is -z sum of g J_y along x, and x sum of g J_y - sum of g (x' J_y - y J_x) along z.
    """
    (x,) = set(source) & set(face)
    (y,), (z,) = set(source) - {x}, set(face) - {x}
    j_x, j_y = ((component if source[0] == x else component.swapaxes(0, 1)) for component in (current[x, *source], current[y, *source]))
    turning = cells[:, None, None] * j_y - cells[:, None] * j_x
    spectrum = scipy.fft.fft(np.concatenate([j_y, turning], axis=2).astype(np.complex64), 2 * len(cells), axis=0)
    first, second = np.split(np.asarray(scipy.fft.ifft(slopes @ spectrum, axis=0))[: len(cells)], 2, axis=2)
    for axis, value in ((x, cells[:, None, None] * first - second), (z, cells[:, None] * first)):
        induced[axis, *face] += 2 * (value if face[0] == x else value.swapaxes(0, 1))
