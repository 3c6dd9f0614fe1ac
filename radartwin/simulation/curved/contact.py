"""Where tubes meet surfaces: cast, meet, see the receiver, bounce.

Formulas and symbols as in `radartwin.simulation.curved.tubes`. Import only once a Mitsuba variant is active.
"""

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from radartwin.simulation.curved.device import Device, rows
from radartwin.simulation.curved.face_labels import LABEL_BITS
from radartwin.simulation.curved.flight import Tubes

COS_GRAZING = 1e-3  # below this a smooth surface returns nothing a tube could resolve
FLAT = 1e-10  # squared turn of the vertex normals over a facet below which it is flat
SHADOW_SHORT = 1e-4  # share of a way to the receiver, and metres at an occluder, by which visibility tests stop short


@dataclass
class Contact:
    """Where tubes meet a surface, on the lit side.

    Attributes:
        face: index; outside: whether the lit side is the one its corners turn to.
        flat_normal, normal: of the facet and of the curve through it; facet_point, point: on the facet, and lifted onto the curve.
        cosine: of incidence.
        edges, turns: two edge vectors of the facet and how much the vertex normal turns along them.
    """

    face: Any
    outside: Any
    flat_normal: Any
    normal: Any
    facet_point: Any
    point: Any
    cosine: Any
    edges: list[Any]
    turns: list[Any]

    def mirrored(self, direction: Any) -> Any:
        """The incident direction after reflection."""
        return direction + self.normal * (2 * self.cosine)

    def step(self, direction: Any, place: Any) -> Any:
        """Step on the surface from tube to tube, for one of the two places of tubes that come along `direction`."""
        return place + direction * (dr.dot(place, self.normal) * dr.rcp(self.cosine))

    def bends(self) -> Any:
        """Whether the facet is part of a curve."""
        return dr.squared_norm(self.turns[0]) + dr.squared_norm(self.turns[1]) > FLAT

    def turn(self, step: Any) -> Any:
        """Change of the normal along a tangent vector: the surface's curvature times the step."""
        first, second = self.edges
        g11, g12, g22 = dr.squared_norm(first), dr.dot(first, second), dr.squared_norm(second)
        c1, c2 = dr.dot(step, first), dr.dot(step, second)
        size = dr.rcp(dr.maximum(g11 * g22 - g12 * g12, 1e-30))
        return (self.turns[0] * (c1 * g22 - c2 * g12) + self.turns[1] * (c2 * g11 - c1 * g12)) * size


def across_incidence(direction: Any, normal: Any) -> Any:
    """Unit vector across the plane of incidence; any across the normal at normal incidence."""
    across = dr.cross(direction, normal)
    size = dr.squared_norm(across)
    return dr.select(size > 1e-10, across * dr.rsqrt(dr.maximum(size, 1e-12)), mi.coordinate_system(normal)[0])


def cast(device: Device, tubes: Tubes, first: bool, alive: Any = True) -> Any:
    """Find what tubes meet next; which of them meet anything."""
    hit = device.scene.ray_intersect_preliminary(mi.Ray3f(tubes.origin, tubes.direction), coherent=first, active=alive)
    tubes.face, tubes.inner_u, tubes.inner_v = hit.prim_index, hit.prim_uv.x, hit.prim_uv.y
    return hit.is_valid() & alive


def surface(device: Device, face: Any, inner_u: Any, inner_v: Any, origin: Any, direction: Any, active: Any) -> Contact:
    """The surface at barycentric coordinates of a face that rays from `origin` met."""
    corners = device.corners(device.corner, face, active)
    barycentric = [1 - inner_u - inner_v, inner_u, inner_v]
    flat = dr.normalize(dr.cross(corners[1] - corners[0], corners[2] - corners[0]))
    # From the corners, not along the ray: t carries the rounding of a far source, which would put the point below its own facet.
    facet_point = corners[0] * barycentric[0] + corners[1] * barycentric[1] + corners[2] * barycentric[2]
    facet_point = dr.select(active, facet_point, origin)  # a miss has no face, and what it gathered must not spread
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
    """The surface tubes were cast onto, and which of the lanes `active` do not just graze it. Adds the way there to their length and their
    place, and turns the field of those that pass a caustic by a quarter of a cycle each."""
    contact = surface(device, tubes.face, tubes.inner_u, tubes.inner_v, tubes.origin, tubes.direction, active)
    way = dr.dot(mi.Vector3d(contact.point) - mi.Vector3d(tubes.origin), mi.Vector3d(tubes.direction))
    if device.curved and not first:
        _pass_caustics(tubes, mi.Float(way))
    tubes.place_u, tubes.place_v = tubes.place_u + tubes.foot_u * mi.Float(way), tubes.place_v + tubes.foot_v * mi.Float(way)
    tubes.length = tubes.length + way
    if first:
        tubes.first = tubes.length
    if device.labels is not None:
        tubes.sequence = (tubes.sequence << LABEL_BITS) + dr.gather(mi.UInt64, device.labels, contact.face, active)
    return contact, active & (contact.cosine > COS_GRAZING)


def _pass_caustics(tubes: Tubes, way: Any) -> None:
    """Turn fields by +90 degrees (exp(+j w t)) for every zero of the tubes' cross-section on their way. It is a quadratic in the distance
    with real zeros, for the curvature of a wavefront is symmetric."""
    here, there, between = (
        dr.dot(dr.cross(u, v), tubes.direction)
        for u, v in (
            (tubes.place_u, tubes.place_v),
            (tubes.place_u + tubes.foot_u * way, tubes.place_v + tubes.foot_v * way),
            (tubes.foot_u, tubes.foot_v),
        )
    )
    between *= way * way
    slope = there - here - between
    turning = -0.5 * slope  # times 1/between, the share of the way where it is least
    both = (here * there > 0) & (here * between > 0) & (turning * between > 0) & (dr.abs(turning) < dr.abs(between))
    one = here * there < 0
    for node in range(len(tubes.field_re)):
        re, im = tubes.field_re[node], tubes.field_im[node]
        sign = dr.select(both, -1.0, 1.0)
        tubes.field_re[node], tubes.field_im[node] = dr.select(one, -im, re * sign), dr.select(one, re, im * sign)


def limited(origin: Any, direction: Any, reach: Any) -> Any:
    """A ray that ends at `reach`."""
    ray = mi.Ray3f(origin, direction)
    ray.maxt = reach
    return ray


def visible(device: Device, contact: Contact, outgoing: Any, length_out: Any, seen: Any, plane: bool) -> Any:
    """Of the lanes `seen`, those with a free way to the receiver."""
    reach = mi.Float(dr.largest(mi.Float)) if plane else (1 - SHADOW_SHORT) * length_out
    return seen & ~device.scene.ray_test(limited(contact.facet_point + contact.flat_normal * device.lift, outgoing, reach), seen)


def blocked(scene: Any, rotation: np.ndarray, translation: np.ndarray, pose: Any, first: Any, last: Any, active: Any) -> Any:
    """Whether the triangles of `scene` stand between two points that each pose's (F, 3, 3) rotation and (F, 3) translation carry there."""
    turn = [rows(rotation[:, i])(pose, active) for i in range(3)]
    offset = rows(translation)(pose, active)
    a, b = (mi.Vector3f(*(dr.dot(t, p) for t in turn)) + offset for p in (first, last))
    distance = dr.norm(b - a)
    return scene.ray_test(limited(a, (b - a) / dr.maximum(distance, 1e-9), distance - SHADOW_SHORT), active)


def leave(device: Device, tubes: Tubes, contact: Contact) -> Any:
    """Send tubes off along their mirrored directions; which of them do leave their facet."""
    tubes.direction = contact.mirrored(tubes.direction)
    tubes.origin = contact.facet_point + contact.flat_normal * device.lift
    return dr.dot(tubes.direction, contact.flat_normal) > 0


def bounce(device: Device, tubes: Tubes, contact: Contact, active: Any) -> Any:
    """Send tubes off after a mirror reflection and find what they meet next; which of them meet anything. Their fields are mirrored
    already. Nothing is evaluated yet."""
    mirrored = contact.mirrored(tubes.direction)
    # the path leaves from the lifted point, but is counted from the facet
    tubes.length = tubes.length - mi.Float64(dr.dot(contact.point - contact.facet_point, mirrored))
    steps = [contact.step(tubes.direction, place) for place in (tubes.place_u, tubes.place_v)]
    feet = [f - contact.normal * (2 * dr.dot(f, contact.normal)) for f in (tubes.foot_u, tubes.foot_v)]
    if device.curved:
        for i, step in enumerate(steps):
            turn = contact.turn(step)
            feet[i] = feet[i] + turn * (2 * contact.cosine) - contact.normal * (2 * dr.dot(tubes.direction, turn))
    tubes.place_u, tubes.place_v, tubes.foot_u, tubes.foot_v = *steps, *feet
    active = active & leave(device, tubes, contact)
    return cast(device, tubes, False, active)
