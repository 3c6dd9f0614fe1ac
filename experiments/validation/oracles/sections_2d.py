"""Error of physical optics on the sections of plates and corners, in two dimensions, against the method of moments.

The benchmark's answers for plates and trihedrals are near-field physical optics, which lacks edge currents, and no exact field of these
targets is available. Sizes, distances and angles are those of the benchmark; the electric field is along the strips.

    E_s(r) = -integral of G(r, r') dE/dn(r') ds',  dE/dn = 2 dE_i/dn on the lit side

Symbols: G = (j/4) H0(1)(k |r - r'|), n -> normal, E_i -> field of the source, or minus that of its image in the strip that a path hits
first. `python -m experiments.validation.oracles.sections_2d` prints the errors.
"""

from collections.abc import Sequence
from itertools import permutations

import numpy as np
from scipy.special import hankel1

from experiments.validation.oracles import moments_2d
from experiments.validation.oracles.case import SPEED_OF_LIGHT

PER_WAVELENGTH = 12  # midpoints per wavelength of the quadrature
FREQUENCIES_HZ = np.linspace(77.0e9, 80.4e9, 4)
TURN_DEG = 1.44  # turn of the benchmark's turntable per frame
FRAMES = 11  # number of frames of each shape


def optics(strips: np.ndarray, frequency_hz: float) -> complex:
    """Return the field that strips (S, 2, 2) scatter back to the origin, over all paths that hit each strip at most once."""
    orders = [order for count in (1, 2) for order in permutations(range(len(strips)), count)]
    return sum((_path([strips[i] for i in order], 2 * np.pi * frequency_hz / SPEED_OF_LIGHT) for order in orders), 0j)


def exact(strips: np.ndarray, frequency_hz: float) -> complex:
    """Return the field that `optics` approximates, by the method of moments."""
    origin = np.zeros(2)
    return complex(moments_2d.field(moments_2d.nodes([strips], frequency_hz), frequency_hz, origin, origin[None], np.complex128)[0])


def _path(strips: Sequence[np.ndarray], k: float) -> complex:
    source, sign = np.zeros(2), 1.0
    for first in strips[:-1]:
        normal, offset = _line(first)
        source, sign = source + 2 * (offset - normal @ source) * normal, -sign
    last = strips[-1]
    normal, offset = _line(last)
    side = normal @ source - offset
    if side * (0.0 - offset) <= 0:  # the receiver is at the origin
        return 0j
    normal = np.sign(side) * normal
    length = float(np.linalg.norm(last[1] - last[0]))
    count = int(np.ceil(length * k / (2 * np.pi) * PER_WAVELENGTH))
    point = last[0] + (np.arange(count)[:, None] + 0.5) / count * (last[1] - last[0])
    line = point - source
    away = np.linalg.norm(line, axis=1)
    lit = np.ones(count, bool) if len(strips) == 1 else _crosses(strips[0], source, point)
    slope = 2 * sign * -0.25j * k * hankel1(1, k * away) * (line @ normal) / away  # 2 dE_i/dn
    received = 0.25j * hankel1(0, k * np.linalg.norm(point, axis=1))
    return complex(-(slope * received * lit).sum() * length / count)


def _line(ends: np.ndarray) -> tuple[np.ndarray, float]:
    """Return unit normal and offset of the line through a strip."""
    along = ends[1] - ends[0]
    normal = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    return normal, float(normal @ ends[0])


def _crosses(strip: np.ndarray, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """Return which lines from one point (2,) to other points (N, 2) pass through a strip."""
    along, way = strip[1] - strip[0], stop - start
    determinant = way[:, 0] * along[1] - way[:, 1] * along[0]
    gap = strip[0] - start
    share = (way[:, 0] * gap[1] - way[:, 1] * gap[0]) / -determinant
    return (share >= 0) & (share <= 1)


def strip(width_m: float, distance_m: float, turn_deg: float) -> np.ndarray:
    """Return a strip (1, 2, 2) whose centre is `distance_m` away and that is turned out of the facing position."""
    angle = np.radians(turn_deg)
    half, centre = width_m / 2 * np.array([-np.sin(angle), np.cos(angle)]), np.array([distance_m, 0.0])
    return np.array([[centre - half, centre + half]])


def corner(face_m: float, distance_m: float, turn_deg: float) -> np.ndarray:
    """Return a right-angled corner (2, 2, 2) that opens towards the origin and whose apex is `distance_m` away."""
    apex = np.array([distance_m, 0.0])
    ends = [apex + face_m * np.array([np.cos(a), np.sin(a)]) for a in np.radians([135 + turn_deg, 225 + turn_deg])]
    return np.array([[apex, ends[0]], [apex, ends[1]]])


def error(shapes: Sequence[np.ndarray]) -> float:
    """Return the norm of the error of physical optics divided by the norm of the exact field, over all shapes and FREQUENCIES_HZ."""
    pairs = np.array([(optics(shape, f), exact(shape, f)) for shape in shapes for f in FREQUENCIES_HZ])
    return float(np.linalg.norm(pairs[:, 0] - pairs[:, 1]) / np.linalg.norm(pairs[:, 1]))


def cases() -> dict[str, list[np.ndarray]]:
    """Return the shapes in the frames of the benchmark: a plate and a trihedral of 10 cm at 1 m, and a trihedral of 15 cm at 0.5 m."""
    turns = TURN_DEG * np.arange(FRAMES)
    return {
        "plate": [strip(0.1, 1.0, turn_deg) for turn_deg in turns],
        "trihedral": [corner(0.1, 1.0, 5.0 + turn_deg) for turn_deg in turns],
        "trihedral 15 cm": [corner(0.15, 0.5, 5.0 + turn_deg) for turn_deg in turns],
    }


def main() -> None:
    for name, shapes in cases().items():
        print(f"{name}: {error(shapes):.4f}")


if __name__ == "__main__":
    main()
