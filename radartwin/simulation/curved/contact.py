"""Compute where ray tubes meet surfaces: ray casting, surface normals and curvature, visibility and mirror reflection.

`radartwin.simulation.curved.tubes` explains the formulas and symbols. Import this module only after a Mitsuba variant is active.
"""

from dataclasses import dataclass, fields
from typing import Any

import drjit as dr
import mitsuba as mi

from radartwin.simulation.curved.device import Device
from radartwin.simulation.curved.flight import Tubes, picked
from radartwin.simulation.visibility import SHORT

COS_GRAZING = 1e-3  # tubes with a smaller cosine of incidence are ignored, because they cannot resolve the echo of a smooth surface
FLAT = 1e-10  # a facet counts as flat if the sum of the squared differences of its unit vertex normals is below this limit


@dataclass
class Contact:
    """Hold the points where ray tubes meet facets, with all normals on the side of the facet that the tube illuminates (the lit side)."""

    face: Any  # index of the facet that each tube meets
    outside: Any  # whether the lit side is the outer side of the mesh, on which the facet's corners run counter-clockwise
    flat_normal: Any  # unit normal of the flat facet
    normal: Any  # unit normal of the curved surface that the facet's vertex normals define
    facet_point: Any  # point where the tube meets the flat facet, in metres
    point: Any  # `facet_point` lifted onto the curved surface that the facet's vertex normals define, in metres
    cosine: Any  # cosine of the angle of incidence, relative to `normal`
    edges: list[Any]  # two edge vectors of the facet from its first corner, in metres
    normal_turns: list[Any]  # change of the unit vertex normal along each of the two edge vectors

    def picked(self, index: Any, curved: bool) -> "Contact":
        """Return the contacts at the lane indices `index`; `curved` is that of the geometry."""
        *values, turns = (getattr(self, field.name) for field in fields(self))
        return Contact(*picked(values, index), picked(turns, index) if curved else turns)  # pyright: ignore[reportCallIssue]

    def mirrored(self, direction: Any) -> Any:
        """Return the direction of a tube after mirror reflection at the surface."""
        return direction + self.normal * (2 * self.cosine)

    def step(self, direction: Any, derivative: Any) -> Any:
        """Return the vector on the surface from the centre of one tube to the centre of its neighbour in the grid.

        Args:
            direction: unit direction of the tube.
            derivative: change of the ray position from one tube to its neighbour, in metres.
        """
        return derivative + direction * (dr.dot(derivative, self.normal) * dr.rcp(self.cosine))

    def is_curved(self) -> Any:
        """Return whether the facet belongs to a curved surface, because its vertex normals differ."""
        return dr.squared_norm(self.normal_turns[0]) + dr.squared_norm(self.normal_turns[1]) > FLAT

    def turn(self, step: Any) -> Any:
        """Return the change of the unit normal along a tangent vector `step` of the surface, which is the curvature times `step`."""
        first, second = self.edges
        g11, g12, g22 = dr.squared_norm(first), dr.dot(first, second), dr.squared_norm(second)
        c1, c2 = dr.dot(step, first), dr.dot(step, second)
        size = dr.rcp(dr.maximum(g11 * g22 - g12 * g12, 1e-30))
        return (self.normal_turns[0] * (c1 * g22 - c2 * g12) + self.normal_turns[1] * (c2 * g11 - c1 * g12)) * size


def across_incidence(direction: Any, normal: Any) -> Any:
    """Return the unit vector perpendicular to the plane of incidence.

    At normal incidence the plane of incidence is undefined, and the function returns some unit vector perpendicular to the normal.
    """
    across = dr.cross(direction, normal)
    size = dr.squared_norm(across)
    return dr.select(size > 1e-10, across * dr.rsqrt(dr.maximum(size, 1e-12)), mi.coordinate_system(normal)[0])


# How the field of each tube meets a facet, as in `jones.Encounters`: (twice the number of the surface, plus 1 if the tube goes straight
# through; cosine of the angle of incidence; cosine and sine of the angle by which the components of the field turn to the plane of
# incidence). A plain tuple, because Dr.Jit takes a named tuple for a constant and would compute its arrays again at each read.
Encounter = tuple[Any, Any, Any, Any]


def encounter(device: Device, contact: Contact, direction: Any, across: Any, through: bool, active: Any) -> tuple[Any, Encounter]:
    """Return the unit vector perpendicular to the plane of incidence, and the encounter of each tube with its facet.

    Args:
        direction: unit direction of the tube. across: unit vector along which the field's first component lies.
        through: whether the tube goes straight through the facet; otherwise the facet reflects the tube.
    """
    s = across_incidence(direction, contact.normal)
    code = dr.gather(mi.UInt32, device.surface, contact.face, active) * 2 + int(through)
    return s, (code, dr.abs(contact.cosine), dr.dot(across, s), dr.dot(dr.cross(direction, across), s))


def note(device: Device, tubes: Tubes, contact: Contact, active: Any) -> None:
    """Add the reflection at the contact to the encounters of the tubes."""
    tubes.across, met = encounter(device, contact, tubes.direction, tubes.across, False, active)
    tubes.encounters = [*tubes.encounters, met]


def cast(device: Device, tubes: Tubes, first: bool, alive: Any = True) -> Any:
    """Find the facet that the centre ray of each tube meets next. The function returns a mask of the tubes that meet a facet."""
    hit = device.scene.ray_intersect_preliminary(mi.Ray3f(tubes.origin, tubes.direction), coherent=first, active=alive)
    tubes.face, tubes.inner_u, tubes.inner_v = hit.prim_index, hit.prim_uv.x, hit.prim_uv.y
    return hit.is_valid() & alive


def surface(device: Device, face: Any, inner_u: Any, inner_v: Any, origin: Any, direction: Any, active: Any) -> Contact:
    """Compute the `Contact` of rays from `origin` along `direction` with a facet, at the barycentric coordinates `inner_u`, `inner_v`."""
    corners = device.corners(device.corner, face, active)
    barycentric = [1 - inner_u - inner_v, inner_u, inner_v]
    flat = dr.normalize(dr.cross(corners[1] - corners[0], corners[2] - corners[0]))
    # The point is computed from the corners, because the distance along a ray from a far source has a rounding error that could put the
    # point below the facet.
    facet_point = corners[0] * barycentric[0] + corners[1] * barycentric[1] + corners[2] * barycentric[2]
    facet_point = dr.select(active, facet_point, origin)  # for a ray that meets no facet, the corners are arbitrary values
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
    """Move each tube to the facet that `cast` found.

    The function increases the tube's length by the distance to the facet, updates the position derivatives, and counts the caustics on the
    way.

    Returns:
        The `Contact`, and a mask of the active tubes that do not meet the facet at grazing incidence.
    """
    contact = surface(device, tubes.face, tubes.inner_u, tubes.inner_v, tubes.origin, tubes.direction, active)
    distance = dr.dot(mi.Vector3d(contact.point) - mi.Vector3d(tubes.origin), mi.Vector3d(tubes.direction))
    if device.curved and not first:
        count_caustics(tubes, mi.Float(distance))
    tubes.position_du = tubes.position_du + tubes.direction_du * mi.Float(distance)
    tubes.position_dv = tubes.position_dv + tubes.direction_dv * mi.Float(distance)
    tubes.length = tubes.length + distance
    if first:
        tubes.first = tubes.length
    return contact, active & (contact.cosine > COS_GRAZING)


def count_caustics(tubes: Tubes, distance: Any) -> None:
    """Count the caustics within `distance`.

    A caustic is a zero of the tube's cross-section. The cross-section is a quadratic function of the distance along the tube. Both zeros of
    this function are real, because the curvature matrix of a wavefront is symmetric.

    At an edge of two faces, `distance` can be some nanometres. The terms of the function then differ by many powers of ten, so that a
    difference of cross-sections loses the linear term. A product of two terms can be subnormal. Dr.Jit's worker threads replace subnormal
    numbers by zero, and the main thread does not. The function therefore computes each term on its own, and compares signs.
    """
    u, v, du, dv = tubes.position_du, tubes.position_dv, tubes.direction_du * distance, tubes.direction_dv * distance
    here, slope, between = (dr.dot(area, tubes.direction) for area in (dr.cross(u, v), dr.cross(u, dv) + dr.cross(du, v), dr.cross(du, dv)))
    there = here + slope + between
    turning = -0.5 * slope  # turning/between is the fraction of `distance` at which the quadratic cross-section has its extremum
    both = _alike(here, there) & _alike(here, between) & _alike(turning, between) & (dr.abs(turning) < dr.abs(between))
    single = _alike(here, -there)
    tubes.caustics = tubes.caustics + dr.select(single, mi.UInt32(1), dr.select(both, mi.UInt32(2), 0))


def _alike(a: Any, b: Any) -> Any:
    """Return whether two numbers have the same sign. Zero has no sign."""
    return ((a > 0) & (b > 0)) | ((a < 0) & (b < 0))


def limited(origin: Any, direction: Any, reach: Any) -> Any:
    """Return a ray from `origin` along `direction` that ends after `reach` metres."""
    ray = mi.Ray3f(origin, direction)
    ray.maxt = reach
    return ray


def visible(device: Device, contact: Contact, outgoing: Any, length_out: Any, seen: Any, plane: bool) -> Any:
    """Return a mask of those tubes in `seen` for which no facet blocks the line from the contact to the receiver."""
    reach = mi.Float(dr.largest(mi.Float)) if plane else (1 - SHORT) * length_out
    return seen & ~device.scene.ray_test(limited(contact.facet_point + contact.flat_normal * device.lift, outgoing, reach), seen)


def leave(device: Device, tubes: Tubes, contact: Contact) -> Any:
    """Start tubes from their contact along the mirrored direction. The function returns a mask of the tubes that leave their facet."""
    tubes.direction = contact.mirrored(tubes.direction)
    tubes.origin = contact.facet_point + contact.flat_normal * device.lift
    return dr.dot(tubes.direction, contact.flat_normal) > 0


def bounce(device: Device, tubes: Tubes, contact: Contact, active: Any) -> Any:
    """Reflect the geometry of tubes, whose encounters are already noted, and find the next facet of each tube.

    Returns:
        A mask of the tubes that meet another facet.
    """
    mirrored = contact.mirrored(tubes.direction)
    # The ray starts at the flat facet, but the tube's length is counted from the point that was lifted onto the curved surface.
    tubes.length = tubes.length - mi.Float64(dr.dot(contact.point - contact.facet_point, mirrored))
    steps = [contact.step(tubes.direction, derivative) for derivative in (tubes.position_du, tubes.position_dv)]
    spreads = [d - contact.normal * (2 * dr.dot(d, contact.normal)) for d in (tubes.direction_du, tubes.direction_dv)]
    if device.curved:
        for i, step in enumerate(steps):
            bend = contact.turn(step)
            spreads[i] = spreads[i] + bend * (2 * contact.cosine) - contact.normal * (2 * dr.dot(tubes.direction, bend))
    tubes.position_du, tubes.position_dv, tubes.direction_du, tubes.direction_dv = *steps, *spreads
    active = active & leave(device, tubes, contact)
    return cast(device, tubes, False, active)
