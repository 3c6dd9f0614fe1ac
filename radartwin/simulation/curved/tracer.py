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
from radartwin.simulation.curved.transit import CROSSINGS, Panes, Walls
from radartwin.simulation.curved.tube_grid import TubeGrid
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.reflection_table import ReflectionTable


class Tracer:
    """Trace the tubes of one grid. Without `shells`, tubes pass through panes only; with `shells`, they pass through walls of shells."""

    def __init__(
        self,
        geometry: Geometry,
        table: ReflectionTable,
        shells: Shells | None,
        grid: TubeGrid,
        transmit: Antennas,
        receive: Antennas,
        options: TraceOptions,
        panes: np.ndarray | None = None,
    ):
        """Prepare the tracing. `panes` is a mask (faces,) of the sheets that tubes also pass through; None if there are none."""
        self.geometry, self.grid, self.transmit, self.receive, self.options = geometry, grid, transmit, receive, options
        self.device = Device(geometry, table, options.cluster, options.labels, options.hats)
        self.walls = None if shells is None else Walls(self.device, shells)
        self.panes = None if panes is None else Panes(self.device, table, panes)
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
        """Trace one block of tubes. For each bounce with hits, the function yields the value that `read` returns for these hits.

        Tubes that meet a pane continue twice, reflected and straight on. All tubes that are traced together have had the same number of
        bounces and of panes.
        """
        strongest = dr.zeros(mi.Float, self.grid.poses)
        tubes = flight.start(self.grid, self.transmit.axis, self.transmit.cross, selection, self.device.nodes)
        waiting = [(tubes, 1, 0, contacts.cast(self.device, tubes, True))]
        while waiting:
            found, onward = self._step(*waiting.pop(), strongest, read)
            yield from found
            waiting += onward

    def _step(self, tubes: Tubes, bounce: int, crossed: int, active: Any, strongest: Any, read: Callable) -> tuple[list, list]:
        """Reflect tubes at the facets that `contacts.cast` found for them.

        Args:
            bounce: number of bounces including this one. crossed: number of panes before.
            strongest: largest power of a hit of each sensor pose so far; the function updates the array.
        Returns:
            The value of `read` for the hits, if there are any, and the (tubes, bounce, crossed, active) that go on.
        """
        options = self.options
        source, sequence = tubes.origin, tubes.sequence
        contact, near, met, active = self._meet(tubes, source, bounce, active)
        straight, onwards = [], []
        if self.panes and crossed < CROSSINGS:
            copies, passing = self.panes.behind(tubes, contact, sequence, met)
            straight = [(copies, contacts.cast(self.device, copies, False, passing))]
        reception, seen = self._reception(tubes, contact, near, bounce == 1 and crossed == 0, active)
        values = scatter.scatter(self.device, tubes, contact, reception, self.wavenumber, active)
        lanes = (
            tubes.pose, tubes.length, mi.Float64(reception.length), tubes.departure, reception.direction, tubes.first,
            tubes.sequence, values, tubes.index,
        )  # fmt: skip
        level = sum((re * re + im * im for re, im in values), mi.Float(0.0)) / dr.opaque(mi.Float, self.device.nodes)
        if options.prune:
            # Local reduction is necessary, because Dr.Jit's default reduction mode would compile the number of poses into the kernel.
            dr.scatter_reduce(dr.ReduceOp.Max, strongest, level, tubes.pose, seen, mode=dr.ReduceMode.Local)
        if bounce < options.max_bounces:
            onwards = [(tubes, contacts.bounce(self.device, tubes, contact, active))]
        # Evaluate all ray casts in one kernel, because Dr.Jit would cast the rays of an unevaluated array again at each read.
        dr.schedule(*(value for copies, passing in straight for value in (*copies.values(), passing)))
        tubes.evaluate(lanes, level, strongest, seen, *(going for _, going in onwards))
        if options.prune:
            seen = seen & (level >= dr.opaque(mi.Float, options.prune**2) * dr.gather(mi.Float, strongest, lanes[0], seen))
        keep = dr.compress(seen)
        found = [read(lanes, keep, bounce)] if dr.width(keep) else []
        waiting = []
        for some, more in ((straight, (bounce, crossed + 1)), (onwards, (bounce + 1, crossed))):
            for going, mask in some:
                alive = dr.compress(mask)
                if dr.width(alive):
                    waiting.append((going.compacted(alive), *more, mi.Bool(True)))
        return found, waiting

    def _meet(self, tubes: Tubes, origin: Any, bounce: int, active: Any) -> tuple[Contact, Contact, Any, Any]:
        """Move the tubes to their next facet.

        Returns:
            The contact at which the tubes are reflected, the contact nearest to the transmitter, a mask of the tubes that meet a facet, and
            a mask of the tubes that are reflected. The two contacts differ if the tubes first pass through the wall of a shell.
        """
        contact, active = contacts.meet(self.device, tubes, bounce == 1, active)
        near, met = contact, active
        if bounce == 1:
            active = self.device.in_cluster(contact.face, self.options.first_cluster, active)
            if self.walls:
                active = self.walls.enter(tubes, near, active)
                active = contacts.cast(self.device, tubes, False, active)
                contact, active = contacts.meet(self.device, tubes, False, active)
            if self.options.occluder is not None:
                active &= ~contacts.blocked(self.options.occluder, tubes.pose, origin, near.facet_point, active)
        return contact, near, met, active

    def _reception(self, tubes: Tubes, contact: Contact, near: Contact, first: bool, active: Any) -> tuple[Reception, Any]:
        """Return direction, distance and polarisation of the receiver at each contact, and a mask of contacts that the receiver sees.

        `first` tells whether the contacts are the first facets that the tubes have met.
        """
        plane = self.grid.plane
        receiver = self.receiver_at(tubes.pose, active)
        outgoing = dr.normalize(-self.forward_at(tubes.pose, active) if plane else receiver - contact.point)
        length = dr.dot(receiver - contact.point, outgoing)
        seen = active & (dr.dot(outgoing, contact.normal) > contacts.COS_GRAZING) & (dr.dot(outgoing, contact.flat_normal) > 0)
        # If transmitter and receiver are at one point, the receiver sees the first hit of every tube.
        first_of_receiver = self.monostatic and first
        wall = near
        if self.walls:
            if not first_of_receiver:
                wall, seen = self.walls.exit(contact, outgoing, length, seen, plane)
        elif not self.geometry.convex and not first_of_receiver and not self.panes:
            seen = contacts.visible(self.device, contact, outgoing, length, seen, plane)
        if self.options.occluder is not None and not first_of_receiver:
            seen &= ~contacts.blocked(self.options.occluder, tubes.pose, receiver, contact.facet_point, seen)
        axis = flight.project(self.axis_at(tubes.pose, active), outgoing)
        if self.receive.cross:
            axis = dr.cross(outgoing, axis)
        if self.walls:
            axis = self.walls.received(wall, outgoing, axis, seen)
        elif self.panes and not first_of_receiver:
            axis, seen = self.panes.towards(contact, outgoing, length, axis, seen, plane)
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
