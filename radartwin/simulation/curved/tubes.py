"""Shooting and bouncing tubes with physical optics: the scattering kernel.

Every tube adds, at each of its hits that the receiver sees, the integral of the surface currents over its footprint, with the phase
expanded to second order:

    a = -j/(8 pi) [P . V] sqrt(dOmega A)/(L_o cos t) I exp(-j k (L_i + L_o))
    V = n x (k_i x E_i + k_r x E_r) + ((E_i + E_r) x n) x s
    I = integral of w(u) w(v) exp(-j k (s_u u + s_v v + (b_uu u^2 + b_vv v^2)/2 + b_uv u v))
    p_u = x_u + k_i (x_u . n)/cos t        s_u = (k_i - s) . p_u
    b_uv = d_u . p_v + (p_u . p_v - (p_u . s)(p_v . s))/L_o - (k_i - s) . n (dn(p_u) . p_v)

Symbols: L_i -> length_in (unfolded, source to hit), L_o -> length_out (hit to receiver), k_i, k_r, s -> unit directions in,
mirrored and to the receiver, n -> normal on the lit side, dn(p) -> its change along p, E_i, E_r -> incident and reflected field by the
TE/TM coefficients of the surface, P -> receive polarisation, d_u, x_u -> foot and place, the derivatives of a ray's direction and position
along the grid, p_u -> step on the surface from tube to tube, dOmega -> weight, the solid angle of a tube (for a plane wave its area),
A = |x_u x x_v . k_i| its cross-section. |a|^2 is received over transmitted power between isotropic antennas; on a perfect conductor V is
the textbook 2 n x (k x E).
Tubes are ray differentials: x_u grows by t d_u over a way t; a reflection makes x_u = p_u and d_u = d_u - 2 (d_u . n) n + 2 cos t dn(p_u)
- 2 (k_i . dn(p_u)) n. So a tube spreads behind a curved surface, its field falls with the square root of its cross-section, and turns by
90 degrees at each caustic; there the product of field and area, which is all that counts, goes to zero.
The weight w is a hat on [-1, 1] (tubes overlap by half and sum to one) on curved facets and in rooms, a box on [-1/2, 1/2] on flat
facets of objects. Hats cover the phase steps that remain between neighbours, but taper the edges of a plate, which are all that returns
away from its specular direction (10 cm plate tilted by 10 degrees, one tube per square wavelength: -1.8 dB with hats, 0.0 with boxes).
Tubes that straddle an edge are divided: radartwin.simulation.curved.division. Measured figures: docs/decisions/001.
Curved facets: a hit is lifted by h = -1/2 sum_{i<j} b_i b_j (n_i - n_j).(p_j - p_i) along the interpolated normal, b its barycentrics.
Amplitudes leave this module conjugated, for signals exp(+j k L), and without the propagation phase. Ref: H. Ling, R. Chou, S. Lee,
IEEE Trans. Antennas Propag. 37 (1989) 194, with an integral per tube in place of point sums.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.simulation.curved import shell
from radartwin.simulation.curved.tube_grid import Launch
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.reflection_table import ReflectionTable


@dataclass(frozen=True)
class Antennas:
    """Where fields start and arrive, per pose, in the geometry's frame.

    Attributes:
        position: (F, 3) metres; ignored for a plane wave except as direction of arrival (a point far away).
        axis: (F, 3) unit; the field is its normalised projection across the ray.
        cross: take the perpendicular of that projection instead (H for V).
    """

    position: np.ndarray
    axis: np.ndarray
    cross: bool = False


@dataclass(frozen=True)
class Occluder:
    """Static geometry that can stand between sensor and object: its scene, and each pose's map from the object's frame to its own.

    Attributes:
        geometry: what may block.
        rotation: (F, 3, 3); translation: (F, 3).
    """

    geometry: Geometry
    rotation: np.ndarray
    translation: np.ndarray


@dataclass(frozen=True)
class Hits:
    """One entry per contributing hit.

    Attributes:
        pose: (N,) index; tube: (N,) index in the launch; bounce: (N,) reflections, from 1.
        amplitude: (N, Q) complex, conjugated, without propagation phase.
        length_in_m, length_out_m: (N,) float64; departure, arrival: (N, 3) unit, from source and receiver towards the path.
        first_m: (N,) float64, source to first hit. sequence: (N,) uint64, 1 + label of each face met, LABEL_BITS each, last lowest.
    """

    pose: np.ndarray
    tube: np.ndarray
    bounce: np.ndarray
    amplitude: np.ndarray
    length_in_m: np.ndarray
    length_out_m: np.ndarray
    departure: np.ndarray
    arrival: np.ndarray
    first_m: np.ndarray
    sequence: np.ndarray

    def where(self, keep: np.ndarray) -> "Hits":
        """The chosen hits, by mask or index."""
        return Hits(*(getattr(self, one.name)[keep] for one in fields(Hits)))

    @staticmethod
    def concatenate(parts: Sequence["Hits"]) -> "Hits":
        if len(parts) == 1:
            return parts[0]
        return Hits(*(np.concatenate([getattr(part, one.name) for part in parts]) for one in fields(Hits)))

    @staticmethod
    def none(nodes: int) -> "Hits":
        """No hits."""
        none, flat = np.zeros(0, int), np.zeros((0, 3))
        length = np.zeros(0)
        return Hits(none, none, none, np.zeros((0, nodes), complex), length, length, flat, flat, length, np.zeros(0, np.uint64))


def trace(
    geometry: Geometry,
    table: ReflectionTable,
    launch: Launch,
    transmit: Antennas,
    receive: Antennas,
    *,
    max_bounces: int,
    cluster: np.ndarray | None = None,
    first_hit: int = 0,
    labels: np.ndarray | None = None,
    occluder: Occluder | None = None,
    prune: float = 0.0,
    hats: bool = False,
    pieces: int = 1,
) -> Hits:
    """All hits of a launch, up to `max_bounces` reflections.

    What is a shell (`shell.of`) is also seen through: straight in by its near wall, reflections inside, straight out. In a room with
    several frequency nodes and pruning, tubes are first found with the largest reflection over the sweep at one node, and only those that
    matter (a few in a hundred) are traced again at all nodes.

    Args:
        geometry: what is hit; table: its surfaces' reflection, at Q frequencies.
        launch: tubes of F poses; transmit, receive: antennas of the same poses (of one phase centre when equal positions).
        cluster, first_hit: with `cluster` (faces,) given, keep only tubes whose first hit lies on a face of cluster `first_hit`, so that
            launches of different density share the scene between them.
        labels: (faces,) below 4095, to be told which faces a path met.
        occluder: static geometry tested between sensor and first and last hit.
        prune: leave out hits below this share of the strongest of their pose in its block (division.blocks).
        hats: hat tubes everywhere (rooms); otherwise on curved facets only.
        pieces: odd; tubes across which the sequence of smooth patches changes are traced in so many parts each way, and those that a
            curved surface spreads onto another.
    """
    settings = (launch, transmit, receive, cluster, first_hit, labels, occluder, prune, hats, pieces)
    # nothing that leaves a convex body meets it again
    parts = _reflected(geometry, table, None, 1 if geometry.convex else max_bounces, *settings)
    shells = shell.of(geometry, table, None if cluster is None else cluster == first_hit)
    if shells is not None:
        parts += _reflected(geometry, shells.inside, shells, min(max_bounces, shell.INSIDE), *settings)
    return Hits.concatenate(parts) if parts else Hits.none(len(table.frequencies_hz))


def _reflected(
    geometry: Geometry,
    table: ReflectionTable,
    shells: shell.Shells | None,
    max_bounces: int,
    launch: Launch,
    transmit: Antennas,
    receive: Antennas,
    cluster: np.ndarray | None,
    first_hit: int,
    labels: np.ndarray | None,
    occluder: Occluder | None,
    prune: float,
    hats: bool,
    pieces: int,
) -> list[Hits]:
    """Hits of tubes on the outside of things, or, with shells given, by way of their walls."""
    from radartwin.simulation.curved import division, transit
    from radartwin.simulation.curved.device import Device

    def traced(table: ReflectionTable, shells: shell.Shells | None, found: np.ndarray | None, read: Callable) -> list:
        device = Device(geometry, table, cluster, labels, hats)
        walls = None if shells is None else transit.Walls(device, shells)
        frequency_hz = float(table.frequencies_hz.mean())
        run = _Run(device, walls, launch, transmit, receive, frequency_hz, max_bounces, first_hit, occluder, prune, geometry.convex)
        blocks = division.blocks(device, launch, geometry.corners, max_bounces, first_hit, pieces, found, walls)
        return [part for chosen in blocks for part in run.block(chosen, read)]

    if not len(geometry.corners):
        return []
    found = None
    if prune and hats and len(table.frequencies_hz) > 1:
        indices = traced(table.envelope(), None if shells is None else shells.envelope(), None, _read_indices)
        count = max((int(part.max()) + 1 for part in indices), default=0)
        matters = np.zeros(count, bool)
        for part in indices:
            matters[part] = True
        found = np.flatnonzero(matters)
    return traced(table, shells, found, _read_hits)


def _picked(lanes: tuple, keep: Any) -> list:
    """Lanes on the device gathered at some of their indices."""
    import drjit as dr

    def pick(value: Any) -> Any:
        return [pick(v) for v in value] if isinstance(value, list | tuple) else dr.gather(type(value), value, keep)

    picked = pick(lanes)
    dr.eval(picked)
    return picked


def _read_indices(lanes: tuple, keep: Any, number: int) -> np.ndarray:
    """Launch indices of contributing lanes."""
    return _picked(lanes[1:2], keep)[0].numpy()


def _vectors(lanes: Any) -> np.ndarray:
    """(N, 3) float64; component by component, for a kernel that joins them would be compiled for every N."""
    return np.stack([component.numpy() for component in lanes], axis=1).astype(float)


def _read_hits(lanes: tuple, keep: Any, number: int) -> Hits:
    """Contributing lanes as host arrays; a = -j (re + j im), conjugated."""
    pose, index, length, length_out, departure, outgoing, first, sequence, values = _picked(lanes, keep)
    amplitude = np.empty((len(keep), len(values)), complex)
    for node, (re, im) in enumerate(values):
        amplitude[:, node] = im.numpy() + 1j * re.numpy()
    return Hits(
        pose.numpy().astype(int), index.numpy().astype(int), np.full(len(keep), number), amplitude, length.numpy(), length_out.numpy(),
        _vectors(departure), -_vectors(outgoing), first.numpy(), sequence.numpy(),
    )  # fmt: skip


@dataclass(frozen=True)
class _Run:
    """What all blocks of tubes of one launch share."""

    device: Any
    walls: Any
    launch: Launch
    transmit: Antennas
    receive: Antennas
    frequency_hz: float
    max_bounces: int
    first_hit: int
    occluder: Occluder | None
    prune: float
    convex: bool

    def block(self, chosen: Any, read: Callable) -> Iterator:
        """Trace tubes by launch index; what `read` makes of the hits of one bounce after the other."""
        import drjit as dr
        import mitsuba as mi

        from radartwin.simulation.curved import contact as contacts
        from radartwin.simulation.curved import device as on_device
        from radartwin.simulation.curved import flight, scatter

        device, launch = self.device, self.launch
        wavenumber = dr.opaque(mi.Float, 2 * np.pi * self.frequency_hz / SPEED_OF_LIGHT)
        receiver_at, axis_at, forward_at = (
            on_device.rows(self.receive.position),
            on_device.rows(self.receive.axis),
            on_device.rows(launch.forward),
        )
        monostatic = bool(np.array_equal(self.transmit.position, self.receive.position))
        strongest = dr.zeros(mi.Float, launch.poses)
        tubes = flight.start(launch, self.transmit.axis, self.transmit.cross, chosen, device.nodes)
        origin, active = tubes.origin, contacts.cast(device, tubes, True)
        for number in range(1, self.max_bounces + 1):
            contact, active = contacts.meet(device, tubes, number == 1, active)
            if number == 1 and device.cluster is not None:
                active &= dr.gather(mi.UInt32, device.cluster, contact.face, active) == dr.opaque(mi.UInt32, self.first_hit)
            near = contact
            if self.walls and number == 1:
                active = self.walls.enter(tubes, near, active)
                active = contacts.cast(device, tubes, False, active)
                contact, active = contacts.meet(device, tubes, False, active)
            receiver = receiver_at(tubes.pose, active)
            way = -forward_at(tubes.pose, active) if launch.plane else receiver - contact.point
            outgoing = dr.normalize(way)
            length_out = dr.dot(receiver - contact.point, outgoing)
            if number == 1 and self.occluder is not None:
                active &= ~self._occluded(tubes.pose, origin, near.facet_point, active)
            seen = active & (dr.dot(outgoing, contact.normal) > contacts.COS_GRAZING) & (dr.dot(outgoing, contact.flat_normal) > 0)
            if self.walls:
                wall, seen = (
                    (near, seen) if monostatic and number == 1 else self.walls.exit(contact, outgoing, length_out, seen, launch.plane)
                )
            elif not self.convex and (number > 1 or not monostatic):  # what a tube hits first from the receiver itself, the receiver sees
                seen = contacts.visible(device, contact, outgoing, length_out, seen, launch.plane)
            if self.occluder is not None and (number > 1 or not monostatic):
                seen &= ~self._occluded(tubes.pose, receiver, contact.facet_point, seen)
            axis = flight.project(axis_at(tubes.pose, active), outgoing)
            if self.receive.cross:
                axis = dr.cross(outgoing, axis)
            if self.walls:
                axis = self.walls.received(wall, outgoing, axis, seen)
            values = scatter.scatter(device, tubes, contact, outgoing, length_out, axis, wavenumber, active, launch.plane)
            here = (
                tubes.pose, tubes.index, tubes.length, mi.Float64(length_out), tubes.departure, outgoing, tubes.first, tubes.sequence,
                values,
            )  # fmt: skip
            level = sum((re * re + im * im for re, im in values), mi.Float(0.0)) / dr.opaque(mi.Float, device.nodes)
            if self.prune:
                # the mode that would be chosen writes the number of poses into the kernel
                dr.scatter_reduce(dr.ReduceOp.Max, strongest, level, tubes.pose, seen, mode=dr.ReduceMode.Local)
            onward = number < self.max_bounces
            if onward:
                active = contacts.bounce(device, tubes, contact, active)
            # all that casts rays in one kernel: what is left unevaluated would cast them again for every array that is read
            tubes.evaluate(here, level, strongest, seen, active)
            if self.prune:
                seen = seen & (level >= dr.opaque(mi.Float, self.prune**2) * dr.gather(mi.Float, strongest, here[0], seen))
            keep = dr.compress(seen)
            if dr.width(keep):
                yield read(here, keep, number)
            if onward:
                alive = dr.compress(active)
                if dr.width(alive) == 0:
                    return
                tubes, active = tubes.compacted(alive), mi.Bool(True)

    def _occluded(self, pose: Any, first: Any, last: Any, active: Any) -> Any:
        from radartwin.simulation.curved import contact

        assert self.occluder is not None
        scene = self.occluder.geometry.scene()
        return contact.blocked(scene, self.occluder.rotation, self.occluder.translation, pose, first, last, active)
