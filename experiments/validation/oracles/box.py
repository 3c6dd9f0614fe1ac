"""All image sources of an empty rectangular room, with vector reflection at every wall. Ref: J. Allen, D. Berkley, JASA 65 (1979) 943.

The unfolded path to the image with (i, j, k) reflections along x, y, z is a straight line that crosses the image's walls one after another.
A monostatic path into an edge or corner crosses several walls at one point; each order of them is weighted by its share of the directions
in which the line can be shifted aside, because the stationary phase weights all directions alike.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import product

import numpy as np

from experiments.validation.oracles.case import SPEED_OF_LIGHT

Reflection = Callable[[float], tuple[complex, complex]]  # (te, tm) at a cosine of incidence, exp(+j omega t)
TURNS = 720  # number of directions in which a line is shifted
ASIDE = 1e-7


def images(size_m: np.ndarray, sensor_m: np.ndarray, bounces: int) -> Iterator[tuple[np.ndarray, np.ndarray, list[tuple[int, float]]]]:
    """Yield every image of 1 to `bounces` reflections as (index (3,), position (3,), walls [(axis, coordinate)] of its path)."""
    for index in product(range(-bounces, bounces + 1), repeat=3):
        if not 1 <= sum(map(abs, index)) <= bounces:
            continue
        place = np.array([n * s + (x if n % 2 == 0 else s - x) for n, s, x in zip(index, size_m, sensor_m, strict=True)])
        walls = []
        for axis, n in enumerate(index):
            walls += [(axis, m * size_m[axis]) for m in (range(1, n + 1) if n > 0 else range(0, n, -1))]
        yield np.array(index), place, walls


def image_sum(
    size_m: np.ndarray, sensor_m: np.ndarray, axis: np.ndarray, reflection: Reflection, bounces: int, frequency_hz: np.ndarray
) -> np.ndarray:
    """Return the received amplitude (F,) of all images between isotropic antennas at one point, with the phase exp(+j k L). The room of
    `size_m` (3,) has a corner at the origin, `axis` is the polarisation of both antennas before its projection across the ray, and
    `reflection` returns (te, tm) of all walls from the cosine of incidence.
    """
    total = np.zeros(len(frequency_hz), complex)
    for amplitude, length, _ in image_paths(size_m, sensor_m, axis, reflection, bounces):
        total += (
            amplitude * SPEED_OF_LIGHT / (4 * np.pi * frequency_hz * length) * np.exp(2j * np.pi * frequency_hz / SPEED_OF_LIGHT * length)
        )
    return total


def image_paths(
    size_m: np.ndarray, sensor_m: np.ndarray, axis: np.ndarray, reflection: Reflection, bounces: int
) -> Iterator[tuple[complex, float, int]]:
    """Yield for every image (product of reflection coefficients and polarisations, path length in metres, number of bounces)."""
    for index, place, walls in images(size_m, sensor_m, bounces):
        line = place - sensor_m
        length = float(np.linalg.norm(line))
        direction = line / length
        received = sum(
            (
                share * carried([walls[w][0] for w in order], direction, axis, [reflection] * len(order))
                for order, share in orders(direction, walls, sensor_m)
            ),
            0j,
        )
        yield received, length, int(np.abs(index).sum())


def orders(direction: np.ndarray, walls: list[tuple[int, float]], sensor_m: np.ndarray) -> Iterator[tuple[tuple[int, ...], float]]:
    """Yield every order (indices of `walls`) in which a path can cross its walls, with its share of the shift directions."""
    first = np.eye(3)[np.argmin(np.abs(direction))]
    u = np.cross(direction, first)
    u /= np.linalg.norm(u)
    angle = 2 * np.pi * (np.arange(TURNS) + 0.37) / TURNS
    around = direction + ASIDE * (np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * np.cross(direction, u))
    reached = np.stack([(coordinate - sensor_m[axis]) / around[:, axis] for axis, coordinate in walls], axis=1)
    orders, counts = np.unique(np.argsort(reached, axis=1, kind="stable"), axis=0, return_counts=True)
    for order, count in zip(orders, counts, strict=True):
        yield tuple(int(w) for w in order), count / TURNS


def across(axis: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """Return the component of `axis` perpendicular to the ray, normalised to a unit vector."""
    field = axis - (axis @ ray) * ray
    return field / np.linalg.norm(field)


def carried(axes: Sequence[int], direction: np.ndarray, axis: np.ndarray, reflections: Sequence[Reflection]) -> complex:
    """Return the received field of a path that hits walls perpendicular to `axes`, with one entry of `reflections` each."""
    ray = direction.copy()
    field = across(axis, ray).astype(complex)
    for wall, reflection in zip(axes, reflections, strict=True):
        normal = np.eye(3)[wall]
        te, tm = reflection(abs(float(ray[wall])))
        side = np.cross(ray, normal)
        size = np.linalg.norm(side)
        side = side / size if size > 1e-9 else across(np.eye(3)[wall - 1], ray)
        mirrored = ray - 2 * ray[wall] * normal
        field = te * (field @ side) * side + tm * (field @ np.cross(ray, side)) * np.cross(mirrored, side)
        ray = mirrored
    return complex(np.conj(across(axis, ray) @ field))
