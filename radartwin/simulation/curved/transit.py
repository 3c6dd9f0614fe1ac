"""Pass ray tubes through sheets (panes) and through the walls of hollow objects (shells).

Import this module only after a Mitsuba variant is active.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi

from radartwin.simulation.curved.contact import Contact, Encounter, encounter, limited, surface
from radartwin.simulation.curved.device import Device
from radartwin.simulation.curved.flight import Tubes, picked
from radartwin.simulation.drjit_arrays import upload
from radartwin.simulation.visibility import SHORT

# Largest number of panes that a path crosses before its last reflection, and also after it. Four panes of glass leave -25 dB each way.
CROSSINGS = 4


class Line(NamedTuple):
    """Describe the lines from points on surfaces to the receiver."""

    origin: Any  # start of the line in metres
    outgoing: Any  # unit vector towards the receiver
    reach: Any  # length of the line in metres
    across: Any  # unit vector along which the first component of the receive polarisation vector lies, see `jones`


class Sheets:
    """Hold the faces that transmit, panes or the walls of shells, as an array on the GPU or CPU that traces the tubes."""

    def __init__(self, device: Device, faces: Any):
        """Copy the mask `faces` (F,) of these faces of a geometry to the device."""
        self.device = device
        self.faces = upload(mi.Bool, faces)

    def enter(self, tubes: Tubes, near: Contact, active: Any) -> Any:
        """Pass tubes straight through shell walls that they meet from outside. The function returns a mask of the tubes that pass."""
        inside, active = self.behind(tubes, near, active & near.outside)
        tubes.origin, tubes.length, tubes.across, tubes.encounters = inside.origin, inside.length, inside.across, inside.encounters
        return active

    def exit(self, far: Contact, outgoing: Any, length_out: Any, seen: Any, plane: bool) -> tuple[Contact, Any]:
        """Find the wall between each contact inside a shell and the receiver.

        Returns:
            The contact with this wall, and a mask of the tubes in `seen` whose line to the receiver passes no further surface.
        """
        origin = far.facet_point + far.flat_normal * self.device.lift
        hit = self.device.scene.ray_intersect_preliminary(mi.Ray3f(origin, outgoing), coherent=False, active=seen)
        seen = seen & hit.is_valid()
        wall = surface(self.device, hit.prim_index, hit.prim_uv.x, hit.prim_uv.y, origin, outgoing, seen)
        seen = seen & dr.gather(mi.Bool, self.faces, wall.face, seen) & ~wall.outside
        reach = mi.Float(dr.largest(mi.Float)) if plane else (1 - SHORT) * length_out - dr.dot(wall.facet_point - origin, outgoing)
        ray = limited(wall.facet_point - wall.flat_normal * self.device.lift, outgoing, reach)
        return wall, seen & ~self.device.scene.ray_test(ray, seen)

    def behind(self, tubes: Tubes, contact: Contact, active: Any) -> tuple[Tubes, Any]:
        """Return a copy of each tube that continues straight through its sheet, and a mask of the tubes that meet one. The tubes are at
        their contacts, before reflection.
        """
        active = active & dr.gather(mi.Bool, self.faces, contact.face, active)
        across, met = encounter(self.device, contact, tubes.direction, tubes.across, True, active)
        origin = contact.facet_point - contact.flat_normal * self.device.lift
        length = tubes.length + mi.Float64(dr.dot(origin - contact.point, tubes.direction))
        encounters = [*tubes.encounters, met]
        return replace(tubes, origin=origin, length=length, across=across, encounters=encounters), active

    def free(self, line: Line, plane: bool) -> Iterator[tuple[Any, list[Encounter]]]:
        """Follow lines to the receiver through panes.

        Yields:
            For each number of panes from 0, the indices of the lines that meet no surface after these panes, and the encounters of the
            receive polarisation vector with the panes. Lines through more than CROSSINGS panes, and blocked lines, are left out.
        """
        device, encounters = self.device, []
        index = dr.arange(mi.UInt32, dr.width(line.across))
        for crossed in range(CROSSINGS + 1):
            ray = limited(line.origin, line.outgoing, line.reach)
            if crossed == CROSSINGS:
                ahead = device.scene.ray_test(ray)
                going, onward = mi.Bool(False), encounters
            else:
                hit = device.scene.ray_intersect_preliminary(ray, coherent=False)
                ahead = hit.is_valid()
                pane = surface(device, hit.prim_index, hit.prim_uv.x, hit.prim_uv.y, line.origin, line.outgoing, ahead)
                going = ahead & dr.gather(mi.Bool, self.faces, pane.face, ahead)
                across, met = encounter(device, pane, line.outgoing, line.across, True, going)
                beyond = pane.facet_point - pane.flat_normal * device.lift
                reach = line.reach if plane else line.reach - dr.dot(beyond - line.origin, line.outgoing)
                line, onward = Line(beyond, line.outgoing, reach, across), [*encounters, met]
            dr.eval(ahead, going, *line, onward)
            clear = dr.compress(~ahead)
            if dr.width(clear):
                yield picked(index, clear), picked(encounters, clear)
            more = dr.compress(going)
            if not dr.width(more):
                return
            index, line, encounters = picked(index, more), Line(*picked(line, more)), picked(onward, more)
