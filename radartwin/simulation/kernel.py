"""The device side of the tube tracer: launch, meet a surface, scatter to the receiver, bounce.

Formulas and symbols are those of `radartwin.simulation.tubes`; arrays here are Dr.Jit's, one lane per tube. Import only once a Mitsuba
variant is active. Numbers that change from call to call are made opaque, for a literal in a kernel means compiling it again.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from radartwin.simulation.geometry import Geometry
from radartwin.simulation.launch import Launch
from radartwin.simulation.reflection_table import COSINES, ReflectionTable

COS_GRAZING = 1e-3  # below this a smooth surface returns nothing a tube could resolve
STEEP = 14.0  # phase across half a tube, radians, from which its integral is taken from its kinks
FLAT = 1e-10  # squared turn of the vertex normals over a facet below which it is flat
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
LABEL_BITS = 12  # per bounce in a tube's sequence of faces: five bounces in 64 bits
SHADOW_SHORT = 1e-4  # share of a way to the receiver, and metres at an occluder, by which visibility tests stop short


def rows(values: np.ndarray) -> Callable[..., Any]:
    """(F, 3) on the device, as a function that gathers vectors by index."""
    columns = [mi.Float(np.ascontiguousarray(values[:, i], np.float32)) for i in range(3)]
    return lambda index, active=True: mi.Vector3f(*(dr.gather(mi.Float, column, index, active) for column in columns))


def scalars(values: np.ndarray) -> Callable[[Any], Any]:
    """(F,) on the device, as a function that gathers by index."""
    column = mi.Float(values.astype(np.float32))
    return lambda index: dr.gather(mi.Float, column, index)


class Device:
    """A geometry and its reflection on the device, with the gathers the kernels make."""

    def __init__(self, geometry: Geometry, table: ReflectionTable, cluster: np.ndarray | None, labels: np.ndarray | None, hats: bool):
        self.scene = geometry.scene()
        self.hats = dr.opaque(mi.Bool, hats)
        self.corner = mi.Float(geometry.corners.astype(np.float32).ravel())
        self.normal = mi.Float(geometry.normals.astype(np.float32).ravel())
        self.surface = mi.UInt32(geometry.surface.astype(np.uint32))
        self.cluster = None if cluster is None else mi.UInt32(cluster.astype(np.uint32))
        self.labels = None if labels is None else mi.UInt64(labels.astype(np.uint64) + 1)
        self.nodes = len(table.frequencies_hz)
        self.coefficients = [mi.Float(part.astype(np.float32).ravel()) for c in (table.te, table.tm) for part in (np.real(c), np.imag(c))]
        # rays leave a surface this far above it: well over the float32 resolution of its coordinates
        self.lift = dr.opaque(mi.Float, max(2e-6 * geometry.extent_m, 1e-7))

    @staticmethod
    def corners(source: Any, face: Any, active: Any) -> list[Any]:
        """The three corner vectors of a face from one of the per-corner arrays."""
        return [mi.Vector3f(*(dr.gather(mi.Float, source, face * 9 + 3 * c + i, active) for i in range(3))) for c in range(3)]

    def reflection(self, face: Any, cosine: Any, node: int, active: Any) -> list[Any]:
        """[te.re, te.im, tm.re, tm.im] at one frequency node, linear in the cosine."""
        x = dr.clip(cosine, 0, 1) * (COSINES - 1)
        low = dr.minimum(mi.UInt32(x), COSINES - 2)
        weight = x - mi.Float(low)
        index = (dr.gather(mi.UInt32, self.surface, face, active) * COSINES + low) * self.nodes + node
        return [
            dr.lerp(dr.gather(mi.Float, c, index, active), dr.gather(mi.Float, c, index + self.nodes, active), weight)
            for c in self.coefficients
        ]


@dataclass
class Tubes:
    """Tubes on their way, before the next hit.

    Attributes:
        index, pose: launch index and pose. origin, direction: of the ray.
        foot_u, foot_v, weight: footprint vectors and solid angle or area.
        departure: direction at the source. field_re, field_im: polarisation per frequency node. length: unfolded, float64.
        first: length to the first hit. sequence: 1 + label of each face met, the last in the lowest LABEL_BITS bits.
    """

    index: Any
    pose: Any
    origin: Any
    direction: Any
    foot_u: Any
    foot_v: Any
    weight: Any
    departure: Any
    field_re: list[Any]
    field_im: list[Any]
    length: Any
    first: Any
    sequence: Any

    def evaluate(self) -> None:
        dr.eval(*self._values())

    def compacted(self, alive: Any) -> "Tubes":
        """The tubes at these lane indices."""

        def pick(value: Any) -> Any:
            return [pick(v) for v in value] if isinstance(value, list) else dr.gather(type(value), value, alive)

        return Tubes(*(pick(value) for value in self._values()))

    def _values(self) -> Iterator[Any]:
        return (getattr(self, field.name) for field in fields(self))


@dataclass
class Contact:
    """Where tubes meet a surface, on the lit side.

    Attributes:
        face: index; flat_normal, normal: of the facet and of the curve through it; facet_point, point: on the facet, and lifted onto the
        curve; cosine: of incidence. edges, turns: two edge vectors of the facet and how much the vertex normal turns along them.
    """

    face: Any
    flat_normal: Any
    normal: Any
    facet_point: Any
    point: Any
    cosine: Any
    edges: list[Any]
    turns: list[Any]

    def turn(self, step: Any) -> Any:
        """Change of the normal along a tangent vector: the surface's curvature times the step."""
        first, second = self.edges
        g11, g12, g22 = dr.squared_norm(first), dr.dot(first, second), dr.squared_norm(second)
        c1, c2 = dr.dot(step, first), dr.dot(step, second)
        size = dr.rcp(dr.maximum(g11 * g22 - g12 * g12, 1e-30))
        return (self.turns[0] * (c1 * g22 - c2 * g12) + self.turns[1] * (c2 * g11 - c1 * g12)) * size


def project(axis: Any, direction: Any) -> Any:
    """Normalised part of `axis` across `direction`."""
    across = axis - direction * dr.dot(axis, direction)
    return across * dr.rsqrt(dr.maximum(dr.squared_norm(across), 1e-12))


def footprint_integral(alpha: Any, beta: Any, hat: Any) -> tuple[Any, Any]:
    """Integral of w(x) exp(-j (alpha x + beta x^2)), real and imaginary part, with w a hat on [-1, 1] or a box on [-1/2, 1/2].

    Gauss-Legendre while the phase turns by less than about two cycles a side (error 1e-7), beyond it the leading asymptotic terms of the
    hat's three kinks (error below 2e-3), or the box without its curvature.
    """
    half, slope = dr.select(hat, mi.Float(1.0), 0.5), dr.select(hat, mi.Float(1.0), 0.0)
    re, im = mi.Float(0.0), mi.Float(0.0)
    for node, weight in zip((_NODES + 1) / 2, _WEIGHTS / 2, strict=True):
        x = half * float(node)
        part = half * float(2 * weight) * (1 - slope * float(node)) * dr.cos(alpha * x)
        sine, cosine = dr.sincos(beta * x * x)
        re += part * cosine
        im -= part * sine
    up, down = dr.rcp(dr.square(alpha + 2 * beta)), dr.rcp(dr.square(alpha - 2 * beta))
    (sine_up, cosine_up), (sine_down, cosine_down) = dr.sincos(beta + alpha), dr.sincos(beta - alpha)
    steep = (dr.abs(alpha) * half > STEEP) & (dr.abs(alpha) > 4 * dr.abs(beta))
    box = 2 * dr.sin(0.5 * alpha) * dr.rcp(alpha)
    far_re = dr.select(hat, 2 * dr.rcp(dr.square(alpha)) - cosine_up * up - cosine_down * down, box)
    far_im = dr.select(hat, sine_up * up + sine_down * down, 0.0)
    return dr.select(steep, far_re, re), dr.select(steep, far_im, im)


def start(launch: Launch, axis: np.ndarray, cross: bool, block: np.ndarray, nodes: int) -> Tubes:
    """Tubes of a launch by index; fields along the projected antenna axis, turned for H."""
    index = mi.UInt32(block)
    pose = index // dr.opaque(mi.UInt32, launch.per_pose)
    cell = index - pose * dr.opaque(mi.UInt32, launch.per_pose)
    cell_v = cell // dr.opaque(mi.UInt32, launch.count_u)
    cell_u = cell - cell_v * dr.opaque(mi.UInt32, launch.count_u)
    step_u, step_v = scalars(launch.step_u)(pose), scalars(launch.step_v)(pose)
    u = scalars(launch.low_u)(pose) + mi.Float(cell_u) * step_u
    v = scalars(launch.low_v)(pose) + mi.Float(cell_v) * step_v
    origin, forward, u_axis, v_axis = (rows(x)(pose) for x in (launch.source, launch.forward, launch.u_axis, launch.v_axis))
    if launch.plane:
        origin += u_axis * u + v_axis * v
        direction, foot_u, foot_v, weight = forward, u_axis * step_u, v_axis * step_v, step_u * step_v
    else:
        scale = dr.rsqrt(1 + u * u + v * v)
        direction = (forward + u_axis * u + v_axis * v) * scale
        foot_u = (u_axis - direction * dr.dot(direction, u_axis)) * scale * step_u
        foot_v = (v_axis - direction * dr.dot(direction, v_axis)) * scale * step_v
        weight = step_u * step_v * scale * scale * scale
    field = project(rows(axis)(pose), direction)
    if cross:  # H = (direction to the radar) x V, and the radar lies against the ray
        field = dr.cross(-direction, field)
    nothing = dr.zeros(mi.Vector3f, dr.width(index))
    return Tubes(
        index, pose, origin, direction, foot_u, foot_v, weight, mi.Vector3f(direction),
        [mi.Vector3f(field) for _ in range(nodes)], [mi.Vector3f(nothing) for _ in range(nodes)], dr.zeros(mi.Float64, dr.width(index)),
        dr.zeros(mi.Float64, dr.width(index)), dr.zeros(mi.UInt64, dr.width(index)),
    )  # fmt: skip


def meet(device: Device, tubes: Tubes, first: bool) -> tuple[Contact, Any]:
    """Next surface of every tube, and which tubes have one. Adds the way there to their length."""
    hit = device.scene.ray_intersect_preliminary(mi.Ray3f(tubes.origin, tubes.direction), coherent=first)
    active = hit.is_valid()
    face = hit.prim_index
    corners = device.corners(device.corner, face, active)
    normals = device.corners(device.normal, face, active)
    barycentric = [1 - hit.prim_uv.x - hit.prim_uv.y, hit.prim_uv.x, hit.prim_uv.y]
    flat = dr.normalize(dr.cross(corners[1] - corners[0], corners[2] - corners[0]))
    smooth = normals[0] * barycentric[0] + normals[1] * barycentric[1] + normals[2] * barycentric[2]
    normal = smooth * dr.rsqrt(dr.maximum(dr.squared_norm(smooth), 1e-12))
    sag = mi.Float(0.0)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        sag += barycentric[i] * barycentric[j] * dr.dot(normals[i] - normals[j], corners[j] - corners[i])
    # From the corners, not along the ray: t carries the rounding of a far source, which would put the point below its own facet.
    facet_point = corners[0] * barycentric[0] + corners[1] * barycentric[1] + corners[2] * barycentric[2]
    facet_point = dr.select(active, facet_point, tubes.origin)  # a miss has no face, and what it gathered must not spread
    point = facet_point - normal * (0.5 * sag)
    side = dr.select(dr.dot(tubes.direction, flat) > 0, -1.0, 1.0)
    edges = [corners[1] - corners[0], corners[2] - corners[0]]
    turns = [(normals[1] - normals[0]) * side, (normals[2] - normals[0]) * side]
    contact = Contact(face, flat * side, normal * side, facet_point, point, -dr.dot(tubes.direction, normal) * side, edges, turns)
    tubes.length = tubes.length + dr.dot(mi.Vector3d(point) - mi.Vector3d(tubes.origin), mi.Vector3d(tubes.direction))
    if first:
        tubes.first = tubes.length
    if device.labels is not None:
        tubes.sequence = (tubes.sequence << LABEL_BITS) + dr.gather(mi.UInt64, device.labels, face, active)
    return contact, active & (contact.cosine > COS_GRAZING)


def _ray(origin: Any, direction: Any, reach: Any) -> Any:
    """A ray that ends at `reach`."""
    ray = mi.Ray3f(origin, direction)
    ray.maxt = reach
    return ray


def visible(device: Device, contact: Contact, outgoing: Any, length_out: Any, seen: Any, plane: bool) -> Any:
    """Of the lanes `seen`, those with a free way to the receiver."""
    reach = mi.Float(dr.largest(mi.Float)) if plane else (1 - SHADOW_SHORT) * length_out
    return seen & ~device.scene.ray_test(_ray(contact.facet_point + contact.flat_normal * device.lift, outgoing, reach), seen)


def blocked(scene: Any, rotation: np.ndarray, translation: np.ndarray, pose: Any, first: Any, last: Any, active: Any) -> Any:
    """Whether the triangles of `scene` stand between two points that each pose's (F, 3, 3) rotation and (F, 3) translation carry there."""
    turn = [rows(rotation[:, i])(pose, active) for i in range(3)]
    offset = rows(translation)(pose, active)
    a, b = (mi.Vector3f(*(dr.dot(t, p) for t in turn)) + offset for p in (first, last))
    distance = dr.norm(b - a)
    return scene.ray_test(_ray(a, (b - a) / dr.maximum(distance, 1e-9), distance - SHADOW_SHORT), active)


def scatter(
    device: Device,
    tubes: Tubes,
    contact: Contact,
    outgoing: Any,
    length_out: Any,
    receive_axis: Any,
    wavenumber: Any,
    active: Any,
    plane: bool,
) -> list[tuple[Any, Any]]:
    """Contribution of every tube to the receiver per node, (real, imaginary) of P.V times its integral; mirrors the tubes' fields."""
    across = dr.cross(tubes.direction, contact.normal)
    size = dr.squared_norm(across)
    # s across the plane of incidence (any direction at normal incidence), p along the field in it, before and after
    s = dr.select(size > 1e-10, across * dr.rsqrt(dr.maximum(size, 1e-12)), mi.coordinate_system(contact.normal)[0])
    mirrored = tubes.direction + contact.normal * (2 * contact.cosine)
    p_in, p_out = dr.cross(tubes.direction, s), dr.cross(mirrored, s)
    footprint = mi.Float(1.0) if plane else mi.Float(tubes.length)
    inverse_in, inverse_out = (mi.Float(0.0), mi.Float(0.0)) if plane else (dr.rcp(footprint), dr.rcp(length_out))
    total_re, total_im = tubes.weight * footprint * dr.rcp(8 * np.pi * contact.cosine) * (1.0 if plane else inverse_out), mi.Float(0.0)
    change = tubes.direction - outgoing  # gradient of the path length at the hit
    hat = device.hats | (dr.squared_norm(contact.turns[0]) + dr.squared_norm(contact.turns[1]) > FLAT)
    for foot in (tubes.foot_u, tubes.foot_v):
        step = (foot + tubes.direction * (dr.dot(foot, contact.normal) * dr.rcp(contact.cosine))) * footprint
        slope = dr.dot(change, step)
        square = dr.squared_norm(step)
        bend = (square - dr.square(dr.dot(step, tubes.direction))) * inverse_in + (square - dr.square(dr.dot(step, outgoing))) * inverse_out
        bend -= dr.dot(change, contact.normal) * dr.dot(contact.turn(step), step)
        re, im = footprint_integral(wavenumber * slope, 0.5 * wavenumber * bend, hat)
        total_re, total_im = total_re * re - total_im * im, total_re * im + total_im * re
    total_re, total_im = dr.select(active, total_re, 0.0), dr.select(active, total_im, 0.0)
    out = []
    for node in range(device.nodes):
        e_re, e_im = tubes.field_re[node], tubes.field_im[node]
        te_re, te_im, tm_re, tm_im = device.reflection(contact.face, contact.cosine, node, active)
        s_re, s_im, p_re, p_im = dr.dot(e_re, s), dr.dot(e_im, s), dr.dot(e_re, p_in), dr.dot(e_im, p_in)
        r_re = s * (te_re * s_re - te_im * s_im) + p_out * (tm_re * p_re - tm_im * p_im)
        r_im = s * (te_re * s_im + te_im * s_re) + p_out * (tm_re * p_im + tm_im * p_re)
        parts = []
        for incident, reflected in ((e_re, r_re), (e_im, r_im)):
            electric = dr.cross(contact.normal, dr.cross(tubes.direction, incident) + dr.cross(mirrored, reflected))
            magnetic = dr.cross(dr.cross(incident + reflected, contact.normal), outgoing)
            parts.append(dr.dot(receive_axis, electric + magnetic))
        out.append((parts[0] * total_re - parts[1] * total_im, parts[0] * total_im + parts[1] * total_re))
        tubes.field_re[node], tubes.field_im[node] = r_re, r_im
    return out


def bounce(device: Device, tubes: Tubes, contact: Contact, active: Any) -> Tubes:
    """The tubes after a mirror reflection, without those that end here. Their fields are mirrored already."""
    mirrored = tubes.direction + contact.normal * (2 * contact.cosine)
    # the path leaves from the lifted point, but is counted from the facet
    tubes.length = tubes.length - mi.Float64(dr.dot(contact.point - contact.facet_point, mirrored))
    tubes.foot_u, tubes.foot_v = (f - contact.normal * (2 * dr.dot(f, contact.normal)) for f in (tubes.foot_u, tubes.foot_v))
    tubes.origin = contact.facet_point + contact.flat_normal * device.lift
    tubes.direction = mirrored
    active &= dr.dot(mirrored, contact.flat_normal) > 0
    tubes.evaluate()
    return tubes.compacted(dr.compress(active))
