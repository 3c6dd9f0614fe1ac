"""Paths that reflect at the panels of a flat room, for all poses at once.

The module tests a single reflection at every panel. At a few sensor positions along the motion (key places), coarse ray tubes find the
sequences of two or more panels at which strong paths reflect. Then `images.evaluate` computes the exact paths of these panel sequences for
every pose near the key places. In this module, curved surfaces and small objects only block paths; tubes trace their echoes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.scene.surface import OBJECT_EXTENT_M, Surface
from radartwin.simulation import geometry as geometry_module
from radartwin.simulation.curved import tube_grid, tubes
from radartwin.simulation.curved.hits import OTHER_LABEL, Antennas, TraceOptions, unpack_labels
from radartwin.simulation.flat import images, panels
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.paths import Paths
from radartwin.simulation.pruning import Pruner
from radartwin.simulation.reflection_table import ReflectionTable

DISCOVERY_RAYS = 150_000  # tubes over the sphere, about 5 cm wide at 3 m
SINGLE_RAYS = 1_200_000  # tubes over the sphere for a resting sensor
DISCOVERY_PRUNE = 1e-3  # search threshold relative to the strongest path, with several key places, which complement each other
SINGLE_PRUNE = 1e-4  # search threshold with a single key place
KEY_SPACING_M = 0.3  # distance between key places
NEIGHBOURS = 4  # number of places of a track whose sequences are used at a pose
NEAR = 2.0  # in units of KEY_SPACING_M; a pose uses the sequences of all key places within this distance
EARLY = 0.3  # early threshold over the final one; weaker paths are dropped before obstacles are tested
MAX_PANELS = 1500  # rooms with more panels are traced by tubes; labels allow 4094
FLAT_SHARE = 0.98  # smallest fraction of a flat room's area that belongs to panels
PATHS_AT_ONCE = 200_000  # limits the memory of one evaluation to a few hundred megabytes


@dataclass(frozen=True)
class Scouted:
    """Hold P sensor positions (P, 3) along a track, and for each position the sequences of panels at which strong paths reflect."""

    places: np.ndarray
    chains: list[set[tuple[int, ...]]]

    def near(self, points: np.ndarray) -> list[np.ndarray]:
        """Return, for each of the points (F, 3), the indices of the sensor positions whose sequences of reflecting panels are used."""
        away = np.linalg.norm(points[:, None] - self.places[None], axis=2)
        return [np.argsort(row, kind="stable")[:NEIGHBOURS] for row in away]


@dataclass(frozen=True)
class PanelRoom:
    """Hold static surfaces with their panels.

    Attributes:
        geometry: all static faces. table: reflection of their surfaces. panels: panels of these faces.
        small: (F,) faces of small or curved objects, which tubes trace.
        usable: (P,) panels that paths may include.
        own: indices of surfaces that do not block, because they belong to the object that is traced with this room.
    """

    geometry: Geometry
    table: ReflectionTable
    panels: panels.Panels
    small: np.ndarray
    usable: np.ndarray
    own: tuple[int, ...] = ()

    def beside(self, own: Sequence[int] = (), done: Sequence[int] = ()) -> "PanelRoom":
        """Return the room for tracing paths with an object of the surfaces `own`. Paths may include panels of other small objects.

        Panels of the surfaces `own` and `done` are excluded. `done` are objects whose paths with this object are already traced.
        """
        small = np.unique(self.geometry.surface[self.small])
        return replace(self, usable=~np.isin(self.panels.surface, np.intersect1d([*own, *done], small)), own=tuple(own))

    @property
    def rest(self) -> np.ndarray:
        """Return a mask (F,) of the faces that belong to no panel."""
        return self.panels.of_face < 0

    @property
    def compact(self) -> np.ndarray:
        """Return a mask (F,) of the faces to trace by tubes: small objects, and faces that belong to no panel."""
        return self.small | self.rest

    @cached_property
    def things(self) -> images.Obstacles:
        """Return everything that can block: the panels, and one obstacle per surface for the other faces."""
        rest = self.rest & ~np.isin(self.geometry.surface, self.own)
        clouds = [self.geometry.corners[rest & (self.geometry.surface == s)].reshape(-1, 3) for s in np.unique(self.geometry.surface[rest])]
        return images.obstacles(self.panels, clouds, ~np.isin(self.panels.surface, self.own))

    def is_flat(self, surfaces: Sequence[Surface]) -> bool:
        """Return whether panels make up FLAT_SHARE of the room's area without small objects, and are at most MAX_PANELS."""
        edge = self.geometry.corners[:, 1:] - self.geometry.corners[:, :1]
        area = np.linalg.norm(np.cross(edge[:, 0], edge[:, 1]), axis=1)
        room = ~self.small
        return 0 < self.usable.sum() <= MAX_PANELS and area[room & ~self.rest].sum() >= FLAT_SHARE * area[room].sum()

    def chains(
        self, sources: np.ndarray, receivers: np.ndarray, axes: np.ndarray, longest: int, share: float, rays: int = DISCOVERY_RAYS
    ) -> list[set[tuple[int, ...]]]:
        """For each of K source and receiver positions (K, 3), find the sequences of reflecting panels whose paths have at least `share` (0
        to 1) times the amplitude of the strongest path.
        """
        found: list[set[tuple[int, ...]]] = [{(int(p),) for p in np.flatnonzero(self.usable)} for _ in sources]
        if longest < 2 or not self.usable.any():
            return found
        there = ~np.isin(self.geometry.surface, self.own)  # an object does not hide its own centre
        geometry = self.geometry if there.all() else geometry_module.subset(self.geometry, there)
        labels = np.where(self.rest | ~self.usable[self.panels.of_face], OTHER_LABEL, self.panels.of_face)[there]
        transmit, receive = Antennas(sources, axes), Antennas(receivers, axes)
        rotation = np.broadcast_to(np.eye(3), (len(sources), 3, 3))
        envelope = self.table.envelope()
        options = TraceOptions(longest, labels=labels, prune=share, hats=True)
        for grid in tube_grid.all_around(sources, rotation, rays):
            hits = tubes.trace(geometry, envelope, grid, transmit, receive, options)
            order = np.lexsort((hits.sequence, hits.bounce, hits.pose))
            rows = [values[order] for values in (hits.pose, hits.bounce, hits.sequence)]
            first = np.logical_or.reduce(
                [np.diff(values, prepend=~values[:1]) != 0 for values in rows]
            )  # this is much faster than np.unique over rows
            for place, bounces, sequence in zip(*(values[first].tolist() for values in rows), strict=True):
                chain = unpack_labels(sequence, bounces)
                if OTHER_LABEL not in chain:
                    found[place].add(chain)
        return found

    def paths(
        self, poses: np.ndarray, velocity: np.ndarray, radar: Radar, max_bounces: int, prune: float, scouted: Scouted | None = None
    ) -> Paths:
        """Return the paths from the sensor to panels and back.

        Args:
            poses: (F, 4, 4) sensor to world. velocity: (F, 3) of the sensor, m/s.
            prune: drop paths whose amplitude, with the element gain, is below this times the pose's strongest path.
            scouted: sequences of reflecting panels that `scouted` has found; None searches for such sequences.
        """
        return self._found(poses, velocity, radar, max_bounces, prune, scouted)[0]

    def scouted(self, poses: np.ndarray, radar: Radar, max_bounces: int, prune: float) -> Scouted:
        """Find the sequences of panels at which strong paths reflect, for the sensor poses (P, 4, 4) along a track. `prune` should be well
        below the value of `prune` that is later passed to `paths`.
        """
        paths, which, known = self._found(poses, np.zeros((len(poses), 3)), radar, max_bounces, prune, None, thorough=True)
        chains: list[set[tuple[int, ...]]] = [set() for _ in poses]
        for pose, index in zip(paths.pose.tolist(), which.tolist(), strict=True):
            chains[pose].add(known[index])
        return Scouted(poses[:, :3, 3], chains)

    def _found(
        self,
        poses: np.ndarray,
        velocity: np.ndarray,
        radar: Radar,
        max_bounces: int,
        prune: float,
        scouted: Scouted | None,
        thorough: bool = False,
    ) -> tuple[Paths, np.ndarray, list[tuple[int, ...]]]:
        """Return N paths; for each path the index (N,) of its sequence of reflecting panels; and the list of panel sequences to which
        these indices refer.
        """
        place, axis = poses[:, :3, 3], poses[:, :3, 2]
        if scouted is None:
            keys, near = key_places(place)
            how = (SINGLE_PRUNE, SINGLE_RAYS) if thorough or len(keys) == 1 else (DISCOVERY_PRUNE, DISCOVERY_RAYS)
            chains = self.chains(place[keys], place[keys], axis[keys], max_bounces, *how)
        else:
            chains, near = scouted.chains, scouted.near(place)
        known = sorted(set().union(*chains, *({chain[::-1] for chain in found} for found in chains)))
        number = {chain: i for i, chain in enumerate(known)}
        prepared = images.prepare(self.panels, self.things, known, place, place)
        of_key = [np.isin(prepared.chain, [number[chain] for chain in found]) for found in chains]
        active = np.array([np.logical_or.reduce([of_key[k] for k in keys_]) for keys_ in near])
        single = active & (prepared.order == 1)
        pruner = Pruner(radar, prune, len(poses))
        pose, which = np.nonzero(single)
        one, over = self._evaluated(pose, which, prepared, poses, velocity, radar, 0.0)
        keep = pruner.mask(one)
        parts, overs = [one.where(keep)], [over[keep]]
        active &= prepared.order > 1
        active |= active[:, prepared.reverse] & (prepared.order > 1)
        together = max(1, PATHS_AT_ONCE // max(1, active.sum(axis=1).max(initial=0)))
        for low in range(0, len(poses), together):
            pose, which = np.nonzero(active[low : low + together])
            pose += low
            one, over = self._evaluated(pose, which, prepared, poses, velocity, radar, EARLY * prune * pruner.strongest[pose])
            parts.append(one)
            overs.append(over)
        every, over = Paths.concatenate(parts), np.concatenate(overs)
        over = over[np.argsort(np.concatenate([part.pose for part in parts]), kind="stable")]
        keep = pruner.mask(every)
        return every.where(keep), prepared.chain[over[keep]], known

    def _evaluated(
        self,
        pose: np.ndarray,
        which: np.ndarray,
        prepared: images.Sequences,
        poses: np.ndarray,
        velocity: np.ndarray,
        radar: Radar,
        least: np.ndarray | float,
    ) -> tuple[Paths, np.ndarray]:
        """Compute N paths, each with a prepared sequence of reflecting panels (index `which`, (N,)) and a sensor pose (index (N,)).
        Returns the paths that exist and the indices of their panel sequences.
        """
        rotation = poses[pose, :3, :3]
        place, axis = poses[pose, :3, 3], poses[pose, :3, 2]
        wavelength = SPEED_OF_LIGHT / self.table.frequencies_hz
        scale = 4 * np.pi / wavelength.max() if len(wavelength) else 1.0
        one = images.evaluate(self.panels, self.things, prepared, self.table, which, place, axis, place, np.asarray(least) * scale)
        # A sequence and its reverse differ, because each uses the aperture of its last panel. Their mean is reciprocal and more accurate.
        code = pose * len(prepared) + which  # ascending
        partner = np.minimum(np.searchsorted(code, pose * len(prepared) + prepared.reverse[which]), max(len(code) - 1, 0))
        there, back = one.length_m > 0, one.length_m[partner] > 0
        factor = np.where(back, (one.factor + one.factor[partner]) / 2, one.factor)
        lit = there & (factor != 0)
        receive = images.across(axis[lit], one.arrival[lit])
        level = np.einsum("nk,nqk->nq", receive, one.field[lit]).conj() * factor[lit, None]
        amplitude = level * wavelength / (4 * np.pi * one.length_m[lit, None])
        departure, arrival = (np.einsum("nij,ni->nj", rotation[lit], d[lit]) for d in (one.departure, one.arrival))
        rate = -np.einsum("ni,ni->n", one.departure[lit] + one.arrival[lit], velocity[pose[lit]])
        mirror = np.swapaxes(rotation[lit], 1, 2) @ prepared.mirror[which[lit]] @ rotation[lit]
        half = one.length_m[lit] / 2
        found = Paths(
            len(poses), pose[lit], prepared.order[which[lit]], amplitude, self.table.frequencies_hz, half, half, departure, arrival, rate,
            mirror,
        )  # fmt: skip
        return found, which[lit]


def small_faces(surfaces: Sequence[Surface], geometry: Geometry) -> np.ndarray:
    """Return a mask (F,) of the faces of objects up to OBJECT_EXTENT_M long, and of curved objects of any size."""
    small = np.array([s.kind == "object" and (float(s.mesh.extents.max()) <= OBJECT_EXTENT_M or s.is_curved()) for s in surfaces], bool)
    return small[geometry.surface] if len(surfaces) else np.zeros(0, bool)


def build(surfaces: Sequence[Surface], geometry: Geometry, table: ReflectionTable) -> PanelRoom:
    """Find the panels of static surfaces."""
    compact = small_faces(surfaces, geometry)
    found = panels.find(geometry)
    small = np.zeros(len(found), bool)
    small[found.of_face[compact & (found.of_face >= 0)]] = True
    return PanelRoom(geometry, table, found, compact, ~small)


def key_places(points: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Choose K points of a motion, KEY_SPACING_M apart, at which sequences of reflecting panels are searched. Returns the indices (K,) of
    the chosen points, and for every point the chosen points near it.

    Args:
        points: (F, D) coordinates; D = 6 for two moving points.
    """
    keys = [0]
    for i, point in enumerate(points):
        if np.abs(points[keys] - point).max(axis=1).min() > KEY_SPACING_M:
            keys.append(i)
    away = np.abs(points[:, None] - points[keys][None]).max(axis=2)
    return np.array(keys), [np.flatnonzero(row <= max(NEAR * KEY_SPACING_M, row.min())) for row in away]
