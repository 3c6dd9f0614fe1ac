"""Pass ray tubes through sheets (panes) and through the walls of hollow objects (shells).

Import this module only after a Mitsuba variant is active.
"""

from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi

from radartwin.simulation.curved.contact import SHADOW_SHORT, Contact, across_incidence, limited, surface
from radartwin.simulation.curved.device import Device, upload
from radartwin.simulation.curved.flight import Tubes
from radartwin.simulation.curved.shell import Shells
from radartwin.simulation.reflection_table import ReflectionTable

CROSSINGS = 4  # largest number of panes that a path crosses before its last reflection, and also after it


class Walls:
    """Hold the walls of shells as arrays on the GPU or CPU that traces the tubes."""

    def __init__(self, device: Device, shells: Shells):
        """Copy the walls of the shells to the device.

        Args:
            device: geometry with the reflection table for waves inside its shells.
            shells: shells of this geometry.
        """
        self.device = device
        self.faces = upload(mi.Bool, shells.faces)
        self.coefficients = device.tabulated(shells.inside.through_te, shells.inside.through_tm)

    def enter(self, tubes: Tubes, near: Contact, active: Any) -> Any:
        """Pass tubes straight through shell walls that they meet from outside. The function returns a mask of the tubes that pass."""
        active = active & dr.gather(mi.Bool, self.faces, near.face, active) & near.outside
        for node in range(len(tubes.field_re)):
            re, im = tubes.field_re[node], tubes.field_im[node]
            tubes.field_re[node], tubes.field_im[node] = passed(self.device, self.coefficients, near, tubes.direction, re, im, node, active)
        tubes.origin = near.facet_point - near.flat_normal * self.device.lift
        tubes.length = tubes.length + mi.Float64(dr.dot(tubes.origin - near.point, tubes.direction))
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
        reach = mi.Float(dr.largest(mi.Float)) if plane else (1 - SHADOW_SHORT) * length_out - dr.dot(wall.facet_point - origin, outgoing)
        ray = limited(wall.facet_point - wall.flat_normal * self.device.lift, outgoing, reach)
        return wall, seen & ~self.device.scene.ray_test(ray, seen)

    def received(self, wall: Contact, outgoing: Any, axis: Any, active: Any) -> list[tuple[Any, Any]]:
        """Return the receive polarisation vector on the inner side of the wall, as (real part, imaginary part) at each frequency node.

        The function transmits the polarisation vector through the wall like a field, because transmission is reciprocal.
        """
        nothing = dr.zeros(mi.Vector3f)
        device, table = self.device, self.coefficients
        return [passed(device, table, wall, outgoing, axis, nothing, node, active) for node in range(device.nodes)]


class Panes:
    """Hold the faces of sheets that transmit, as arrays on the GPU or CPU that traces the tubes."""

    def __init__(self, device: Device, table: ReflectionTable, faces: Any):
        """Copy the mask `faces` (F,) of the panes of a geometry, and the transmission coefficients of its table, to the device."""
        self.device = device
        self.faces = upload(mi.Bool, faces)
        self.coefficients = device.tabulated(table.through_te, table.through_tm)

    def behind(self, tubes: Tubes, contact: Contact, sequence: Any, active: Any) -> tuple[Tubes, Any]:
        """Return copies of the tubes that go straight through the panes that they meet, and a mask of these copies.

        Args:
            tubes: tubes at their contacts, before reflection.
            sequence: packed labels of the tubes before this contact.
        """
        active = active & dr.gather(mi.Bool, self.faces, contact.face, active)
        fields = [
            passed(self.device, self.coefficients, contact, tubes.direction, re, im, node, active)
            for node, (re, im) in enumerate(zip(tubes.field_re, tubes.field_im, strict=True))
        ]
        origin = contact.facet_point - contact.flat_normal * self.device.lift
        length = tubes.length + mi.Float64(dr.dot(origin - contact.point, tubes.direction))
        re, im = ([field[part] for field in fields] for part in range(2))
        return replace(tubes, origin=origin, length=length, sequence=sequence, field_re=re, field_im=im), active

    def towards(
        self, contact: Contact, outgoing: Any, length_out: Any, axis: Any, seen: Any, plane: bool
    ) -> tuple[list[tuple[Any, Any]], Any]:
        """Return the receive polarisation vector behind the panes between each contact and the receiver, and a mask of the free lines.

        The vector is given as (real part, imaginary part) at each frequency node. The function transmits it like a field, because
        transmission is reciprocal.
        """
        device = self.device
        fields = [(mi.Vector3f(axis), dr.zeros(mi.Vector3f)) for _ in range(device.nodes)]
        origin = contact.facet_point + contact.flat_normal * device.lift
        reach = mi.Float(dr.largest(mi.Float)) if plane else mi.Float((1 - SHADOW_SHORT) * length_out)
        going = seen
        for _ in range(CROSSINGS):
            hit = device.scene.ray_intersect_preliminary(limited(origin, outgoing, reach), coherent=False, active=going)
            going = going & hit.is_valid()
            pane = surface(device, hit.prim_index, hit.prim_uv.x, hit.prim_uv.y, origin, outgoing, going)
            free = dr.gather(mi.Bool, self.faces, pane.face, going)
            seen = seen & (~going | free)
            going = going & free
            for node, (re, im) in enumerate(fields):
                through = passed(device, self.coefficients, pane, outgoing, re, im, node, going)
                fields[node] = dr.select(going, through[0], re), dr.select(going, through[1], im)
            beyond = pane.facet_point - pane.flat_normal * device.lift
            if not plane:
                reach = dr.select(going, reach - dr.dot(beyond - origin, outgoing), reach)
            origin = dr.select(going, beyond, origin)
        return fields, seen & ~device.scene.ray_test(limited(origin, outgoing, reach), going)


def passed(device: Device, coefficients: list[Any], wall: Contact, direction: Any, re: Any, im: Any, node: int, active: Any) -> tuple:
    """Multiply the TE and TM parts of a field (real part `re`, imaginary part `im`) by a wall's transmission coefficients.

    The field is perpendicular to the direction of propagation `direction`. The coefficients come from `Device.tabulated`.
    """
    s = across_incidence(direction, wall.normal)
    p = dr.cross(direction, s)
    te_re, te_im, tm_re, tm_im = device.lookup(coefficients, wall.face, dr.abs(wall.cosine), node, active)
    s_re, s_im, p_re, p_im = dr.dot(re, s), dr.dot(im, s), dr.dot(re, p), dr.dot(im, p)
    return (
        s * (te_re * s_re - te_im * s_im) + p * (tm_re * p_re - tm_im * p_im),
        s * (te_re * s_im + te_im * s_re) + p * (tm_re * p_im + tm_im * p_re),
    )
