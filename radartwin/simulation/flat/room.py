"""Paths of a room of flat faces for all poses at once: reflections and edge diffractions.

Sequences of faces and edges are searched at a few key places along the motion of the sensor. Each pose then evaluates the sequences of the
key places near this pose, exactly and at its own place.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from radartwin.compiled import shared_out
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.simulation.flat import field, obstacles, search
from radartwin.simulation.flat.faces import Faces
from radartwin.simulation.paths import Paths
from radartwin.simulation.pruning import strong_masks
from radartwin.simulation.reflection_table import ReflectionTable

AROUND = 3  # largest number of reflections of a path with edges
KEY_SPACING_M = 0.1  # distance between key places
NEAR = 1.5  # in units of KEY_SPACING_M; a pose uses the sequences of all key places within this distance
NUDGE = 0.05 * np.array([0.74, 0.53, 0.41])  # offset of the sensor in tests of existence, in units of 1/k
EARLY = 0.3  # threshold of the search over the threshold of paths
PAIRS_AT_ONCE = 200_000  # limits the memory of one evaluation


@dataclass(frozen=True)
class FlatRoom:
    """Hold the faces of static surfaces, everything that blocks, and the reflection of the surfaces."""

    faces: Faces
    blocking: obstacles.Hierarchy
    table: ReflectionTable

    def paths(self, poses: np.ndarray, velocity: np.ndarray, radar: Radar, max_bounces: int, prune: float) -> list[Paths]:
        """Return the paths without and with edges.

        Args:
            poses: (F, 4, 4) sensor to world. velocity: (F, 3) of the sensor, m/s.
            max_bounces: largest number of reflections.
            prune: drop paths whose amplitude, with the element gain, is below this times the pose's strongest path.
        """
        place = poses[:, :3, 3]
        keys, near = _key_places(place)
        every, of_key = search.Sequences.union([self._sequences(place[k], max_bounces, prune) for k in keys])
        edges = every.edge[:, 0] >= 0
        active = np.zeros((len(poses), len(every)), bool)
        for pose, chosen in enumerate(near):
            for k in chosen:
                active[pose, of_key[k]] = True
        parts = []
        least = np.zeros(len(poses))
        for kind in (~edges, edges):
            pose, which = np.nonzero(active & kind)
            part = self._evaluated(every, pose, which, poses, velocity, least)
            np.maximum.at(least, part.pose, EARLY * prune * np.abs(part.amplitude).max(axis=1, initial=0) * self._scale)
            parts.append(part)
        masks = strong_masks(parts, radar, prune)
        return [part.where(mask) for part, mask in zip(parts, masks, strict=True)]

    @property
    def _scale(self) -> float:
        """Return the field of a unit source at one metre over the received amplitude."""
        return 4 * np.pi * float(self.table.frequencies_hz.mean()) / SPEED_OF_LIGHT

    @property
    def _wavenumber(self) -> float:
        return 2 * np.pi * float(self.table.frequencies_hz.mean()) / SPEED_OF_LIGHT

    def _sequences(self, place: np.ndarray, max_bounces: int, prune: float) -> search.Sequences:
        largest = np.maximum(np.abs(self.table.te).max(axis=(1, 2)), np.abs(self.table.tm).max(axis=(1, 2)))
        loudness = largest[self.faces.surface]
        opaque = self.table.opaque
        source = place + 1.5 * NUDGE / self._wavenumber
        found = search.beams(self.faces, self.blocking, opaque, loudness, source, max_bounces, 0.0)
        loudest = float((found.strength[1:] / np.linalg.norm(found.image[1:] - place, axis=1)).max(initial=0.0))
        around = min(AROUND, max_bounces)
        arrivals = search.reached(self.faces, self.blocking, opaque, source, found, around)
        return search.sequences(self.faces, found, arrivals, loudness, self._wavenumber, around, EARLY * prune * loudest)

    def _evaluated(
        self, every: search.Sequences, pose: np.ndarray, which: np.ndarray, poses: np.ndarray, velocity: np.ndarray, least: np.ndarray
    ) -> Paths:
        """Return the paths of pairs (N,) of a pose and a sequence, with both directions of reversible sequences."""
        frequencies = self.table.frequencies_hz
        n, sensor, axis = len(pose), np.ascontiguousarray(poses[:, :3, 3]), np.ascontiguousarray(poses[:, :3, 2])
        amplitude, length = np.zeros((n, len(frequencies)), complex), np.zeros((n, 3))
        departure, arrival = np.zeros((n, 3)), np.zeros((n, 3))
        opaque = self.table.opaque
        tables = field.Tables(self.table.te, self.table.tm, self.table.through_te, self.table.through_tm)
        shared_out(
            field.evaluate, n, self.faces, self.blocking, opaque, tables, self._wavenumber, NUDGE / self._wavenumber,
            every.count, every.chain, every.edge, pose, which, sensor, axis, least, amplitude, length, departure, arrival, pieces=16,
        )  # fmt: skip
        found = np.flatnonzero(length[:, 0] > 0)
        both = found[every.reversible[which[found]]]
        there, back = length[:, 0] + length[:, 1] / 2, length[:, 2] + length[:, 1] / 2
        row = np.concatenate([found, both])
        one = np.arange(len(row)) < len(found)
        starts, ends = np.where(one[:, None], departure[row], arrival[row]), np.where(one[:, None], arrival[row], departure[row])
        rotation = poses[pose[row], :3, :3]
        edges = every.edge[which[row]] >= 0
        mirror = None
        if not edges.any():
            mirror = np.swapaxes(rotation, 1, 2) @ self._mirrors(every)[which[row]] @ rotation
        total = every.count[which[row]].sum(axis=1) + edges.sum(axis=1)
        paths = Paths(
            len(poses), pose[row], total, amplitude[row].conj() * (SPEED_OF_LIGHT / frequencies / (4 * np.pi)), frequencies,
            np.where(one, there[row], back[row]), np.where(one, back[row], there[row]),
            np.einsum("nij,ni->nj", rotation, starts), np.einsum("nij,ni->nj", rotation, ends),
            -np.einsum("ni,ni->n", starts + ends, velocity[pose[row]]), mirror,
        )  # fmt: skip
        return paths.where(np.argsort(paths.pose, kind="stable"))

    def _mirrors(self, every: search.Sequences) -> np.ndarray:
        """Return the mirror maps (K, 3, 3) of sequences without edges."""
        mirrors = np.tile(np.eye(3), (len(every), 1, 1))
        flips = np.eye(3) - 2 * self.faces.normal[:, :, None] * self.faces.normal[:, None, :]
        for i in range(every.chain.shape[1]):
            used = (every.edge[:, 0] < 0) & (i < every.count[:, 0])
            mirrors[used] = flips[every.chain[used, i]] @ mirrors[used]
        return mirrors


def build(faces: Faces, corners: np.ndarray, surface: np.ndarray, table: ReflectionTable) -> FlatRoom:
    """Build a room of faces; triangles (T, 3, 3) of surfaces (T,) that belong to no face only block paths."""
    triangles = np.concatenate([faces.triangle, corners])
    labels = np.concatenate([np.repeat(faces.surface, np.diff(faces.first)), surface])
    return FlatRoom(faces, obstacles.build(triangles, labels), table)


def _key_places(points: np.ndarray) -> tuple[np.ndarray, Sequence[np.ndarray]]:
    """Return the indices (K,) of key places along points (F, 3), and for every point the key places near it."""
    keys = [0]
    for i, point in enumerate(points):
        if np.linalg.norm(points[keys] - point, axis=1).min() > KEY_SPACING_M:
            keys.append(i)
    away = np.linalg.norm(points[:, None] - points[keys][None], axis=2)
    return np.array(keys), [np.flatnonzero(row <= max(NEAR * KEY_SPACING_M, row.min())) for row in away]
