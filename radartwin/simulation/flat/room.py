"""Rooms of flat faces: paths of reflections and edge diffractions for all poses at once, and the data that connect objects to the room.

The poses of the sensor are covered by cells. Each cell is searched once for all sequences of faces and edges over which a strong path can
exist anywhere in the cell. Each test place of the cell keeps the sequences that can exist within a margin around it and are strong there.
At each pose, the paths of the sequences of the nearest test place are then computed exactly. A sensor at rest is a track of one place.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import KDTree

from radartwin.compiled import each, shared_out
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.simulation.flat import field, obstacles, search, silhouette
from radartwin.simulation.flat.faces import Faces
from radartwin.simulation.paths import Paths
from radartwin.simulation.pruning import EARLY, both_gains, level, strong_masks
from radartwin.simulation.reflection_table import ReflectionTable

CELL_M = 0.1  # largest distance of a test place from the centre of its cell
TEST_M = 0.015  # largest distance of a pose of the track from a test place
MARGIN_M = 0.025  # margin around a test place within which its sequences exist; poses beside the track need more than TEST_M
LATE = 0.6  # factor on thresholds near the pose itself: of fields at its middle channel, and of two diffractions at its test place
ELSEWHERE = 0.3  # smallest ratio of the level of a path at the centre of a cell to its level at any place of the cell
EYES = 16  # largest number of poses of a cell from which visibility is tested
COARSE = 4  # number of places of a cell where a path with two diffractions must be strong
# Places, relative to a test place and in units of the margin in the frame of the sensor, where a path must be strong.
TESTED = np.array([[0.0, 0.0, 0.0], [0.1, 0.5, 0.2], [-0.1, -0.5, -0.2]])
HEADING_M = 0.8  # a turn of the sensor by one radian counts as this distance between places, because the antenna gain changes
PAIRS_AT_ONCE = 200_000  # limits the memory of one evaluation
# Rooms with more edges have paths with at most one diffraction. The search for two takes time with the square of the number of edges: 9 s
# of processor time for a cell in the furnished laboratory, which has 257.
MAX_EDGES = 1000
LARGE_BOUNCES = 4  # largest number of reflections there, because beams of four reflections take 8 GB in the atrium with its clutter
SHORT = 4.0  # length in wavelengths up to which the fields of a linear array are interpolated
UNEVEN = 0.3  # relative difference of the fields at the outermost channels above which all channels are computed
CHANNELS = 0.003  # the fields of weaker paths, relative to the strongest path of the pose, are computed at the middle of the array only


class RoomWarning(UserWarning):
    """Warn that a room has so many faces or edges that it is traced in a simpler way."""


@dataclass(frozen=True)
class Searched:
    """Hold the strong sequences at T test places. `places` (T, 9) is a result of `_points`. `of_test` has for each test place the indices
    of its sequences in `sequences`.
    """

    places: np.ndarray
    sequences: search.Sequences
    of_test: Sequence[np.ndarray]

    @staticmethod
    def of_pose(pose: np.ndarray, sequences: search.Sequences) -> "Searched":
        """Return the object in which all `sequences` are evaluated at one sensor pose (4, 4)."""
        return Searched(_points(pose[None]), sequences, [np.arange(len(sequences))])

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Return all fields as named arrays, which the array cache can store."""
        ends = np.cumsum([len(indices) for indices in self.of_test])
        return {"places": self.places, **vars(self.sequences), "of_test": np.concatenate(self.of_test), "ends": ends}

    @staticmethod
    def from_arrays(arrays: Mapping[str, np.ndarray]) -> "Searched":
        """Rebuild the object from the result of `to_arrays`. Raises LookupError if an array is missing."""
        sequences = search.Sequences(*(arrays[name] for name in search.Sequences.__annotations__))
        return Searched(arrays["places"], sequences, np.split(arrays["of_test"], arrays["ends"][:-1]))


@dataclass(frozen=True)
class FlatRoom:
    """Hold flat faces and all surfaces that block.

    Attributes:
        faces: flat faces. usable: (P,) whether paths may reflect at a face.
        blocking: all triangles that block. edges: edges of the faces that cast shadows on legs (`shadows.edges_of`).
        table: reflection of the surfaces.
        bodies: other bodies that cast shadows on legs. outlined: (surfaces,) whether a surface is part of such a body.
    """

    faces: Faces
    usable: np.ndarray
    blocking: obstacles.Hierarchy
    edges: obstacles.Hierarchy
    table: ReflectionTable
    bodies: Sequence[silhouette.Skin]
    outlined: np.ndarray

    @cached_property
    def wavenumber(self) -> float:
        """Return the wavenumber at the middle of the sweep, in rad/m."""
        return 2 * np.pi * float(self.table.frequencies_hz.mean()) / SPEED_OF_LIGHT

    @cached_property
    def walls(self) -> field.Walls:
        """Return the arrays of the room for compiled functions."""
        through = np.maximum(np.abs(self.table.through_te).max(axis=(1, 2)), np.abs(self.table.through_tm).max(axis=(1, 2)))
        tables = field.Tables.of(self.table.te, self.table.tm, self.table.through_te, self.table.through_tm)
        return field.Walls(
            self.faces, *self.balls, self.blocking, self.table.opaque, tables, self.wavenumber, through, self.loudness, self._envelope
        )

    @cached_property
    def _middle(self) -> field.Walls:
        """Return the walls with the coefficients in the middle of the sweep."""
        return self.walls._replace(tables=field.Tables.of(*(values[:, :, values.shape[2] // 2, None] for values in self.walls.tables)))

    @cached_property
    def _unblocked(self) -> field.Walls:
        """Return the walls with the coefficients in the middle of the sweep, and without anything that blocks."""
        return self._middle._replace(tree=obstacles.build(np.zeros((0, 3, 3)), np.zeros(0, int)))

    @cached_property
    def _panes(self) -> field.Walls:
        """Return the walls with the coefficients in the middle of the sweep, where nothing blocks except for what the panes take."""
        tree, panes = self.blocking, ~self.table.opaque[self.blocking.label]
        corners = np.stack([tree.corner, tree.corner + tree.edge_a, tree.corner + tree.edge_b], axis=1)[panes]
        return self._middle._replace(tree=obstacles.build(corners, tree.label[panes]))

    @cached_property
    def loudness(self) -> np.ndarray:
        """Return the largest reflection coefficient (P,) of each face, and zero for a face that paths may not use."""
        largest = np.maximum(np.abs(self.table.te).max(axis=(1, 2)), np.abs(self.table.tm).max(axis=(1, 2)))
        return np.where(self.usable, largest[self.faces.surface], 0.0)

    @cached_property
    def _envelope(self) -> np.ndarray:
        """Return the largest reflection coefficient (P, C) of each face over all angles at least as steep as each of C cosines."""
        largest = np.maximum(np.abs(self.table.te).max(axis=2), np.abs(self.table.tm).max(axis=2))
        return np.maximum.accumulate(largest[:, ::-1], axis=1)[:, ::-1][self.faces.surface]

    @cached_property
    def borders(self) -> tuple[np.ndarray, ...]:
        """Return the borders of the faces: the range (P + 1,) of each face in this list, the starts (B, 3), unit directions (B, 3) and
        lengths (B,) of the line pieces, and two directions (B, 3), (B, 3) for each.

        The first direction points into the face. The second one points from the face into the open sector of the edge, and is zero for a
        free edge, whose sector is on both sides. The outline of a face without wedges, such as that of a thin plate whose narrow sides are
        no faces, consists of free edges.
        """
        faces, angle = self.faces, np.pi * self.faces.opening[:, None]
        other = np.cos(angle) * faces.into + np.sin(angle) * faces.up
        two = faces.sides[:, 0] != faces.sides[:, 1]
        edge = np.concatenate([np.arange(len(two)), np.flatnonzero(two)])
        into = [faces.into, other[two]]
        side = [two[:, None] * faces.up, (np.sin(angle) * faces.into - np.cos(angle) * faces.up)[two]]
        owner, lines = [faces.sides[:, 0], faces.sides[two, 1]], [np.column_stack([faces.start, faces.along, faces.length])[edge]]
        for p in np.setdiff1d(np.arange(len(faces.offset)), faces.sides):
            start = faces.triangle[faces.first[p] : faces.first[p + 1]]
            along = np.roll(start, -1, axis=1) - start
            start, along = start.reshape(-1, 3), along.reshape(-1, 3)
            _, one, count = np.unique(np.round(2 * start + along, 6), axis=0, return_index=True, return_counts=True)  # two triangles share
            start, along = start[one[count == 1]], along[one[count == 1]]  # the sides that are no borders
            length = np.linalg.norm(along, axis=1, keepdims=True)
            owner.append(np.full(len(start), p))
            lines.append(np.concatenate([start, along / length, length], axis=1))
            into.append(np.cross(faces.normal[p], along / length))
            side.append(np.zeros((len(start), 3)))
        order = np.argsort(np.concatenate(owner), kind="stable")
        first = np.searchsorted(np.concatenate(owner)[order], np.arange(len(faces.offset) + 1))
        line, into, side = (np.concatenate(rows)[order] for rows in (lines, into, side))
        return first, *(np.ascontiguousarray(rows) for rows in (line[:, :3], line[:, 3:6], line[:, 6], into, side))

    @cached_property
    def balls(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the centre (P, 3) and the radius (P,) of a ball around each face."""
        valid = np.arange(self.faces.outline.shape[1]) < self.faces.corners[:, None]
        low = np.where(valid[..., None], self.faces.outline, np.inf).min(axis=1, initial=np.inf)
        high = np.where(valid[..., None], self.faces.outline, -np.inf).max(axis=1, initial=-np.inf)
        centre = (low + high) / 2
        away = np.linalg.norm(self.faces.outline - centre[:, None], axis=2)
        return centre, np.where(valid, away, 0.0).max(axis=1, initial=0.0)

    @cached_property
    def _links(self) -> search.Links:
        return search.Links(self.walls)

    def chains(self, places: np.ndarray, longest: int) -> np.ndarray:
        """Return the sequences (K, max(longest, 1)) of at most `longest` faces that a beam of a cell meets, -1 beyond the last.

        places: (P, 3) sensor positions in the cell; the first is its centre.
        """
        return search.beams(self.walls, search.Cell(places + 1.5 * field.NUDGE / self.wavenumber, CELL_M, np.zeros(4), 0.0), longest).chain

    def loudness_of(self, chains: np.ndarray) -> np.ndarray:
        """Return the product (K,) of the largest reflection coefficients of sequences of faces (K, C), -1 beyond the last."""
        return np.append(self.loudness, 1.0)[chains].prod(axis=1)

    def paths(self, poses: np.ndarray, velocity: np.ndarray, radar: Radar, prune: float, searched: Searched) -> list[Paths]:
        """Return the paths without and with edges.

        Args:
            poses: (F, 4, 4) sensor to world. velocity: (F, 3) of the sensor, m/s.
            prune: drop paths whose amplitude, with the element gain, is below this times the pose's strongest path.
            searched: the sequences that `searched` has found for these places.
        """
        every, active = searched.sequences, np.zeros((len(poses), len(searched.sequences)), bool)
        for pose, test in enumerate(_nearest(_points(poses), searched.places)):
            active[pose, searched.of_test[test]] = True
        least = np.zeros(len(poses))
        parts = []
        for kind in _kinds(every):
            part = self._evaluated(every, active & kind, poses, velocity, radar, least)
            np.maximum.at(least, part.pose, self._least(radar, LATE * prune) * level(part, radar))
            parts.append(part)
        masks = strong_masks(parts, radar, prune)
        return [part.where(mask) for part, mask in zip(parts, masks, strict=True)]

    def searched(self, poses: np.ndarray, radar: Radar, max_bounces: int, prune: float, diffractions: int = 2) -> Searched:
        """Find the sequences of faces and edges whose paths can, along a track, be as strong as `prune` times the strongest path.

        Paths are diffracted at most `diffractions` times (1 or 2). If the room has more than MAX_EDGES edges, they are diffracted at most
        once and reflected at most LARGE_BOUNCES times.
        """
        large = len(self.faces.length) > MAX_EDGES
        twice, longest = diffractions > 1 and not large, min(max_bounces, LARGE_BOUNCES) if large else max_bounces
        if large and (diffractions > 1 or max_bounces > LARGE_BOUNCES):
            warnings.warn(
                f"the room has {len(self.faces.length)} edges, over MAX_EDGES = {MAX_EDGES}; its paths have at most one diffraction, which "
                f"changes the signal of a furnished atrium by 0.15, and at most {LARGE_BOUNCES} reflections; the simulator settings "
                f"diffractions=1 max_bounces={LARGE_BOUNCES} accept this for every room", RoomWarning, stacklevel=2,
            )  # fmt: skip
        points = _points(poses)
        tests = _spaced(points, TEST_M)
        members = cells(points[tests])
        test_of = _nearest(points, points[tests])

        def strong(places: np.ndarray) -> list[search.Sequences]:
            """Return the sequences of the test places of a cell. Poses of the track test what the cell sees."""
            near = np.flatnonzero(np.isin(test_of, places))
            eyes = near[np.unique(np.linspace(0, len(near) - 1, EYES).astype(int))]
            return self._strong(poses[tests[places]], poses[eyes], radar, longest, prune, twice)

        per_cell = each(strong, members)
        every, index = search.Sequences.union([sequences for cell in per_cell for sequences in cell])
        of_test = [index[i] for i in np.argsort(np.concatenate(members))]
        return Searched(points[tests], every, of_test)

    def _strong(
        self, places: np.ndarray, eyes: np.ndarray, radar: Radar, max_bounces: int, prune: float, twice: bool
    ) -> list[search.Sequences]:
        """Return, for each test place (P, 4, 4) of a cell, the sequences that are strong there, or can exist in the margin around it.

        A path can be weak at a place, and strong beside it, so each place stands for three. What blocks a path at a place may not block it
        beside the place, so nothing blocks paths with fewer than two diffractions here. Panes weaken them, because most are weak behind
        walls; a path that is strong only between the three places is lost. Of the many paths with two diffractions, the function
        keeps those that are seen and strong at one of the three places.
        """
        every = self._sequences(places, eyes, radar, max_bounces, EARLY * prune, twice)
        margin, double = _margin(radar), every.edge[:, 1] >= 0
        beside = np.stack([_shifted(places, share * margin) for share in TESTED], axis=1)
        few, out = every.where(~double), []
        strongest = np.array([min(self._loudest(few, pose, radar) for pose in three) for three in beside])
        # Pairs of edges are numerous. Those that are weak at a few places of the cell are left out.
        coarse = beside.reshape(-1, 4, 4)[_apart(beside.reshape(-1, 4, 4), COARSE)]
        limit = np.where(double, EARLY * prune * strongest.min(), -np.inf)
        every = every.where(~double | self._strong_at(every, np.flatnonzero(double), coarse, radar, limit, self._unblocked)[0])
        double = every.edge[:, 1] >= 0
        for three, loudest in zip(beside, strongest, strict=True):
            limit = np.where(double, LATE, EARLY) * prune * loudest
            near = self._strong_at(every, np.arange(len(every)), three, radar, EARLY * limit, self._panes, margin)[0]
            pairs = self._strong_at(every, np.flatnonzero(near & double), three, radar, limit, self._middle)[0]
            strong, exists = self._strong_at(every, np.flatnonzero(near & ~double), three, radar, limit, self._panes)
            out.append(every.where(pairs | strong | (near & ~double & ~exists)))
        return out

    def _strong_at(
        self, every: search.Sequences, which: np.ndarray, poses: np.ndarray, radar: Radar, limit: np.ndarray, walls: field.Walls,
        margin: float = 0.0,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Return which of the K sequences, of those with the indices `which`, have a level above `limit` (K,) at one of several poses, and
        which exist there.
        """
        strong, exists = np.zeros((2, len(every)), bool)
        for pose in poses:
            which = which[~strong[which]]
            least = self._least(radar, float(limit[which].min(initial=np.inf)))
            there, level = self._levels(every, which, pose, radar, least, walls, margin)
            exists[which] |= there
            strong[which] = level > limit[which]
        return strong, exists

    def _loudest(self, sequences: search.Sequences, pose: np.ndarray, radar: Radar) -> float:
        """Return the level of the strongest sequence at a pose (4, 4). Only sequences that can be stronger are tested for visibility."""
        loudest = 0.0
        for kind in _kinds(sequences):
            level = self._levels(sequences, np.flatnonzero(kind), pose, radar, self._least(radar, loudest))[1]
            loudest = max(loudest, float(level.max(initial=0.0)))
        return loudest

    def single_diffractions(self, pose: np.ndarray, radar: Radar, max_bounces: int, prune: float) -> search.Sequences:
        """Find the sequences with at most one diffraction that can be strong at or beside one sensor pose (4, 4).

        The function takes a small part of the time of `searched`, which also finds paths with two diffractions.
        """
        return self._strong(pose[None], pose[None], radar, max_bounces, prune, False)[0]

    def levels(self, sequences: search.Sequences, pose: np.ndarray, radar: Radar) -> np.ndarray:
        """Return the level (K,) of each sequence at a sensor pose (4, 4): received amplitude with element gain, 0 without a path."""
        return self._levels(sequences, np.arange(len(sequences)), pose, radar, 0.0)[1]

    def _least(self, radar: Radar, share: float) -> float:
        """Return the ratio of the weakest field that matters to the level (received amplitude with gain) of the strongest path."""
        return share * 2 * self.wavenumber / float(radar.gain([1.0, 0.0, 0.0])) ** 2

    def _levels(
        self, every: search.Sequences, which: np.ndarray, pose: np.ndarray, radar: Radar, least: float,
        walls: field.Walls | None = None, margin: float = 0.0,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Return which sequences (N,) have a path at a pose (4, 4), and the levels (N,) of the paths with a field of at least `least`.

        walls: None means `_middle`. margin: by which the sensor can move, as in `field.evaluate`.
        """
        arguments = pose[None], np.full(1, least), walls or self._middle, margin
        strong, (amplitude, length, departure, arrival, _) = self._fields(every, np.zeros(len(which), int), which, *arguments)
        level, rotation = np.zeros(len(which)), pose[:3, :3]
        gain = both_gains(radar, departure[strong] @ rotation, arrival[strong] @ rotation)
        level[strong] = np.abs(amplitude[strong, 0]) * gain / (2 * self.wavenumber)
        return length[:, 0] != 0, level

    def _sequences(
        self, places: np.ndarray, eyes: np.ndarray, radar: Radar, max_bounces: int, prune: float, twice: bool
    ) -> search.Sequences:
        """Return the sequences that can have a path as strong as `prune` times the strongest path, anywhere in a cell.

        Args:
            places: (P, 4, 4) poses in the cell; the first is its centre. eyes: (E, 4, 4) poses from which visibility is tested.
            twice: whether paths may have two diffractions.
        """
        seen, margin = np.concatenate([places[:1], eyes]), _margin(radar)
        at = seen[:, :3, 3] + 1.5 * seen[:, :3, :3] @ field.NUDGE / self.wavenumber
        reach = CELL_M + margin
        beside = [_shifted(places[:1], margin / 2 * way)[:, :3, 3] for way in (*np.eye(3), *-np.eye(3))]
        forward = places[0, :3, 0]
        sees_behind = radar.sees_behind or np.abs(places[:, :3, 0] - forward).max() > 1e-3
        front = np.zeros(4) if sees_behind else np.append(forward, forward @ at[0] - reach)
        cell = search.Cell(np.concatenate([at, *beside]), reach, front, 0.0)
        for longest in (min(2, max_bounces), max_bounces):  # the strongest path of the first pass sets the threshold of the second
            beams = search.beams(self.walls, cell, longest - 1, twice)
            parts = search.closed(self.walls, cell, beams, longest)
            closed = search.Sequences.joined([self._strong_near(part, places[0], radar, cell) for part in parts])
            # the weakest, over all places, of the strongest paths
            coarse = places[_apart(places, COARSE)]
            levels = [self._levels(closed, np.arange(len(closed)), place, radar, cell.least)[1] for place in coarse]
            cell = cell._replace(least=self._least(radar, prune) * min(at_place.max(initial=0.0) for at_place in levels))
        arrivals, passed = search.reached(self.walls, cell, beams, max_bounces, twice)
        strength = passed * self._strengths(beams, arrivals, places, radar)
        linked = np.zeros((0, 3), int)
        if twice:
            linked = self._links.between(search.worthwhile(self.walls, cell, arrivals, strength))
        edged = search.sequences(self.walls, cell, beams, arrivals, strength, linked, max_bounces)
        return self._strong_near(search.Sequences.joined([closed, edged]), places[0], radar, cell)

    def _strong_near(self, every: search.Sequences, place: np.ndarray, radar: Radar, cell: search.Cell) -> search.Sequences:
        """Return the sequences whose path can be strong at a sensor in a cell around a place."""
        near = every, np.arange(len(every)), place, radar, ELSEWHERE * cell.least, self._unblocked, cell.radius
        return every.where(self._levels(*near)[1] > 0)

    def _strengths(self, beams: search.Beams, arrivals: np.ndarray, poses: np.ndarray, radar: Radar) -> np.ndarray:
        """Return the largest field (M,) at one metre with which each beam reaches the ends or the middle of its edge, at any of the poses.

        arrivals: (M, 2) edge and beam. The fields include the element gain relative to the gain at boresight.
        """
        edge, beam = arrivals.T
        gain, strength = np.zeros((2, len(arrivals)))
        headings = np.unique(np.round(poses[:, :3, :3], 3), axis=0)
        for share in (0.0, 0.5, 1.0):
            way = self.faces.start[edge] + share * self.faces.length[edge, None] * self.faces.along[edge] - beams.image[beam]
            way /= np.linalg.norm(way, axis=1, keepdims=True)
            total = np.ones(len(arrivals))
            for i in reversed(range(beams.chain.shape[1])):
                valid = i < beams.order[beam]
                face = beams.chain[beam, i]
                cosine = np.einsum("ij,ij->i", way, self.faces.normal[face])
                column = np.minimum(np.abs(cosine), 1) * (self._envelope.shape[1] - 1)
                total *= np.where(valid, self._envelope[face, column.astype(int)], 1.0)
                way = np.where(valid[:, None], way - 2 * cosine[:, None] * self.faces.normal[face], way)
            for heading in headings:
                gain = np.maximum(gain, radar.gain(way @ heading))
            strength = np.maximum(strength, total)
        return strength * gain / float(radar.gain([1.0, 0.0, 0.0]))

    def _fields(
        self, every: search.Sequences, pose: np.ndarray, which: np.ndarray, poses: np.ndarray, least: np.ndarray, walls: field.Walls,
        margin: float = 0.0,
    ) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:  # fmt: skip
        """Return which pairs (N,) of a pose and a sequence have a path, and amplitude, lengths, departure, arrival and points of all."""
        n, q, points = len(pose), walls.tables.te.shape[2], every.chain.shape[1] + 2
        values = (
            np.zeros((n, q), complex), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.full((n, points, 3), np.nan)
        )  # fmt: skip
        arguments = (
            every.chain.shape[1], q, walls, poses[:, :3, :3] @ field.NUDGE / self.wavenumber, every.count, every.chain, every.edge,
            *map(np.ascontiguousarray, (pose, which, poses[:, :3, 3], poses[:, :3, 2])), least, margin,
        )  # fmt: skip
        shared_out(field.evaluate, n, *arguments, *values, pieces=16, grain=1024)
        return np.flatnonzero(values[1][:, 0] > 0), values

    def _evaluated(
        self, every: search.Sequences, active: np.ndarray, poses: np.ndarray, velocity: np.ndarray, radar: Radar, least: np.ndarray
    ) -> Paths:
        """Return the paths of the active pairs (F, K) of a pose and a sequence whose field is at least `least` (F,)."""
        together = max(1, PAIRS_AT_ONCE // max(1, int(active.sum(axis=1).max(initial=0))))
        parts = []
        for low in range(0, len(poses), together):
            pose, which = np.nonzero(active[low : low + together])
            parts.append(self._paths(every, pose + low, which, poses, velocity, radar, least))
        return parts[0] if len(parts) == 1 else Paths.concatenate(parts)

    def _paths(
        self, every: search.Sequences, pose: np.ndarray, which: np.ndarray, poses: np.ndarray, velocity: np.ndarray, radar: Radar,
        least: np.ndarray,
    ) -> Paths:  # fmt: skip
        """Return the paths of pairs (N,) of a pose and a sequence, with both directions of reversible sequences.

        The fields are computed at the middle of the array. Where a path is strong, or may exist beside the middle only, they are computed
        at the two outermost channels too, and interpolated between them. Where these differ much, as near the border of a shadow, they are
        computed at all channels. The place of a channel is the middle between its two elements.
        """
        channels, middle = _channels(radar), len(self.table.frequencies_hz) // 2
        outermost, straight, share = _along_array(channels, radar.wavelength_m)
        offsets = np.array([np.zeros(3), *outermost])
        every_value = self._fields(every, pose, which, poses, least, self.walls)[1]
        level = np.zeros((3, len(pose)))
        level[0] = np.abs(every_value[0][:, middle])
        strongest = np.zeros(len(poses))
        np.maximum.at(strongest, pose, level[0])
        missing = every_value[1][:, 0] == 0
        apart = np.flatnonzero(missing | (level[0] > CHANNELS * strongest[pose])) if len(channels) > 1 else np.zeros(0, int)
        # the channels need the fields in the middle of the sweep only
        ends = [
            self._fields(every, pose[apart], which[apart], _shifted(poses, end), EARLY * least, self._middle)[1][0][:, 0]
            for end in offsets[1:]
        ]
        change = np.zeros(len(pose))
        for k, end in enumerate(ends):
            level[k + 1, apart] = np.abs(end)
        # a path can exist at the middle only, as through a narrow gap
        half = every_value[0][apart, middle] - (ends[0] + ends[1]) / 2
        change[apart] = np.maximum(np.abs(ends[0] - ends[1]), 2 * np.abs(half))
        best = np.where(level[0] > 0, 0, level.argmax(axis=0))
        for k in (1, 2):
            rows = np.flatnonzero(best == k)
            beside = self._fields(every, pose[rows], which[rows], _shifted(poses, offsets[k]), 0 * least, self.walls)[1]
            for values, value in zip(every_value, beside, strict=True):
                values[rows] = value
        there = np.flatnonzero(level.max(axis=0) > 0)
        amplitude, length, departure, arrival, met = (values[there] for values in every_value)
        uneven = np.flatnonzero((change[there] > UNEVEN * level[:, there].max(axis=0)) | (np.isin(there, apart) & (not straight)))
        gain = np.ones((len(there), len(channels)), complex)
        uneven_rows = there[uneven]
        if len(apart):
            strong, row = np.isin(apart, there), np.searchsorted(there, apart)
            first, second = (end[strong, None] for end in ends)
            gain[row[strong]] = (first + share * (second - first)) / amplitude[row[strong], middle, None]
        for c, channel in enumerate(channels if len(uneven_rows) else channels[:0]):
            at_channel = self._fields(every, pose[uneven_rows], which[uneven_rows], _shifted(poses, channel), 0 * least, self._middle)[1][0]
            gain[uneven, c] = at_channel[:, 0] / amplitude[uneven, middle]
        offset = offsets[best[there]]
        pose, which = pose[there], which[there]
        frequencies, rotation, edges = self.table.frequencies_hz, poses[pose, :3, :3], every.edge[which] >= 0
        sizes = [length[:, end] + length[:, 1] / 2 for end in (0, 2)]
        ways = [np.einsum("nij,ni->nj", rotation, way) for way in (departure, arrival)]
        mirror = None
        if not edges.any():
            mirror = np.swapaxes(rotation, 1, 2) @ self.maps(every.chain)[which, :, :3] @ rotation
            total = sizes[0] + sizes[1]
            moved = [np.einsum("nij,nj->ni", m, offset) for m in (np.swapaxes(mirror, 1, 2), mirror)]
            ways = [total[:, None] * way + offset - shift for way, shift in zip(ways, moved, strict=True)]
            sizes = [np.linalg.norm(ways[0], axis=1) / 2] * 2
        else:
            ways = [distance[:, None] * way + offset for way, distance in zip(ways, sizes, strict=True)]
            sizes = [np.linalg.norm(way, axis=1) for way in ways]
        departs, arrives = (way / np.linalg.norm(way, axis=1, keepdims=True) for way in ways)
        turned = np.einsum("nji,nj->ni", rotation, velocity[pose])
        points = every.count[which].sum(axis=1) + edges.sum(axis=1)
        out = Paths(
            len(poses), pose, points, amplitude.conj() * (SPEED_OF_LIGHT / frequencies / (4 * np.pi)), frequencies, sizes[0], sizes[1],
            departs, arrives, -np.einsum("ni,ni->n", departs + arrives, turned), mirror, gain.conj(), met,
        )  # fmt: skip
        # a path that is listed once also runs in reverse, with the same gain
        back = every.reversible[which]
        return Paths.concatenate([out, out.where(back).reversed()]) if back.any() else out

    def maps(self, chains: np.ndarray) -> np.ndarray:
        """Return the maps (K, 3, 4) of a point to its image in the faces of each sequence (K, C), -1 beyond the last."""
        maps = np.tile(np.eye(3, 4), (len(chains), 1, 1))
        for face in chains.T:
            valid = np.flatnonzero(face >= 0)
            normal, offset = self.faces.normal[face[valid]], self.faces.offset[face[valid], None]
            maps[valid] -= 2 * normal[:, :, None] * np.einsum("ki,kij->kj", normal, maps[valid])[:, None]
            maps[valid, :, 3] += 2 * offset * normal
        return maps


def _channels(radar: Radar) -> np.ndarray:
    """Return the middles (T R, 3) between transmit and receive elements, receivers fastest."""
    return (radar.tx_positions[:, None] + radar.rx_positions[None]).reshape(-1, 3) / 2


def _margin(radar: Radar) -> float:
    """Return the margin in metres around a test place: of the poses near it, and of the channels of the array."""
    return MARGIN_M + float(np.linalg.norm(_channels(radar), axis=1).max())


def _along_array(channels: np.ndarray, wavelength_m: float) -> tuple[np.ndarray, bool, np.ndarray]:
    """Return the two of the channels (C, 3) that are farthest apart (2, 3), whether all lie on a line of at most SHORT wavelengths between
    these two, and their places (C,) on it from 0 to 1.
    """
    away = np.linalg.norm(channels[:, None] - channels[None], axis=2)
    ends = channels[list(np.unravel_index(away.argmax(), away.shape))]
    way = ends[1] - ends[0]
    share = (channels - ends[0]) @ way / max(float(way @ way), 1e-12)
    aside = np.linalg.norm(channels - ends[0] - share[:, None] * way, axis=1).max()
    return ends, bool(aside < 0.1 * wavelength_m and away.max() < SHORT * wavelength_m), share


def _shifted(poses: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Return poses (F, 4, 4) moved by an offset (3,) in their own frame."""
    out = poses.copy()
    out[:, :3, 3] += poses[:, :3, :3] @ offset
    return out


def _kinds(every: search.Sequences) -> tuple[np.ndarray, np.ndarray]:
    """Return which sequences have no edges, and which have edges. Sequences without edges come first, because they set the threshold of
    sequences with edges.
    """
    edges = every.edge[:, 0] >= 0
    return ~edges, edges


def _points(poses: np.ndarray) -> np.ndarray:
    """Return the positions of poses (F, 4, 4), and their headings and antenna axes in units of HEADING_M, (F, 9)."""
    return np.concatenate([poses[:, :3, 3], HEADING_M * poses[:, :3, 0], HEADING_M * poses[:, :3, 2]], axis=1)


def _spaced(points: np.ndarray, spacing_m: float) -> np.ndarray:
    """Return indices (K,) of points (F, D) such that every point is within `spacing_m` of one of them."""
    kept = [0]
    for i, point in enumerate(points):
        if np.linalg.norm(points[kept] - point, axis=1).min() > spacing_m * (1 + 1e-6):
            kept.append(i)
    return np.array(kept)


def _apart(poses: np.ndarray, most: int) -> np.ndarray:
    """Return the indices of at most `most` poses (F, 4, 4), of which the first is chosen first, then each time the farthest from these."""
    points, indices = poses[:, :3, 3], [0]
    away = np.full(len(points), np.inf)
    while len(indices) < min(most, len(points)):
        away = np.minimum(away, np.linalg.norm(points - points[indices[-1]], axis=1))
        indices.append(int(away.argmax()))
    return np.array(indices)


def _nearest(points: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return for each of the points (F, D) the index of the nearest of the places (K, D)."""
    return np.asarray(KDTree(places).query(points)[1])


def cells(points: np.ndarray) -> list[np.ndarray]:
    """Divide points (F, D) into cells, and return the indices of the points of each cell, its centre first."""
    centres = _spaced(points, CELL_M)
    cell_of = _nearest(points, points[centres])
    return [np.concatenate([[centre], np.setdiff1d(np.flatnonzero(cell_of == c), centre)]) for c, centre in enumerate(centres)]
