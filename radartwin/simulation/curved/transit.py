"""Pass ray tubes through the walls of hollow objects (shells). Import this module only after a Mitsuba variant is active."""

from typing import Any

import drjit as dr
import mitsuba as mi

from radartwin.simulation.curved.contact import SHADOW_SHORT, Contact, across_incidence, limited, surface
from radartwin.simulation.curved.device import Device, upload
from radartwin.simulation.curved.flight import Tubes
from radartwin.simulation.curved.shell import Shells


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
            tubes.field_re[node], tubes.field_im[node] = self._passed(
                near, tubes.direction, tubes.field_re[node], tubes.field_im[node], node, active
            )
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
        return [self._passed(wall, outgoing, axis, nothing, node, active) for node in range(self.device.nodes)]

    def _passed(self, wall: Contact, direction: Any, re: Any, im: Any, node: int, active: Any) -> tuple[Any, Any]:
        """Multiply the TE and TM parts of a field (real part `re`, imaginary part `im`) by the wall's transmission coefficients.

        The field is perpendicular to the direction of propagation `direction`.
        """
        s = across_incidence(direction, wall.normal)
        p = dr.cross(direction, s)
        te_re, te_im, tm_re, tm_im = self.device.lookup(self.coefficients, wall.face, dr.abs(wall.cosine), node, active)
        s_re, s_im, p_re, p_im = dr.dot(re, s), dr.dot(im, s), dr.dot(re, p), dr.dot(im, p)
        return (
            s * (te_re * s_re - te_im * s_im) + p * (tm_re * p_re - tm_im * p_im),
            s * (te_re * s_im + te_im * s_re) + p * (tm_re * p_im + tm_im * p_re),
        )
