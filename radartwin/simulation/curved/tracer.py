"""Trace ray tubes from reflection to reflection on the GPU or CPU.

`radartwin.simulation.curved.tubes` explains the formulas and symbols. Import this module only after a Mitsuba variant is active.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.simulation import variant
from radartwin.simulation.curved import contact as contacts
from radartwin.simulation.curved import division, flight, scatter
from radartwin.simulation.curved.contact import Contact
from radartwin.simulation.curved.device import Device
from radartwin.simulation.curved.flight import Tubes, picked
from radartwin.simulation.curved.jones import Coefficients, Encounters
from radartwin.simulation.curved.scatter import Reception
from radartwin.simulation.curved.shell import Shells
from radartwin.simulation.curved.transit import CROSSINGS, Line, Sheets
from radartwin.simulation.curved.tube_grid import TubeGrid
from radartwin.simulation.drjit_arrays import upload, vectors
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.hits import Antennas, Hits, TraceOptions
from radartwin.simulation.pruning import EARLY, largest
from radartwin.simulation.reflection_table import ReflectionTable
from radartwin.simulation.visibility import SHORT


@dataclass
class Setting:
    """Hold the data that all tubes of a grid share, on the device (GPU or CPU)."""

    device: Device
    grid: Any  # of `flight.on_device`
    transmit_axis: Any  # axis of the transmit antenna at F sensor poses
    receiver: Any  # position of the receive antenna
    receive_axis: Any  # axis of the receive antenna
    wavenumber: Any
    transmit_cross: bool  # as `Antennas.cross`
    receive_cross: bool

    def reception(self, pose: Any, contact: Contact, active: Any) -> tuple[Reception, Any]:
        """Return the receiver as seen from each contact, and a mask of the contacts that face the receiver."""
        receiver = dr.gather(mi.Vector3f, self.receiver, pose, active)
        away = -dr.gather(mi.Vector3f, self.grid.forward, pose, active) if self.grid.plane else receiver - contact.point
        outgoing = dr.normalize(away)
        length = dr.dot(receiver - contact.point, outgoing)
        across = flight.project(dr.gather(mi.Vector3f, self.receive_axis, pose, active), outgoing)
        if self.receive_cross:
            across = dr.cross(outgoing, across)
        seen = active & (dr.dot(outgoing, contact.normal) > contacts.COS_GRAZING) & (dr.dot(outgoing, contact.flat_normal) > 0)
        return Reception(outgoing, length, across, self.grid.plane), seen

    def lanes(self, tubes: Tubes, contact: Contact, reception: Reception, walls: list, active: Any, corner: Any) -> list[Any]:
        """Compute the echo of the tubes. Returns the arrays that `Tracer._hits` reads."""
        echo = scatter.scatter(self.device, tubes, contact, reception, self.wavenumber, active, corner)
        return [
            tubes.pose, tubes.length, mi.Float64(reception.length), tubes.departure, reception.direction, tubes.first,
            echo, tubes.encounters, walls,
            contact.facet_point + contact.flat_normal * self.device.lift, reception.across,
        ]  # fmt: skip

    def single_bounce(self, index: Any, pieces: flight.PieceArrays | None) -> tuple[list[Any], Any]:
        """Trace tubes to their first facet and back.

        Returns:
            The arrays that `Tracer._hits` reads, and a mask of the tubes that the receiver sees.
        """
        tubes = flight.start(self.grid, self.transmit_axis, self.transmit_cross, index, pieces)
        contact, active = contacts.meet(self.device, tubes, True, contacts.cast(self.device, tubes, True))
        active = self.device.in_cluster(contact.face, active)
        contacts.note(self.device, tubes, contact, active)
        reception, seen = self.reception(tubes.pose, contact, active)
        lanes = self.lanes(tubes, contact, reception, [], active, None if pieces is None else pieces.corner)
        dr.eval(lanes, seen)
        return lanes, seen


# Dr.Jit records the operations of this function once for each mesh, separately for one pose and for several poses. Later calls only run the
# compiled kernels. The limit is the number of recorded programs in memory. Dr.Jit 1.5.0 can take two settings for equal that differ only in
# which of their fields are True. Therefore, each polarisation of transmitter and receiver and each kind of wave has a function of its own.
_SINGLE_BOUNCE = {
    kind: dr.freeze(Setting.single_bounce, limit=64, warn_after=1_000_000) for kind in itertools.product((False, True), repeat=3)
}


class Receivers(NamedTuple):
    """Describe which receivers see the tubes of G different grids, for F sensor poses of which several can have one grid.

    Attributes:
        pose: (F,) sensor poses, ordered by grid. first, count: (G,) place of the first pose of each grid in `pose`, and their number.
    """

    pose: np.ndarray
    first: np.ndarray
    count: np.ndarray

    @staticmethod
    def of(which: np.ndarray) -> "Receivers":
        """Return the receivers of sensor poses with grids `which` (F,)."""
        count = np.bincount(which)
        return Receivers(np.argsort(which, kind="stable"), np.cumsum(count) - count, count)

    def of_tubes(self, grid: np.ndarray, active: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the index (N,) of each active tube, once for each of its receivers, and the sensor pose (N,) of this receiver."""
        alive = np.flatnonzero(active)
        count = self.count[grid[alive]]
        tube = np.repeat(alive, count)
        place = np.arange(len(tube)) - np.repeat(np.cumsum(count) - count, count)
        return tube, self.pose[self.first[grid[tube]] + place]


class Tracer:
    """Trace the tubes of one grid. Without `shells`, tubes pass through panes only. With `shells`, the tubes are those that enter a shell
    through its wall.
    """

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
        """Prepare the tracing. `panes` is a mask (faces,) of the sheets through which tubes pass; None if there are none."""
        self.geometry, self.transmit, self.receive, self.options, self.poses = geometry, transmit, receive, options, grid.poses
        self.monostatic = bool(np.array_equal(transmit.position, receive.position))
        self.receivers = None
        axis, bounces = transmit.axis, options.bounces
        if not (self.monostatic or grid.plane):
            first, which = grid.distinct(axis)
            if len(first) < grid.poses:
                self.receivers = Receivers.of(which)
                grid, axis = grid.rows(first), axis[first]
                bounces = None if bounces is None else np.maximum.reduceat(bounces[self.receivers.pose], self.receivers.first)
        self.grid = grid
        self.device = Device.of(geometry, options)
        self.coefficients = Coefficients(table, table if shells is None else shells.inside)
        self.walls = None if shells is None else Sheets(self.device, shells.faces)
        self.panes = None if panes is None else Sheets(self.device, panes)
        self.most = None if bounces is None else upload(mi.UInt32, bounces)
        self.large = grid.per_pose > division.TUBES_PER_BLOCK  # then tubes that hit nothing are dropped first
        self.wavelength_m = SPEED_OF_LIGHT / float(table.frequencies_hz.mean())
        self.setting = Setting(
            self.device, flight.on_device(grid), vectors(axis), vectors(receive.position), vectors(receive.axis),
            dr.opaque(mi.Float, 2 * np.pi * float(table.frequencies_hz.mean()) / SPEED_OF_LIGHT), transmit.cross, receive.cross,
        )  # fmt: skip
        # The receiver sees the first hit of every tube, and no tube is traced beyond this hit.
        self.single = self.monostatic and options.max_bounces == 1 and not (self.walls or self.panes or self.large)

    def hits(self) -> list[Hits]:
        """Return the hits of all tubes of the grid."""
        variant.share_threads()
        most = 1 if self.receivers is None else int(self.receivers.count.max())
        panes = self.panes is not None
        blocks = division.blocks(self.device, self.grid, self.geometry, self.options, self.walls, panes, self.wavelength_m, most)
        return [part for selection in blocks for part in self._block(selection)]

    def _block(self, selection: flight.TubeSelection) -> Iterator[Hits]:
        """Trace one block of tubes and yield its hits.

        Tubes that meet a pane continue twice, reflected and straight on. Tubes that are traced together have the same number of bounces and
        have crossed the same number of panes.
        """
        strongest = np.zeros(self.poses)
        index, pieces = upload(mi.UInt32, selection.index), flight.PieceArrays.of(selection)
        if self.single:
            recorded = _SINGLE_BOUNCE[self.transmit.cross, self.receive.cross, self.grid.plane]
            yield from self._hits(*recorded(self.setting, index, pieces), 1, strongest)
            return
        tubes = flight.start(self.setting.grid, self.setting.transmit_axis, self.setting.transmit_cross, index, pieces)
        active = contacts.cast(self.device, tubes, True)
        corner = None if pieces is None else pieces.corner
        if self.large and not self.options.hats:  # nearly every tube of a room meets a wall
            dr.eval(tubes, active)
            tubes, active = tubes.compacted(dr.compress(active)), mi.Bool(True)
            if not dr.width(tubes.index):
                return
        waiting: dict[tuple[int, int], list[Tubes]] = {(1, 0): [tubes]}
        while waiting:
            done = min(waiting, key=sum)  # no other waiting tubes can still come to the same (bounce, crossed)
            hits, onward = self._step(Tubes.joined(waiting.pop(done)), *done, active, strongest, corner)
            yield from hits
            for going, following in onward:
                waiting.setdefault(following, []).append(going)
            active = mi.Bool(True)

    def _step(self, tubes: Tubes, bounce: int, crossed: int, active: Any, strongest: np.ndarray, corner: Any) -> tuple[list[Hits], list]:
        """Reflect tubes at the facets that `contacts.cast` found for them.

        Args:
            bounce: number of bounces including this one. crossed: number of panes that the tubes have already crossed.
            strongest: (F,) largest amplitude of a hit of each sensor pose so far; the function updates the array.
        Returns:
            A list of hits, which may be empty, and a list of (tubes, (bounce, crossed)) for the tubes that must still be traced.
        """
        options = self.options
        contact, near, met, active = self._meet(tubes, bounce, active)
        straight, onwards = [], []
        if self.panes and crossed < CROSSINGS:
            copies, passing = self.panes.behind(tubes, contact, met)
            straight = [(copies, contacts.cast(self.device, copies, False, passing))]
        # If transmitter and receiver are at one point, the receiver sees the first hit of every tube.
        clear = self.monostatic and bounce == 1 and crossed == 0
        contacts.note(self.device, tubes, contact, active)
        here, lit = replace(tubes), active
        if bounce < options.max_bounces:
            reflected = active
            if options.bounces is not None:
                reflected = active & (dr.gather(mi.UInt32, self.most, tubes.pose, active) > bounce)
            onwards = [(tubes, contacts.bounce(self.device, tubes, contact, reflected))]
        # Evaluate all ray casts in one kernel, because Dr.Jit would cast the rays of an unevaluated array again at each read.
        moved, hits = (straight, tubes, *(going for _, going in onwards)), []
        if self.receivers is not None:
            dr.eval(moved, here, contact, near, active)
            here, contact, near, lit = self._facing(here, contact, near, active, bounce)
        if dr.width(here.pose):
            reception, walls, seen = self._reception(here, contact, near, clear, lit)
            lanes = self.setting.lanes(here, contact, reception, walls, lit, corner)
            dr.eval(moved, lanes, seen)
            hits = self._hits(lanes, seen, bounce, strongest, None if clear else self.panes)
        waiting = []
        for group, more in ((straight, (bounce, crossed + 1)), (onwards, (bounce + 1, crossed))):
            for going, mask in group:
                alive = dr.compress(mask)
                if dr.width(alive):
                    waiting.append((going.compacted(alive), more))
        return hits, waiting

    def _facing(self, tubes: Tubes, contact: Contact, near: Contact, active: Any, bounce: int) -> tuple[Tubes, Contact, Contact, Any]:
        """Return the tubes and contacts that face a receiver, once for each of these receivers, and a mask of true. The field `pose` of the
        tubes is then that of the receiver.
        """
        assert self.receivers is not None
        tube, pose = self.receivers.of_tubes(tubes.pose.numpy(), active.numpy())
        if self.options.bounces is not None:
            tube, pose = (values[self.options.bounces[pose] >= bounce] for values in (tube, pose))
        index, pose, curved = upload(mi.UInt32, tube), upload(mi.UInt32, pose), self.device.curved
        chosen = dr.compress(self.setting.reception(pose, contact.picked(index, curved), mi.Bool(True))[1]) if len(tube) else index
        index, pose = picked([index, pose], chosen)
        here = tubes.compacted(index)
        here.pose = pose
        picks = contact.picked(index, curved)
        return here, picks, picks if near is contact else near.picked(index, curved), mi.Bool(True)

    def _hits(self, lanes: list, seen: Any, bounce: int, strongest: np.ndarray, panes: Sheets | None = None) -> list[Hits]:
        """Return the hits among the results `lanes` of `Setting.lanes` that the mask `seen` selects, also behind `panes`."""
        keep = dr.compress(seen)
        if not dr.width(keep):
            return []
        *hits, origin, across = picked(lanes, keep)
        dr.eval(hits, origin, across)
        groups = [(hits, hits.pop())]
        if panes:
            reach = dr.full(mi.Float, dr.inf, dr.width(origin)) if self.grid.plane else (1 - SHORT) * mi.Float(hits[2])
            groups = ((picked(hits, free), met) for free, met in panes.free(Line(origin, hits[4], reach, across), self.grid.plane))
        return [self._read(group, met, bounce, strongest) for group, met in groups]

    def _meet(self, tubes: Tubes, bounce: int, active: Any) -> tuple[Contact, Contact, Any, Any]:
        """Move the tubes to their next facet.

        Returns:
            The contact at which the tubes are reflected, the contact nearest to the transmitter, a mask of the tubes that meet a facet, and
            a mask of the tubes that are reflected. The two contacts differ if the tubes first pass through the wall of a shell.
        """
        contact, active = contacts.meet(self.device, tubes, bounce == 1, active)
        near, met = contact, active
        if bounce == 1:
            active = self.device.in_cluster(contact.face, active)
            if self.walls:
                active = self.walls.enter(tubes, near, active)
                active = contacts.cast(self.device, tubes, False, active)
                contact, active = contacts.meet(self.device, tubes, False, active)
        return contact, near, met, active

    def _reception(self, tubes: Tubes, contact: Contact, near: Contact, clear: bool, active: Any) -> tuple[Reception, list, Any]:
        """Compute the direction, distance and polarisation of the receiver at each contact, the point where a tube meets a facet. `clear`
        tells whether the receiver sees all contacts.

        Returns:
            Direction, distance and polarisation of the receiver at each contact, encounters of the polarisation vector with the walls of
            shells, and a mask of the contacts that the receiver sees. If the geometry has panes, this mask ignores its surfaces, and
            `Sheets.free` tests them later.
        """
        plane = self.grid.plane
        reception, seen = self.setting.reception(tubes.pose, contact, active)
        outgoing, length = reception.direction, reception.length
        wall = near
        if self.walls:
            if not clear:
                wall, seen = self.walls.exit(contact, outgoing, length, seen, plane)
        elif not self.geometry.convex and not clear and not self.panes:
            seen = contacts.visible(self.device, contact, outgoing, length, seen, plane)
        walls = [contacts.encounter(self.device, wall, outgoing, reception.across, True, seen)[1]] if self.walls else []
        return reception, walls, seen

    def _read(self, lanes: list, met: list, bounce: int, strongest: np.ndarray) -> Hits:
        """Compute the amplitudes of hits, and return the strong hits as NumPy arrays. The function updates `strongest` as in `_step`."""
        dr.eval(lanes, met)
        pose, *read, echo, before = lanes
        pose, echo = pose.numpy(), _rows(echo)
        before, after = (_encounters(facets, len(pose)) for facets in (before, met))
        coefficients, prune = self.coefficients, self.options.prune
        floor = np.zeros(len(strongest)) if self.options.least is None else EARLY * self.options.least
        rough = coefficients.amplitudes(coefficients.few, before, after, echo[2:], echo[:2], np.maximum(floor, prune * strongest)[pose])
        level = largest(rough)
        np.maximum.at(strongest, pose, level)
        keep = np.flatnonzero(level >= np.maximum(floor, prune * strongest)[pose])
        amplitude = np.take(rough, keep, axis=0)
        if len(coefficients.few) < len(coefficients.every):
            before, after = before.where(keep), after.where(keep)
            amplitude = coefficients.amplitudes(coefficients.every, before, after, echo[2:, keep], echo[:2, keep], np.zeros(len(keep)))
        length, length_out, departure, outgoing, first = read
        # A scene has millions of hits, so that each array is copied once, for the strong hits only.
        return Hits(
            np.take(pose, keep).astype(int), np.full(len(keep), bounce), amplitude, np.take(length.numpy(), keep),
            np.take(length_out.numpy(), keep), _vectors(departure, keep), -_vectors(outgoing, keep), np.take(first.numpy(), keep),
        )  # fmt: skip


def _vectors(lanes: Any, keep: np.ndarray) -> np.ndarray:
    """Copy the vectors with the indices `keep` from the device to a NumPy array (N, 3), float64.

    The function copies each component separately, because Dr.Jit would compile a kernel that joins the components anew for every N.
    """
    out = np.empty((len(keep), 3))
    for axis, component in enumerate(lanes):
        out[:, axis] = np.take(component.numpy(), keep)
    return out


def _rows(lanes: Sequence[Any]) -> np.ndarray:
    """Copy K arrays of N numbers from the device to a NumPy array (K, N)."""
    return np.stack([lane.numpy() for lane in lanes])


def _encounters(facets: Sequence[Sequence[Any]], count: int) -> Encounters:
    """Copy the encounters of `count` tubes from the device."""
    if not facets:
        return Encounters(np.zeros((0, count), np.uint32), np.zeros((0, 3, count), np.float32))
    return Encounters(_rows([met[0] for met in facets]), np.stack([_rows(met[1:]) for met in facets]))
