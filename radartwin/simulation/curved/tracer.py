"""Trace ray tubes from reflection to reflection on the GPU or CPU.

`radartwin.simulation.curved.tubes` explains the formulas and symbols. Import this module only after a Mitsuba variant is active.
"""

from collections.abc import Callable, Iterator
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.simulation.curved import contact as contacts
from radartwin.simulation.curved import division, flight, scatter
from radartwin.simulation.curved.contact import Contact
from radartwin.simulation.curved.device import Device, rows
from radartwin.simulation.curved.flight import Tubes
from radartwin.simulation.curved.hits import Antennas, Hits, TraceOptions
from radartwin.simulation.curved.scatter import Reception
from radartwin.simulation.curved.shell import Shells
from radartwin.simulation.curved.transit import Walls
from radartwin.simulation.curved.tube_grid import TubeGrid
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.reflection_table import ReflectionTable


class Tracer:
    """Trace the tubes of one grid. Without `shells`, tubes stay outside all surfaces; with `shells`, they pass through walls of shells."""

    def __init__(
        self,
        geometry: Geometry,
        table: ReflectionTable,
        shells: Shells | None,
        grid: TubeGrid,
        transmit: Antennas,
        receive: Antennas,
        options: TraceOptions,
    ):
        self.geometry, self.grid, self.transmit, self.receive, self.options = geometry, grid, transmit, receive, options
        self.device = Device(geometry, table, options.cluster, options.labels, options.hats)
        self.walls = None if shells is None else Walls(self.device, shells)
        self.wavenumber = dr.opaque(mi.Float, 2 * np.pi * float(table.frequencies_hz.mean()) / SPEED_OF_LIGHT)
        self.monostatic = bool(np.array_equal(transmit.position, receive.position))
        self.receiver_at, self.axis_at, self.forward_at = rows(receive.position), rows(receive.axis), rows(grid.forward)

    def hits(self, selected: np.ndarray | None) -> list[Hits]:
        """Return the hits of the tubes with the sorted indices `selected` (None: all tubes)."""
        return self._traced(selected, _read_hits)

    def tube_indices(self) -> list[np.ndarray]:
        """Return the grid indices of the tubes that contribute to the received signal."""
        return self._traced(None, _read_indices)

    def _traced(self, selected: np.ndarray | None, read: Callable) -> list:
        blocks = division.blocks(self.device, self.grid, self.geometry.corners, self.options, selected, self.walls)
        return [part for selection in blocks for part in self._block(selection, read)]

    def _block(self, selection: flight.TubeSelection, read: Callable) -> Iterator:
        """Trace one block of tubes. For each bounce with hits, the function yields the value that `read` returns for these hits."""
        options = self.options
        strongest = dr.zeros(mi.Float, self.grid.poses)
        tubes = flight.start(self.grid, self.transmit.axis, self.transmit.cross, selection, self.device.nodes)
        origin, active = tubes.origin, contacts.cast(self.device, tubes, True)
        for bounce in range(1, options.max_bounces + 1):
            contact, near, active = self._meet(tubes, origin, bounce, active)
            reception, seen = self._reception(tubes, contact, near, bounce, active)
            values = scatter.scatter(self.device, tubes, contact, reception, self.wavenumber, active)
            lanes = (
                tubes.pose, tubes.length, mi.Float64(reception.length), tubes.departure, reception.direction, tubes.first,
                tubes.sequence, values, tubes.index,
            )  # fmt: skip
            level = sum((re * re + im * im for re, im in values), mi.Float(0.0)) / dr.opaque(mi.Float, self.device.nodes)
            if options.prune:
                # Local reduction is necessary, because Dr.Jit's default reduction mode would compile the number of poses into the kernel.
                dr.scatter_reduce(dr.ReduceOp.Max, strongest, level, tubes.pose, seen, mode=dr.ReduceMode.Local)
            onward = bounce < options.max_bounces
            if onward:
                active = contacts.bounce(self.device, tubes, contact, active)
            # Evaluate all ray casts in one kernel, because Dr.Jit would cast the rays of an unevaluated array again at each read.
            tubes.evaluate(lanes, level, strongest, seen, active)
            if options.prune:
                seen = seen & (level >= dr.opaque(mi.Float, options.prune**2) * dr.gather(mi.Float, strongest, lanes[0], seen))
            keep = dr.compress(seen)
            if dr.width(keep):
                yield read(lanes, keep, bounce)
            if onward:
                alive = dr.compress(active)
                if dr.width(alive) == 0:
                    return
                tubes, active = tubes.compacted(alive), mi.Bool(True)

    def _meet(self, tubes: Tubes, origin: Any, bounce: int, active: Any) -> tuple[Contact, Contact, Any]:
        """Move the tubes to their next facet.

        Returns:
            The contact at which the tubes are reflected, the contact nearest to the transmitter, and a mask of the tubes that stay active.
            The two contacts differ if the tubes first pass through the wall of a shell.
        """
        contact, active = contacts.meet(self.device, tubes, bounce == 1, active)
        near = contact
        if bounce == 1:
            active = self.device.in_cluster(contact.face, self.options.first_cluster, active)
            if self.walls:
                active = self.walls.enter(tubes, near, active)
                active = contacts.cast(self.device, tubes, False, active)
                contact, active = contacts.meet(self.device, tubes, False, active)
            if self.options.occluder is not None:
                active &= ~contacts.blocked(self.options.occluder, tubes.pose, origin, near.facet_point, active)
        return contact, near, active

    def _reception(self, tubes: Tubes, contact: Contact, near: Contact, bounce: int, active: Any) -> tuple[Reception, Any]:
        """Return direction, distance and polarisation of the receiver at each contact, and a mask of contacts that the receiver sees."""
        plane = self.grid.plane
        receiver = self.receiver_at(tubes.pose, active)
        outgoing = dr.normalize(-self.forward_at(tubes.pose, active) if plane else receiver - contact.point)
        length = dr.dot(receiver - contact.point, outgoing)
        seen = active & (dr.dot(outgoing, contact.normal) > contacts.COS_GRAZING) & (dr.dot(outgoing, contact.flat_normal) > 0)
        # If transmitter and receiver are at one point, the receiver sees the first hit of every tube.
        first_of_receiver = self.monostatic and bounce == 1
        wall = near
        if self.walls:
            if not first_of_receiver:
                wall, seen = self.walls.exit(contact, outgoing, length, seen, plane)
        elif not self.geometry.convex and not first_of_receiver:
            seen = contacts.visible(self.device, contact, outgoing, length, seen, plane)
        if self.options.occluder is not None and not first_of_receiver:
            seen &= ~contacts.blocked(self.options.occluder, tubes.pose, receiver, contact.facet_point, seen)
        axis = flight.project(self.axis_at(tubes.pose, active), outgoing)
        if self.receive.cross:
            axis = dr.cross(outgoing, axis)
        if self.walls:
            axis = self.walls.received(wall, outgoing, axis, seen)
        return Reception(outgoing, length, axis, plane), seen


def _picked(lanes: tuple, keep: Any) -> list:
    """Select the tubes at the lane indices `keep`, while the arrays stay on the device."""

    def pick(value: Any) -> Any:
        return [pick(v) for v in value] if isinstance(value, list | tuple) else dr.gather(type(value), value, keep)

    picked = pick(lanes)
    dr.eval(picked)
    return picked


def _read_indices(lanes: tuple, keep: Any, bounce: int) -> np.ndarray:
    return _picked(lanes[-1:], keep)[0].numpy()


def _vectors(lanes: Any) -> np.ndarray:
    """Copy vectors from the device to a NumPy array (N, 3), float64.

    The function copies each component separately, because Dr.Jit would compile a kernel that joins the components anew for every N.
    """
    return np.stack([component.numpy() for component in lanes], axis=1).astype(float)


def _read_hits(lanes: tuple, keep: Any, bounce: int) -> Hits:
    """Return the hits at the lane indices `keep` as NumPy arrays.

    The amplitude is the complex conjugate of -j (re + j im), because `Hits` uses signals with the phase factor exp(+j k L).
    """
    pose, length, length_out, departure, outgoing, first, sequence, values = _picked(lanes[:-1], keep)
    amplitude = np.empty((len(keep), len(values)), complex)
    for node, (re, im) in enumerate(values):
        amplitude[:, node] = im.numpy() + 1j * re.numpy()
    return Hits(
        pose.numpy().astype(int), np.full(len(keep), bounce), amplitude, length.numpy(), length_out.numpy(),
        _vectors(departure), -_vectors(outgoing), first.numpy(), sequence.numpy(),
    )  # fmt: skip
