"""Image sources: specular paths that reflect at flat panels, each with a Fresnel factor for the panels' edges and for obstacles.

A sequence of panels p_1 .. p_m mirrors the source to its image S_m; the path to a receiver R is the straight line S_m R. Every panel, and
every obstacle of one of the m + 1 legs, is mirrored in all later panels and projected from S_m onto the last panel's plane (obstacles
of the last leg are projected from R). The aperture is the intersection of the projected panels minus the projected obstacles.
`aperture.polygon_factor` of its convex pieces multiplies the image's field. Fine tubes give the same sum, but the field of images is a
smooth function of the pose and does not depend on a grid. The intersection is essential in a corner of two walls: each of the two sequences
of walls contributes half of the field. The product of the two walls' Fresnel factors would give only a quarter per sequence.

Fields: along a path, E is reflected with TE and TM coefficients in double precision. With the receive polarisation P and the Fresnel factor
F, amplitude(f) = lambda/(4 pi L) P . E_m F.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from radartwin.compiled import shared_out
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.simulation.flat import aperture
from radartwin.simulation.flat.panels import MAX_SIDES, Panels
from radartwin.simulation.reflection_table import ReflectionTable

# The Fresnel factor is evaluated for a receiver that is moved by this offset, in units of 1/k. For a receiver at the sensor, the image in a
# corner of two walls lies exactly behind their edge, where rounding would decide between inside and outside. The offset changes the factor
# by 0.001.
NUDGE = 0.05 * np.array([0.74, 0.53, 0.41])
REACH = 25.0  # Fresnel coordinate beyond which obstacles are ignored; an edge there changes a factor by at most 0.01
SUPPORTS = 24  # largest number of hull points of an obstacle


@dataclass(frozen=True)
class Sequences:
    """Hold S sequences of reflecting panels, with the mirror images and obstacles from which `evaluate` computes the fields of paths.

    Attributes:
        chain: (S,) index of the panel sequence in the list passed to `prepare`. A sequence may occur with several choices of sides.
        reverse: (S,) index of the reversed sequence, or of the sequence itself if the list lacks the reverse.
        mirror, shift: (S, 3, 3), (S, 3); the image of a point x is mirror x + shift.
        order: (S,) number of panels. panel: (S, M) indices. side: (S, M) +-1, side of each panel on which the path is.
        first, last: (S, M + 1) range of each leg in `blocker`. blocker: (B,) obstacle indices. seen: (B, 3) their mirrored centres.
    """

    chain: np.ndarray
    reverse: np.ndarray
    mirror: np.ndarray
    shift: np.ndarray
    order: np.ndarray
    panel: np.ndarray
    side: np.ndarray
    first: np.ndarray
    last: np.ndarray
    blocker: np.ndarray
    seen: np.ndarray

    def __len__(self) -> int:
        return len(self.order)


@dataclass(frozen=True)
class Obstacles:
    """Hold O obstacles: all panels, followed by convex solids and curved objects as hulls of their outermost points.

    Attributes:
        points, count: (O, SUPPORTS, 3) corners or hull points, and their number (O,). normal, offset: of a panel's plane.
        hull: (O,) whether the obstacle is a hull. body: (O,) index of the solid to which the panel or hull belongs, or -1.
    """

    points: np.ndarray
    count: np.ndarray
    normal: np.ndarray
    offset: np.ndarray
    hull: np.ndarray
    body: np.ndarray

    @cached_property
    def centre(self) -> np.ndarray:
        """Return the centres (O, 3) of the bounding boxes."""
        used = (np.arange(SUPPORTS) < np.maximum(self.count, 1)[:, None])[..., None]
        low, high = np.where(used, self.points, np.inf).min(axis=1), np.where(used, self.points, -np.inf).max(axis=1)
        return (low + high) / 2

    @cached_property
    def radius(self) -> np.ndarray:
        """Return the radius (O,) of the ball about each centre that contains the obstacle."""
        used = np.arange(SUPPORTS) < self.count[:, None]
        return np.where(used, np.linalg.norm(self.points - self.centre[:, None], axis=2), 0.0).max(axis=1)


def obstacles(panels: Panels, others: Sequence[np.ndarray] = (), present: np.ndarray | None = None) -> Obstacles:
    """Build the obstacles: panels of the mask `present` (None: all), the solids that they bound, and hulls of points (N, 3)."""
    present = np.ones(len(panels), bool) if present is None else present
    solids = np.unique(panels.body[(panels.body >= 0) & present])
    used = np.arange(MAX_SIDES) < panels.count[:, None]
    clouds = [panels.corners[panels.body == solid][used[panels.body == solid]] for solid in solids] + list(others)
    first, total = len(panels), len(panels) + len(clouds)
    points, count = np.zeros((total, SUPPORTS, 3)), np.zeros(total, int)
    points[:first, :MAX_SIDES] = panels.corners
    count[:first] = np.where(present, panels.count, 0)
    for i, cloud in enumerate(clouds, first):
        outermost = _supports(cloud)
        points[i, : len(outermost)] = outermost
        count[i] = len(outermost)
    normal, offset = np.zeros((total, 3)), np.zeros(total)
    normal[:first], offset[:first] = panels.normal, panels.offset
    return Obstacles(
        points, count, normal, offset, np.arange(total) >= first, np.concatenate([panels.body, solids, np.full(len(others), -1)])
    )


def _supports(points: np.ndarray) -> np.ndarray:
    """Return all points, or at most SUPPORTS outermost points in directions that are spread evenly over the sphere."""
    points = np.unique(np.round(points, 7), axis=0)
    if len(points) <= SUPPORTS:
        return points
    index = np.arange(SUPPORTS) + 0.5
    polar, turn = np.arccos(1 - 2 * index / SUPPORTS), np.pi * (1 + 5**0.5) * index
    directions = np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)])
    return points[np.unique(np.argmax(points @ directions, axis=0))]


def prepare(panels: Panels, things: Obstacles, chains: Sequence[tuple[int, ...]], sources: np.ndarray, receivers: np.ndarray) -> Sequences:
    """For each sequence of reflecting panels, find the panel sides that a path may meet and the obstacles that may block a path.

    Args:
        chains: for each sequence of reflecting panels, the indices of its panels in the order from source to receiver.
        sources, receivers: (N, 3) possible ends of the paths; only their bounding boxes are used.
    """
    ends = [_box(sources), _box(receivers)]
    rows = [(chain, sides, index) for index, chain in enumerate(chains) for sides in _sides(panels, chain, ends)]
    longest = max((len(chain) for chain, *_ in rows), default=1)
    order = np.array([len(chain) for chain, *_ in rows], int)
    mirror, shift = np.tile(np.eye(3), (len(rows), 1, 1)), np.zeros((len(rows), 3))
    panel, side = np.zeros((len(rows), longest), int), np.ones((len(rows), longest))
    first, last = np.zeros((len(rows), longest + 1), int), np.zeros((len(rows), longest + 1), int)
    blocker: list[int] = []
    seen: list[np.ndarray] = []
    known: dict[tuple[object, ...], np.ndarray] = {}
    for i, (chain, sides, _) in enumerate(rows):
        for p in chain:
            flip = np.eye(3) - 2 * np.outer(panels.normal[p], panels.normal[p])
            mirror[i], shift[i] = flip @ mirror[i], flip @ shift[i] + 2 * panels.offset[p] * panels.normal[p]
        panel[i, : len(chain)], side[i, : len(chain)] = chain, sides
        stops = [("source",), *zip(chain, sides, strict=True), ("receiver",)]
        for leg in range(len(chain) + 1):
            key = (stops[leg], stops[leg + 1])
            if key not in known:
                known[key] = _between(panels, things, stops[leg], stops[leg + 1], ends)
            first[i, leg] = len(blocker)
            blocker.extend(known[key])
            centres = things.centre[known[key]]
            for p in chain[leg:]:
                centres = centres - 2 * (centres @ panels.normal[p] - panels.offset[p])[:, None] * panels.normal[p]
            seen.append(centres)
            last[i, leg] = len(blocker)
    place = {(chain, sides): i for i, (chain, sides, _) in enumerate(rows)}
    return Sequences(
        np.array([index for *_, index in rows], int),
        np.array([place.get((chain[::-1], sides[::-1]), i) for i, (chain, sides, _) in enumerate(rows)], int),
        mirror,
        shift,
        order,
        panel,
        side,
        first,
        last,
        np.array(blocker, int),
        np.concatenate([np.zeros((0, 3)), *seen]),
    )


def _box(points: np.ndarray) -> np.ndarray:
    """Return the corners (8, 3) of the bounding box of points."""
    low, high = points.min(0), points.max(0)
    return np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])


def _polygon(panels: Panels, index: int) -> np.ndarray:
    return panels.corners[index, : panels.count[index]]


def _sides(panels: Panels, chain: tuple[int, ...], ends: list[np.ndarray]) -> list[tuple[int, ...]]:
    """Return all choices of panel sides for which the neighbouring panels (or the box of the ends) lie in front of each panel."""
    stops = [ends[0], *(_polygon(panels, p) for p in chain), ends[1]]
    choices: list[list[int]] = []
    for i, p in enumerate(chain, 1):
        possible = []
        for side in (1, -1):
            if side < 0 and panels.body[p] >= 0:
                continue
            height = [side * (stops[j] @ panels.normal[p] - panels.offset[p]) for j in (i - 1, i + 1)]
            if all(h.max() > aperture.BEHIND for h in height):
                possible.append(side)
        choices.append(possible)
    out: list[tuple[int, ...]] = [()]
    for possible in choices:
        out = [(*before, side) for before in out for side in possible]
    return out


def _between(panels: Panels, things: Obstacles, start: tuple, stop: tuple, ends: list[np.ndarray]) -> np.ndarray:
    """Return the obstacles that can touch the leg between two stops. A stop is ("source",), (panel, side) or ("receiver",)."""
    used = np.arange(SUPPORTS) < things.count[:, None]
    keep, whole = np.ones(len(things.count), bool), np.ones(len(things.count), bool)
    between = []
    for stop_, end in ((start, ends[0]), (stop, ends[1])):
        if len(stop_) == 1:
            between.append(end)
            continue
        index, side = stop_
        between.append(_polygon(panels, index))
        keep[index] = False
        if panels.body[index] >= 0:  # a convex solid never blocks its own faces
            keep &= things.body != panels.body[index]
        height = side * (things.points @ panels.normal[index] - panels.offset[index])
        keep &= np.where(used, height, -np.inf).max(axis=1) > aperture.BEHIND
        whole &= np.where(used, height, np.inf).min(axis=1) > -aperture.BEHIND
    height = np.concatenate(between) @ things.normal.T - things.offset
    keep &= things.hull | ((height.max(axis=0) > aperture.BEHIND) & (height.min(axis=0) < -aperture.BEHIND))
    # use a solid instead of its faces, unless the plane of a panel cuts the solid
    solid = things.hull & (things.body >= 0)
    cut = np.isin(things.body, things.body[solid & ~whole]) & (things.body >= 0)
    keep &= np.where(solid, ~cut, (things.body < 0) | cut)
    return np.flatnonzero(keep)


@dataclass(frozen=True)
class Images:
    """Hold the fields of N paths. Each path has a sequence of reflecting panels, a source and a receiver.

    Attributes:
        factor: (N,) complex Fresnel factor, 0 if there is no path. length_m: (N,) path length.
        departure, arrival: (N, 3) unit, from source and receiver towards the path, world frame.
        field: (N, Q, 3) complex field after all reflections, for exp(+j omega t). It starts as a unit field along the projected axis.
    """

    factor: np.ndarray
    length_m: np.ndarray
    departure: np.ndarray
    arrival: np.ndarray
    field: np.ndarray


def evaluate(
    panels: Panels,
    things: Obstacles,
    sequences: Sequences,
    table: ReflectionTable,
    which: np.ndarray,
    source: np.ndarray,
    axis: np.ndarray,
    receiver: np.ndarray,
    least: np.ndarray | float = 0.0,
    reach: float = REACH,
) -> Images:
    """Compute the fields of N paths. Each path reflects at the flat panels of one prepared sequence, in the order of the sequence.

    Args:
        which: (N,) index of the prepared sequence of reflecting panels of each path. source, receiver: (N, 3) ends of the path in the
            world. axis: (N, 3) the source's antenna axis.
        least: threshold of |field| |factor|/length, computed without obstacles, per path or for all paths. Weaker paths are dropped.
        reach: Fresnel coordinate beyond which obstacles are ignored.
    """
    # fixed array types, because Numba compiles again for every other type
    which = np.ascontiguousarray(which)
    least = np.full(len(which), least, float)
    source, axis, receiver = (np.ascontiguousarray(ends) for ends in (source, axis, receiver))
    wavenumber = 2 * np.pi * float(table.frequencies_hz.mean()) / SPEED_OF_LIGHT
    n, q = len(which), len(table.frequencies_hz)
    factor, length = np.zeros(n, complex), np.zeros(n)
    departure, arrival, field = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, q, 3), complex)
    shared_out(
        aperture.evaluate, n,
        panels.corners, panels.count, panels.normal, panels.offset, panels.surface,
        things.points, things.count, things.hull, things.radius,
        sequences.order, sequences.panel, sequences.side, sequences.first, sequences.last, sequences.blocker, sequences.seen,
        table.te, table.tm, wavenumber, NUDGE / wavenumber, reach, which, source, axis, receiver,
        least, factor, length, departure, arrival, field, pieces=16,
    )  # fmt: skip
    return Images(factor, length, departure, arrival, field)


def across(axis: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Return the normalised components (N, 3) of axes perpendicular to directions (N, 3), as `aperture.transverse`."""
    part = axis - direction * np.einsum("ni,ni->n", axis, direction)[:, None]
    size = np.linalg.norm(part, axis=1)
    for i in np.flatnonzero(size < 1e-6):
        part[i], size[i] = aperture.transverse(axis[i], direction[i]), 1.0
    return part / size[:, None]
