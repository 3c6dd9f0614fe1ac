"""The device side of the tube tracer: launch, meet a surface, scatter to the receiver, bounce.

Formulas and symbols are those of `radartwin.simulation.tubes`; arrays here are Dr.Jit's, one lane per tube. Import only once a Mitsuba
variant is active. Numbers that change from call to call are made opaque, for a literal in a kernel means compiling it again.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from radartwin.simulation.face_labels import LABEL_BITS
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.launch import Launch
from radartwin.simulation.reflection_table import COSINES, ReflectionTable

COS_GRAZING = 1e-3  # below this a smooth surface returns nothing a tube could resolve
STEEP = 14.0  # phase across half a tube, radians, from which its integral is taken from its kinks
FLAT = 1e-10  # squared turn of the vertex normals over a facet below which it is flat
SPREADING = 1 << 31  # of what a scouting ray met: it went from a curved surface on to another
MOST_BEND = 3.0  # second-order phase, radians, that a footprint on a curved surface follows unless it is steep
TERMINATOR = 0.4  # cosine below which a curved surface's currents fade away from its mirrored direction
MOST_TWIST = 2.0  # mixed second-order phase, radians, up to which a footprint follows it
_ALIGNED = 64  # bytes; the widest vector of any CPU
_KINDS = {"Float": np.float32, "UInt": np.uint32, "UInt64": np.uint64, "Bool": np.bool_}
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
SHADOW_SHORT = 1e-4  # share of a way to the receiver, and metres at an occluder, by which visibility tests stop short


def upload(kind: Any, values: np.ndarray) -> Any:
    """An array on the device whose kernels do not depend on where its values came from. On the CPU, Dr.Jit uses NumPy's memory as it is and
    compiles for its alignment, which changes from call to call; and a single value would be compiled into the kernel."""
    if np.size(values) == 1:
        return dr.opaque(kind, np.asarray(values).reshape(-1)[0].item())
    itemsize = dr.itemsize_v(kind)
    flat = np.asarray(values).ravel()
    room = np.empty(flat.size * itemsize + _ALIGNED, np.uint8)
    start = -room.ctypes.data % _ALIGNED
    aligned = room[start : start + flat.size * itemsize].view(_KINDS[kind.__name__])
    aligned[:] = flat
    return kind(aligned)


def rows(values: np.ndarray) -> Callable[..., Any]:
    """(F, 3) on the device, as a function that gathers vectors by index."""
    columns = [upload(mi.Float, values[:, i]) for i in range(3)]
    return lambda index, active=True: mi.Vector3f(*(dr.gather(mi.Float, column, index, active) for column in columns))


def scalars(values: np.ndarray) -> Callable[[Any], Any]:
    """(F,) on the device, as a function that gathers by index."""
    column = upload(mi.Float, values)
    return lambda index: dr.gather(mi.Float, column, index)


class Device:
    """A geometry and its reflection on the device, with the gathers the kernels make."""

    def __init__(self, geometry: Geometry, table: ReflectionTable, cluster: np.ndarray | None, labels: np.ndarray | None, hats: bool):
        self.scene = geometry.scene()
        self.hats = dr.opaque(mi.Bool, hats)
        self.corner = upload(mi.Float, geometry.corners)
        self.normal = upload(mi.Float, geometry.normals)
        self.surface = upload(mi.UInt32, geometry.surface)
        self.cluster = None if cluster is None else upload(mi.UInt32, cluster)
        self.labels = None if labels is None else upload(mi.UInt64, labels + 1)
        self.nodes = len(table.frequencies_hz)
        self.coefficients = [upload(mi.Float, part) for c in (table.te, table.tm) for part in (np.real(c), np.imag(c))]
        # rays leave a surface this far above it: well over the float32 resolution of its coordinates
        self.lift = dr.opaque(mi.Float, max(2e-6 * geometry.extent_m, 1e-7))
        self.curved = geometry.curved
        self.patch = upload(mi.UInt32, geometry.patch + 1)

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


@dataclass(frozen=True)
class Chosen:
    """Tubes of a launch to be traced.

    Attributes:
        index: (N,) uint32 cell in the launch, or beyond its cells a piece of the grid that is `pieces` times finer each way and reaches
            (pieces - 1)/2 pieces beyond it on every side.
        share, whole: (N,) how much of a hat a tube stands for, and whether it counts where boxes do; None: all of both, cells only.
        pieces: odd.
    """

    index: np.ndarray
    share: np.ndarray | None = None
    whole: np.ndarray | None = None
    pieces: int = 1


@dataclass
class Tubes:
    """Tubes on their way, before the next hit.

    Attributes:
        index, pose: launch index and pose. origin, direction: of the ray.
        place_u, place_v: derivatives of the ray's position along the grid, metres; foot_u, foot_v: of its direction.
        weight: solid angle (plane wave: area) at the source. share, whole: how much of a hat and of a box a part of a divided tube stands
        for; None: all of both.
        departure: direction at the source. field_re, field_im: polarisation per frequency node. length: unfolded, float64.
        face, inner_u, inner_v: of the next hit, once cast: its triangle and two barycentric coordinates.
        first: length to the first hit. sequence: 1 + label of each face met, the last in the lowest LABEL_BITS bits.
    """

    index: Any
    pose: Any
    origin: Any
    direction: Any
    place_u: Any
    place_v: Any
    foot_u: Any
    foot_v: Any
    weight: Any
    share: Any
    whole: Any
    departure: Any
    field_re: list[Any]
    field_im: list[Any]
    length: Any
    first: Any
    sequence: Any
    face: Any = None
    inner_u: Any = None
    inner_v: Any = None

    def evaluate(self, *others: Any) -> None:
        """In one kernel, with whatever else is wanted."""
        dr.eval(*(value for value in self._values() if value is not None), *others)

    def compacted(self, alive: Any) -> "Tubes":
        """The tubes at these lane indices."""

        def pick(value: Any) -> Any:
            if value is None:
                return None
            return [pick(v) for v in value] if isinstance(value, list) else dr.gather(type(value), value, alive)

        return Tubes(*(pick(value) for value in self._values()))

    def surface_step(self, contact: "Contact", place: Any) -> Any:
        """Step on the surface from tube to tube, for one of the two places."""
        return place + self.direction * (dr.dot(place, contact.normal) * dr.rcp(contact.cosine))

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

    def mirrored(self, direction: Any) -> Any:
        """The incident direction after reflection."""
        return direction + self.normal * (2 * self.cosine)

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


def project(axis: Any, direction: Any) -> Any:
    """Normalised part of `axis` across `direction`."""
    across = axis - direction * dr.dot(axis, direction)
    return across * dr.rsqrt(dr.maximum(dr.squared_norm(across), 1e-12))


def footprint_moments(alpha: Any, beta: Any, hat: Any) -> list[tuple[Any, Any]]:
    """Integrals of w(x) exp(-j beta x^2) times cos(alpha x), x sin(alpha x) and x^2 cos(alpha x), each real and imaginary part, with w
    a hat on [-1, 1] or a box on [-1/2, 1/2].

    Gauss-Legendre while the phase turns by less than about two cycles a side (error 1e-7), beyond it the leading asymptotic terms of the
    hat's three kinks (error below 2e-3), or the box without its curvature, and no higher moments.
    """
    half, slope = dr.select(hat, mi.Float(1.0), 0.5), dr.select(hat, mi.Float(1.0), 0.0)
    moments = [[mi.Float(0.0), mi.Float(0.0)] for _ in range(3)]
    for node, weight in zip((_NODES + 1) / 2, _WEIGHTS / 2, strict=True):
        x = half * float(node)
        share = half * float(2 * weight) * (1 - slope * float(node))
        sine, cosine = dr.sincos(beta * x * x)
        odd, even = dr.sincos(alpha * x)
        for moment, part in zip(moments, (share * even, share * x * odd, share * x * x * even), strict=True):
            moment[0] += part * cosine
            moment[1] -= part * sine
    up, down = dr.rcp(dr.square(alpha + 2 * beta)), dr.rcp(dr.square(alpha - 2 * beta))
    (sine_up, cosine_up), (sine_down, cosine_down) = dr.sincos(beta + alpha), dr.sincos(beta - alpha)
    steep = (dr.abs(alpha) * half > STEEP) & (dr.abs(alpha) > 3.9 * dr.abs(beta))
    box = 2 * dr.sin(0.5 * alpha) * dr.rcp(alpha)
    far_re = dr.select(hat, 2 * dr.rcp(dr.square(alpha)) - cosine_up * up - cosine_down * down, box)
    far_im = dr.select(hat, sine_up * up + sine_down * down, 0.0)
    far = [(far_re, far_im), (mi.Float(0.0), mi.Float(0.0)), (mi.Float(0.0), mi.Float(0.0))]
    return [tuple(dr.select(steep, f, n) for f, n in zip(*pair, strict=True)) for pair in zip(far, moments, strict=True)]


def footprint_integral(alpha: Sequence[Any], beta: Sequence[Any], twist: Any, hat: Any) -> tuple[Any, Any]:
    """Integral of w(x) w(y) exp(-j (alpha . (x, y) + beta . (x^2, y^2) + twist x y)) over a footprint, real and imaginary part; the twist
    to its second power."""
    first, second = (footprint_moments(a, b, hat) for a, b in zip(alpha, beta, strict=True))
    products = [(a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]) for a, b in zip(first, second, strict=True)]
    twist = dr.clip(twist, -MOST_TWIST, MOST_TWIST)
    square = 0.5 * twist * twist
    return products[0][0] - twist * products[1][1] - square * products[2][0], products[0][1] + twist * products[1][0] - square * products[
        2
    ][1]


def _rays(launch: Launch, pose: Any, cell_u: Any, cell_v: Any) -> tuple[Any, Any, Any, Any, Any]:
    """Origin, direction, the direction's derivatives along the grid and its solid angle, at grid coordinates; for a plane wave the
    position's derivatives and the area."""
    step_u, step_v = scalars(launch.step_u)(pose), scalars(launch.step_v)(pose)
    u = scalars(launch.low_u)(pose) + cell_u * step_u
    v = scalars(launch.low_v)(pose) + cell_v * step_v
    origin, forward, u_axis, v_axis = (rows(x)(pose) for x in (launch.source, launch.forward, launch.u_axis, launch.v_axis))
    if launch.plane:
        return origin + u_axis * u + v_axis * v, forward, u_axis * step_u, v_axis * step_v, step_u * step_v
    scale = dr.rsqrt(1 + u * u + v * v)
    direction = (forward + u_axis * u + v_axis * v) * scale
    foot_u = (u_axis - direction * dr.dot(direction, u_axis)) * scale * step_u
    foot_v = (v_axis - direction * dr.dot(direction, v_axis)) * scale * step_v
    return origin, direction, foot_u, foot_v, step_u * step_v * scale * scale * scale


def start(launch: Launch, axis: np.ndarray, cross: bool, chosen: Chosen, nodes: int) -> Tubes:
    """Tubes of a launch by index; fields along the projected antenna axis, turned for H."""
    index = upload(mi.UInt32, chosen.index)
    per_pose, count_u = dr.opaque(mi.UInt32, launch.per_pose), dr.opaque(mi.UInt32, launch.count_u)
    cell, size, offset = index, mi.Float(1.0), mi.Float(0.0)
    if chosen.share is not None:
        total, margin = launch.poses * launch.per_pose, chosen.pieces - 1
        piece = index >= dr.opaque(mi.UInt32, total)
        cell = dr.select(piece, index - dr.opaque(mi.UInt32, total), index)
        fine_u, fine_v = (chosen.pieces * count + margin for count in (launch.count_u, launch.count_v))
        per_pose = dr.select(piece, dr.opaque(mi.UInt32, fine_u * fine_v), per_pose)
        count_u = dr.select(piece, dr.opaque(mi.UInt32, fine_u), count_u)
        size = dr.select(piece, dr.opaque(mi.Float, 1 / chosen.pieces), size)
        offset = dr.select(piece, dr.opaque(mi.Float, margin / chosen.pieces), offset)
    pose = cell // per_pose
    cell -= pose * per_pose
    cell_v = cell // count_u
    cell_u = cell - cell_v * count_u
    origin, direction, foot_u, foot_v, weight = _rays(launch, pose, mi.Float(cell_u) * size - offset, mi.Float(cell_v) * size - offset)
    foot_u, foot_v, weight = foot_u * size, foot_v * size, weight * size * size
    field = project(rows(axis)(pose), direction)
    if cross:  # H = (direction to the radar) x V, and the radar lies against the ray
        field = dr.cross(-direction, field)
    nothing = dr.zeros(mi.Vector3f, dr.width(index))
    place_u, place_v = (foot_u, foot_v) if launch.plane else (mi.Vector3f(nothing), mi.Vector3f(nothing))
    if launch.plane:
        foot_u, foot_v = mi.Vector3f(nothing), mi.Vector3f(nothing)
    share, whole = (
        (None, None) if chosen.share is None or chosen.whole is None else (upload(mi.Float, chosen.share), upload(mi.Bool, chosen.whole))
    )
    return Tubes(
        index, pose, origin, direction, place_u, place_v, foot_u, foot_v, weight, share, whole, mi.Vector3f(direction),
        [mi.Vector3f(field) for _ in range(nodes)], [mi.Vector3f(nothing) for _ in range(nodes)], dr.zeros(mi.Float64, dr.width(index)),
        dr.zeros(mi.Float64, dr.width(index)), dr.zeros(mi.UInt64, dr.width(index)),
    )  # fmt: skip


def cast(device: Device, tubes: Tubes, first: bool, alive: Any = True) -> Any:
    """Find what tubes meet next; which of them meet anything."""
    hit = device.scene.ray_intersect_preliminary(mi.Ray3f(tubes.origin, tubes.direction), coherent=first, active=alive)
    tubes.face, tubes.inner_u, tubes.inner_v = hit.prim_index, hit.prim_uv.x, hit.prim_uv.y
    return hit.is_valid() & alive


def meet(device: Device, tubes: Tubes, first: bool, active: Any) -> tuple[Contact, Any]:
    """The surface tubes were cast onto, and which of the lanes `active` do not just graze it. Adds the way there to their length and their
    place, and turns the field of those that pass a caustic by a quarter of a cycle each."""
    face = tubes.face
    corners = device.corners(device.corner, face, active)
    barycentric = [1 - tubes.inner_u - tubes.inner_v, tubes.inner_u, tubes.inner_v]
    flat = dr.normalize(dr.cross(corners[1] - corners[0], corners[2] - corners[0]))
    # From the corners, not along the ray: t carries the rounding of a far source, which would put the point below its own facet.
    facet_point = corners[0] * barycentric[0] + corners[1] * barycentric[1] + corners[2] * barycentric[2]
    facet_point = dr.select(active, facet_point, tubes.origin)  # a miss has no face, and what it gathered must not spread
    side = dr.select(dr.dot(tubes.direction, flat) > 0, -1.0, 1.0)
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
    contact = Contact(face, flat * side, normal * side, facet_point, point, -dr.dot(tubes.direction, normal) * side, edges, turns)
    way = dr.dot(mi.Vector3d(point) - mi.Vector3d(tubes.origin), mi.Vector3d(tubes.direction))
    if device.curved and not first:
        _pass_caustics(tubes, mi.Float(way))
    tubes.place_u, tubes.place_v = tubes.place_u + tubes.foot_u * mi.Float(way), tubes.place_v + tubes.foot_v * mi.Float(way)
    tubes.length = tubes.length + way
    if first:
        tubes.first = tubes.length
    if device.labels is not None:
        tubes.sequence = (tubes.sequence << LABEL_BITS) + dr.gather(mi.UInt64, device.labels, face, active)
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
    mirrored = contact.mirrored(tubes.direction)
    p_in, p_out = dr.cross(tubes.direction, s), dr.cross(mirrored, s)
    inverse_out = mi.Float(0.0) if plane else dr.rcp(length_out)
    change = tubes.direction - outgoing  # gradient of the path length at the hit
    foots = tubes.foot_u, tubes.foot_v
    onward = (1 - dr.dot(tubes.direction, outgoing)) * dr.rcp(contact.cosine)  # of the path for a hit that lies deeper along the ray
    steps = [tubes.surface_step(contact, place) for place in (tubes.place_u, tubes.place_v)]
    turns = [contact.turn(step) for step in steps] if device.curved else []
    alongs = [dr.dot(step, outgoing) for step in steps]

    def bend(i: int, j: int) -> Any:
        value = dr.dot(foots[i], steps[j]) + (dr.dot(steps[i], steps[j]) - alongs[i] * alongs[j]) * inverse_out
        return value + onward * dr.dot(turns[i], steps[j]) if device.curved else value

    hat = device.hats
    if device.curved:
        hat = hat | contact.bends()
    slopes = [wavenumber * dr.dot(change, step) for step in steps]
    bends = [0.5 * wavenumber * bend(i, i) for i in range(2)]
    if device.curved:  # near a shadow line the expansion means nothing beyond this
        for i, slope in enumerate(slopes):
            most = dr.select(contact.bends(), dr.maximum(0.25 * dr.abs(slope), MOST_BEND), dr.inf)
            bends[i] = dr.clip(bends[i], -most, most)
    re, im = footprint_integral(slopes, bends, wavenumber * bend(0, 1), hat)
    # field times area: the field falls with the square root of the cross-section, and stays finite where that vanishes
    cross_section = dr.abs(dr.dot(dr.cross(tubes.place_u, tubes.place_v), tubes.direction))
    level = dr.sqrt(tubes.weight * cross_section) * dr.rcp(8 * np.pi * contact.cosine) * (1.0 if plane else inverse_out)
    if device.curved:
        # currents end at the shadow line of a curved surface only in physical optics; faded out there, save towards the mirrored ray
        fade = TERMINATOR * 0.5 * (1 - dr.dot(mirrored, outgoing))
        least = dr.minimum(contact.cosine, dr.dot(contact.normal, outgoing))
        x = dr.clip(least * dr.rcp(dr.maximum(fade, 1e-6)), 0, 1)
        level *= dr.select(contact.bends(), x * x * (3 - 2 * x), 1.0)
    if tubes.share is not None:
        level *= dr.select(hat, tubes.share, dr.select(tubes.whole, mi.Float(1.0), 0.0))
    total_re, total_im = re * level, im * level
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
    steps = [tubes.surface_step(contact, place) for place in (tubes.place_u, tubes.place_v)]
    feet = [f - contact.normal * (2 * dr.dot(f, contact.normal)) for f in (tubes.foot_u, tubes.foot_v)]
    if device.curved:
        for i, step in enumerate(steps):
            turn = contact.turn(step)
            feet[i] = feet[i] + turn * (2 * contact.cosine) - contact.normal * (2 * dr.dot(tubes.direction, turn))
    tubes.place_u, tubes.place_v, tubes.foot_u, tubes.foot_v = *steps, *feet
    active = active & leave(device, tubes, contact)
    return cast(device, tubes, False, active)


def faces_met(device: Device, launch: Launch, poses: tuple[int, int], max_bounces: int, first_hit: int) -> np.ndarray:
    """What rays at the middles and at the corners of a grid's cells meet: a number per sequence of smooth patches, 0 for nothing.

    Returns:
        (poses, count_u count_v + (count_u + 1)(count_v + 1)) uint32: middles, then corners, rows along u. SPREADING is set where a
        curved surface sends the ray on to another.
    """
    middles, corners = launch.per_pose, (launch.count_u + 1) * (launch.count_v + 1)
    index = dr.arange(mi.UInt32, (poses[1] - poses[0]) * (middles + corners))
    pose = index // dr.opaque(mi.UInt32, middles + corners)
    cell = index - pose * dr.opaque(mi.UInt32, middles + corners)
    pose += dr.opaque(mi.UInt32, poses[0])
    corner = cell >= dr.opaque(mi.UInt32, middles)
    cell = dr.select(corner, cell - dr.opaque(mi.UInt32, middles), cell)
    count = dr.select(corner, dr.opaque(mi.UInt32, launch.count_u + 1), dr.opaque(mi.UInt32, launch.count_u))
    cell_v = cell // count
    offset = dr.select(corner, mi.Float(0.5), 0.0)
    origin, direction, *_ = _rays(launch, pose, mi.Float(cell - cell_v * count) - offset, mi.Float(cell_v) - offset)
    nothing, none = mi.Vector3f(0.0), mi.Float64(0.0)
    tubes = Tubes(
        index, pose, origin, direction, nothing, nothing, nothing, nothing, none, None, None, nothing, [], [], none, none, mi.UInt64(0)
    )
    alive, met, curved, spreading = mi.Bool(True), mi.UInt32(0), mi.Bool(False), mi.Bool(False)
    for number in range(max_bounces):
        alive = cast(device, tubes, number == 0, alive)
        contact, alive = meet(device, tubes, number == 0, alive)
        if number == 0 and device.cluster is not None:
            alive &= dr.gather(mi.UInt32, device.cluster, contact.face, alive) == dr.opaque(mi.UInt32, first_hit)
        # multiplied by an odd constant, so that the order of the faces counts
        met = dr.select(alive, (met * 0x9E3779B1) ^ dr.gather(mi.UInt32, device.patch, contact.face, alive), met)
        if device.curved:
            spreading = spreading | (alive & curved)
            curved = curved | (alive & contact.bends())
        alive &= leave(device, tubes, contact)
    # the lowest bit is set so that no sequence looks like nothing
    met = dr.select(met > 0, ((met << 1) & (SPREADING - 1)) | 1, 0) | dr.select(spreading, mi.UInt32(SPREADING), 0)
    return met.numpy().reshape(poses[1] - poses[0], -1)
