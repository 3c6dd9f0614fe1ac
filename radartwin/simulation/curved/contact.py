"""Contact of tubes with surfaces: ray casting, surface geometry, visibility and mirror reflection.

Formulas and symbols as in `radartwin.simulation.curved.tubes`. Import only after a Mitsuba variant is active.
"""

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from radartwin.simulation.curved.device import Device, rows
from radartwin.simulation.curved.flight import Tubes
from radartwin.simulation.curved.hits import LABEL_BITS, Occluder

COS_GRAZING = 1e-3  # at smaller cosines of incidence, a tube cannot resolve the return of a smooth surface
FLAT = 1e-10  # a facet is flat if the squared difference of its vertex normals is smaller
SHADOW_SHORT = 1e-4  # visibility tests end this fraction of the distance before the target (for an occluder, this many metres)


@dataclass
class Contact:
    """Hold the points where tubes meet a surface, seen from the lit side."""

    face: Any  # index
    outside: Any  # whether the lit side is the outer side, on which the corners run counter-clockwise
    flat_normal: Any  # of the facet
    normal: Any  # of the curved surface that the facet's vertex normals define
    facet_point: Any  # on the facet
    point: Any  # lifted onto the curved surface
    cosine: Any  # of incidence
    edges: list[Any]  # two edge vectors of the facet
    normal_turns: list[Any]  # change of the vertex normal along each edge

    def mirrored(self, direction: Any) -> Any:
        """Return the direction after mirror reflection."""
        return direction + self.normal * (2 * self.cosine)

    def step(self, direction: Any, derivative: Any) -> Any:
        """Return the step on the surface from tube to tube, for tubes along `direction` with this `derivative` of position."""
        return derivative + direction * (dr.dot(derivative, self.normal) * dr.rcp(self.cosine))

    def is_curved(self) -> Any:
        """Return whether the facet is part of a curved surface."""
        return dr.squared_norm(self.normal_turns[0]) + dr.squared_norm(self.normal_turns[1]) > FLAT

    def turn(self, step: Any) -> Any:
        """Return the change of the normal along a tangent vector `step`, which is the curvature times the step."""
        first, second = self.edges
        g11, g12, g22 = dr.squared_norm(first), dr.dot(first, second), dr.squared_norm(second)
        c1, c2 = dr.dot(step, first), dr.dot(step, second)
        size = dr.rcp(dr.maximum(g11 * g22 - g12 * g12, 1e-30))
        return (self.normal_turns[0] * (c1 * g22 - c2 * g12) + self.normal_turns[1] * (c2 * g11 - c1 * g12)) * size


def across_incidence(direction: Any, normal: Any) -> Any:
    """Return the unit vector perpendicular to the plane of incidence; at normal incidence, any unit vector across the normal."""
    across = dr.cross(direction, normal)
    size = dr.squared_norm(across)
    return dr.select(size > 1e-10, across * dr.rsqrt(dr.maximum(size, 1e-12)), mi.coordinate_system(normal)[0])


def cast(device: Device, tubes: Tubes, first: bool, alive: Any = True) -> Any:
    """Find the next face of each tube. Returns the lanes that meet a face."""
    hit = device.scene.ray_intersect_preliminary(mi.Ray3f(tubes.origin, tubes.direction), coherent=first, active=alive)
    tubes.face, tubes.inner_u, tubes.inner_v = hit.prim_index, hit.prim_uv.x, hit.prim_uv.y
    return hit.is_valid() & alive


def surface(device: Device, face: Any, inner_u: Any, inner_v: Any, origin: Any, direction: Any, active: Any) -> Contact:
    """Compute the contact at barycentric coordinates of the face that rays from `origin` meet."""
    corners = device.corners(device.corner, face, active)
    barycentric = [1 - inner_u - inner_v, inner_u, inner_v]
    flat = dr.normalize(dr.cross(corners[1] - corners[0], corners[2] - corners[0]))
    # computed from the corners: the ray's distance has the rounding error of a far source and could put the point below the facet
    facet_point = corners[0] * barycentric[0] + corners[1] * barycentric[1] + corners[2] * barycentric[2]
    facet_point = dr.select(active, facet_point, origin)  # a ray without a hit gathers arbitrary values, which must not be used
    outside = dr.dot(direction, flat) <= 0
    side = dr.select(outside, 1.0, -1.0)
    edges = [corners[1] - corners[0], corners[2] - corners[0]]
    point, normal, turns = facet_point, flat, [dr.zeros(mi.Vector3f), dr.zeros(mi.Vector3f)]
    if device.curved:
        normals = device.corners(device.normal, face, active)
        smooth = normals[0] * barycentric[0] + normals[1] * barycentric[1] + normals[2] * barycentric[2]
        normal = smooth * dr.rsqrt(dr.maximum(dr.squared_norm(smooth), 1e-12))
        sag = mi.Float(0.0)
        for i, j in ((0, 1), (0, 2), (1, 2)):
            sag += barycentric[i] * barycentric[j] * dr.dot(normals[i] - normals[j], corners[j] - corners[i])
        point = facet_point - normal * dr.select(active, 0.5 * sag, 0.0)
        turns = [(normals[1] - normals[0]) * side, (normals[2] - normals[0]) * side]
    return Contact(face, outside, flat * side, normal * side, facet_point, point, -dr.dot(direction, normal) * side, edges, turns)


def meet(device: Device, tubes: Tubes, first: bool, active: Any) -> tuple[Contact, Any]:
    """Move tubes to the face found by `cast`. Returns the contact and the active lanes that do not graze it.

    The length grows by the distance, and the position derivatives grow with it. The field's phase turns by 90 degrees at each caustic.
    """
    contact = surface(device, tubes.face, tubes.inner_u, tubes.inner_v, tubes.origin, tubes.direction, active)
    distance = dr.dot(mi.Vector3d(contact.point) - mi.Vector3d(tubes.origin), mi.Vector3d(tubes.direction))
    if device.curved and not first:
        pass_caustics(tubes, mi.Float(distance))
    tubes.position_du, tubes.position_dv = (
        tubes.position_du + tubes.direction_du * mi.Float(distance),
        tubes.position_dv + tubes.direction_dv * mi.Float(distance),
    )
    tubes.length = tubes.length + distance
    if first:
        tubes.first = tubes.length
    if device.labels is not None:
        tubes.sequence = (tubes.sequence << LABEL_BITS) + dr.gather(mi.UInt64, device.labels, contact.face, active)
    return contact, active & (contact.cosine > COS_GRAZING)


def pass_caustics(tubes: Tubes, distance: Any) -> None:
    """Turn the phase of fields by +90 degrees (for exp(+j w t)) at each zero of the tubes' cross-section within the distance.

    The cross-section is a quadratic in the distance with real zeros, because the curvature of a wavefront is symmetric.
    """
    here, there, between = (
        dr.dot(dr.cross(u, v), tubes.direction)
        for u, v in (
            (tubes.position_du, tubes.position_dv),
            (tubes.position_du + tubes.direction_du * distance, tubes.position_dv + tubes.direction_dv * distance),
            (tubes.direction_du, tubes.direction_dv),
        )
    )
    between *= distance * distance
    slope = there - here - between
    turning = -0.5 * slope  # divided by `between`: the fraction of the distance where the cross-section is smallest
    both = (here * there > 0) & (here * between > 0) & (turning * between > 0) & (dr.abs(turning) < dr.abs(between))
    one = here * there < 0
    for node in range(len(tubes.field_re)):
        re, im = tubes.field_re[node], tubes.field_im[node]
        sign = dr.select(both, -1.0, 1.0)
        tubes.field_re[node], tubes.field_im[node] = dr.select(one, -im, re * sign), dr.select(one, re, im * sign)


def limited(origin: Any, direction: Any, reach: Any) -> Any:
    """Return a ray that ends at the distance `reach`."""
    ray = mi.Ray3f(origin, direction)
    ray.maxt = reach
    return ray


def visible(device: Device, contact: Contact, outgoing: Any, length_out: Any, seen: Any, plane: bool) -> Any:
    """Return the lanes of `seen` whose line to the receiver is not blocked."""
    reach = mi.Float(dr.largest(mi.Float)) if plane else (1 - SHADOW_SHORT) * length_out
    return seen & ~device.scene.ray_test(limited(contact.facet_point + contact.flat_normal * device.lift, outgoing, reach), seen)


def blocked(occluder: Occluder, pose: Any, first: Any, last: Any, active: Any) -> Any:
    """Return whether the occluder blocks the line between two points in the object's frame."""
    turn = [rows(occluder.rotation[:, i])(pose, active) for i in range(3)]
    offset = rows(occluder.translation)(pose, active)
    a, b = (mi.Vector3f(*(dr.dot(t, p) for t in turn)) + offset for p in (first, last))
    distance = dr.norm(b - a)
    return occluder.geometry.scene().ray_test(limited(a, (b - a) / dr.maximum(distance, 1e-9), distance - SHADOW_SHORT), active)


def leave(device: Device, tubes: Tubes, contact: Contact) -> Any:
    """Start tubes along their mirrored directions. Returns the lanes that leave their facet."""
    tubes.direction = contact.mirrored(tubes.direction)
    tubes.origin = contact.facet_point + contact.flat_normal * device.lift
    return dr.dot(tubes.direction, contact.flat_normal) > 0


def bounce(device: Device, tubes: Tubes, contact: Contact, active: Any) -> Any:
    """Reflect tubes (`scatter` has already reflected their fields) and cast them. Returns the lanes that meet a face."""
    mirrored = contact.mirrored(tubes.direction)
    # the ray starts at the facet, but the length is counted from the lifted point
    tubes.length = tubes.length - mi.Float64(dr.dot(contact.point - contact.facet_point, mirrored))
    steps = [contact.step(tubes.direction, derivative) for derivative in (tubes.position_du, tubes.position_dv)]
    spreads = [d - contact.normal * (2 * dr.dot(d, contact.normal)) for d in (tubes.direction_du, tubes.direction_dv)]
    if device.curved:
        for i, step in enumerate(steps):
            turn = contact.turn(step)
            spreads[i] = spreads[i] + turn * (2 * contact.cosine) - contact.normal * (2 * dr.dot(tubes.direction, turn))
    tubes.position_du, tubes.position_dv, tubes.direction_du, tubes.direction_dv = *steps, *spreads
    active = active & leave(device, tubes, contact)
    return cast(device, tubes, False, active)
