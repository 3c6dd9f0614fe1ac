"""Shooting and bouncing tubes with physical optics: the scattering kernel.

Every tube adds, at each of its hits that the receiver sees, the linear-phase integral of the surface currents over its footprint:

    a = -j/(8 pi) [P . V] dOmega L_i / (L_o cos t) sinc^2(k g_u L_i/2) sinc^2(k g_v L_i/2) exp(-j k (L_i + L_o))
    V = n x (k_i x E_i + k_r x E_r) + ((E_i + E_r) x n) x s
    g_u = (e_u . n)(1 - s . k_i)/cos t - s . e_u

Symbols: L_i -> length_in (unfolded, source to hit), L_o -> length_out (hit to receiver), k_i, k_r, s -> unit directions in, mirrored and to
the receiver, n -> normal on the lit side, E_i, E_r -> incident and reflected field by the TE/TM coefficients of the surface, P -> receive
polarisation, e_u, e_v -> footprint vectors. Tubes are hats: they overlap by half and sum to one, hence the squared sinc. Box tubes (sinc to
the first power) leave phase steps between neighbours, which on a sphere of 33 mm at one tube per square wavelength cost 0.62 dB rms against 0.21. |a|^2 is received over transmitted power between isotropic
antennas; on a perfect conductor V is the textbook 2 n x (k x E). For a plane wave dOmega L_i^2 is the tube's cross-section.
Curved facets: a hit is lifted by h = -1/2 sum_{i<j} b_i b_j (n_i - n_j).(p_j - p_i) along the interpolated normal, b its barycentrics.
Amplitudes leave this module conjugated, for signals exp(+j k L), and without the propagation phase. Ref: H. Ling, R. Chou, S. Lee,
IEEE Trans. Antennas Propag. 37 (1989) 194, with linear-phase integration per tube in place of point sums.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.launch import Launch
from radartwin.simulation.reflection_table import COSINES, ReflectionTable

TUBES_PER_LAUNCH = 1 << 21  # bounds a kernel's memory to a few hundred megabytes
COS_GRAZING = 1e-3  # below this a smooth surface returns nothing a tube could resolve


@dataclass(frozen=True)
class Antennas:
    """Where fields start and arrive, per pose, in the geometry's frame.

    Attributes:
        position: (F, 3) metres; ignored for a plane wave except as direction of arrival (a point far away).
        axis: (F, 3) unit; the field is its normalised projection across the ray.
        cross: take the perpendicular of that projection instead (H for V).
    """

    position: np.ndarray
    axis: np.ndarray
    cross: bool = False


@dataclass(frozen=True)
class Occluder:
    """Static geometry that can stand between sensor and object: its scene, and each pose's map from the object's frame to its own.

    Attributes:
        geometry: what may block.
        rotation: (F, 3, 3); translation: (F, 3).
    """

    geometry: Geometry
    rotation: np.ndarray
    translation: np.ndarray


@dataclass(frozen=True)
class Hits:
    """One entry per contributing hit.

    Attributes:
        pose: (N,) index; tube: (N,) index in the launch; bounce: (N,) reflections, from 1.
        amplitude: (N, Q) complex, conjugated, without propagation phase.
        length_in_m, length_out_m: (N,) float64; departure, arrival: (N, 3) unit, from source and receiver towards the path.
    """

    pose: np.ndarray
    tube: np.ndarray
    bounce: np.ndarray
    amplitude: np.ndarray
    length_in_m: np.ndarray
    length_out_m: np.ndarray
    departure: np.ndarray
    arrival: np.ndarray

    @staticmethod
    def concatenate(parts: Sequence["Hits"]) -> "Hits":
        names = ("pose", "tube", "bounce", "amplitude", "length_in_m", "length_out_m", "departure", "arrival")
        return Hits(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def trace(
    geometry: Geometry,
    table: ReflectionTable,
    launch: Launch,
    transmit: Antennas,
    receive: Antennas,
    *,
    max_bounces: int,
    cluster: np.ndarray | None = None,
    first_hit: int = 0,
    occluder: Occluder | None = None,
    prune: float = 0.0,
) -> Hits:
    """All hits of a launch, up to `max_bounces` reflections.

    With several frequency nodes and pruning, tubes are first found with the largest reflection over the sweep at one node, and only those
    that matter (a few in a hundred in a room) are traced again at all nodes.

    Args:
        geometry: what is hit; table: its surfaces' reflection, at Q frequencies.
        launch: tubes of F poses; transmit, receive: antennas of the same poses (of one phase centre when equal positions).
        cluster, first_hit: with `cluster` (faces,) given, keep only tubes whose first hit lies on a face of cluster `first_hit`, so that
            launches of different density share the scene between them.
        occluder: static geometry tested between sensor and first and last hit.
        prune: leave out hits below this share of the strongest of their pose in this launch.
    """
    if prune and len(table.frequencies_hz) > 1:
        scout = trace(
            geometry, table.envelope(), launch, transmit, receive,
            max_bounces=max_bounces, cluster=cluster, first_hit=first_hit, occluder=occluder, prune=prune,
        )  # fmt: skip
        chosen = np.unique(scout.tube)
    else:
        chosen = None
    parts = []
    if chosen is None:
        per_chunk = max(1, TUBES_PER_LAUNCH // launch.per_pose)
        blocks = [
            (start * launch.per_pose, min(start + per_chunk, launch.poses) * launch.per_pose) for start in range(0, launch.poses, per_chunk)
        ]
        tubes = [np.arange(low, high, dtype=np.uint32) for low, high in blocks]
    else:
        tubes = [chosen[k : k + TUBES_PER_LAUNCH].astype(np.uint32) for k in range(0, len(chosen), TUBES_PER_LAUNCH)]
    if len(geometry.corners):
        device = _Tables(geometry, table, cluster)
        for block in tubes:
            parts += _trace_block(
                geometry,
                device,
                float(table.frequencies_hz.mean()),
                launch,
                transmit,
                receive,
                block,
                max_bounces,
                first_hit,
                occluder,
                prune,
            )
    q = len(table.frequencies_hz)
    none = np.zeros(0, int)
    empty = Hits(none, none, none, np.zeros((0, q), np.complex128), np.zeros(0), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    return Hits.concatenate([empty, *parts])


class _Tables:
    """Per-face and per-surface arrays on the device, with the gathers the kernel makes."""

    def __init__(self, geometry: Geometry, table: ReflectionTable, cluster: np.ndarray | None):
        import drjit as dr
        import mitsuba as mi

        self.dr, self.mi = dr, mi
        self.corner = mi.Float(geometry.corners.astype(np.float32).ravel())
        self.normal = mi.Float(geometry.normals.astype(np.float32).ravel())
        self.surface = mi.UInt32(geometry.surface.astype(np.uint32))
        self.cluster = None if cluster is None else mi.UInt32(cluster.astype(np.uint32))
        self.nodes = len(table.frequencies_hz)
        self.coefficients = [mi.Float(part.astype(np.float32).ravel()) for c in (table.te, table.tm) for part in (c.real, c.imag)]

    def corners(self, source: Any, face: Any, active: Any) -> list[Any]:
        """The three corner vectors of a face from one of the per-corner arrays."""
        dr, mi = self.dr, self.mi
        return [mi.Vector3f(*(dr.gather(mi.Float, source, face * 9 + 3 * c + i, active) for i in range(3))) for c in range(3)]

    def reflection(self, face: Any, cosine: Any, node: int, active: Any) -> list[Any]:
        """[te.re, te.im, tm.re, tm.im] at one frequency node, linear in the cosine."""
        dr, mi = self.dr, self.mi
        x = dr.clip(cosine, 0, 1) * (COSINES - 1)
        low = dr.minimum(mi.UInt32(x), COSINES - 2)
        weight = x - mi.Float(low)
        index = (dr.gather(mi.UInt32, self.surface, face, active) * COSINES + low) * self.nodes + node
        return [
            dr.lerp(dr.gather(mi.Float, c, index, active), dr.gather(mi.Float, c, index + self.nodes, active), weight)
            for c in self.coefficients
        ]


def _sinc(dr: Any, x: Any) -> Any:
    """sin(x)/x without the hole at zero."""
    return dr.select(dr.abs(x) < 1e-3, 1 - x * x / 6, dr.sin(x) / dr.select(x == 0, 1, x))


def _project(dr: Any, mi: Any, axis: Any, direction: Any, cross: bool) -> Any:
    """Normalised projection of `axis` across `direction`; `cross` turns it by a right angle about `direction`."""
    across = axis - direction * dr.dot(axis, direction)
    field = across * dr.rsqrt(dr.maximum(dr.squared_norm(across), 1e-12))
    return dr.cross(direction, field) if cross else field


def _trace_block(geometry, tables, frequency_hz, launch, transmit, receive, block, max_bounces, first_hit, occluder, prune):  # noqa: PLR0913
    import drjit as dr
    import mitsuba as mi

    scene = geometry.scene()
    wavenumber = dr.opaque(mi.Float, 2 * np.pi * frequency_hz / SPEED_OF_LIGHT)
    lift = dr.opaque(mi.Float, max(2e-6 * geometry.extent_m, 1e-7))
    part = launch

    def rows(values: np.ndarray) -> Any:
        flat = [mi.Float(np.ascontiguousarray(values[:, i], np.float32)) for i in range(3)]
        return lambda index, active=True: mi.Vector3f(*(dr.gather(mi.Float, column, index, active) for column in flat))

    def scalars(values: np.ndarray) -> Any:
        column = mi.Float(values.astype(np.float32))
        return lambda index: dr.gather(mi.Float, column, index)

    source_at, forward_at, u_at, v_at = rows(part.source), rows(part.forward), rows(part.u_axis), rows(part.v_axis)
    tx_axis_at, rx_axis_at = rows(transmit.axis), rows(receive.axis)
    receiver_at = rows(receive.position)
    same_place = bool(np.array_equal(transmit.position, receive.position))

    index = mi.UInt32(block)
    tube = mi.UInt32(index)
    strongest = dr.zeros(mi.Float, part.poses)
    per_pose, count_u = dr.opaque(mi.UInt32, part.per_pose), dr.opaque(mi.UInt32, part.count_u)
    pose = index // per_pose
    cell = index - pose * per_pose
    cell_v = cell // count_u
    cell_u = cell - cell_v * count_u
    step_u, step_v = scalars(part.step_u)(pose), scalars(part.step_v)(pose)
    u = scalars(part.low_u)(pose) + mi.Float(cell_u) * step_u
    v = scalars(part.low_v)(pose) + mi.Float(cell_v) * step_v
    forward, u_axis, v_axis = forward_at(pose), u_at(pose), v_at(pose)
    if part.plane:
        origin = source_at(pose) + u_axis * u + v_axis * v
        direction = forward
        foot_u, foot_v = u_axis * step_u, v_axis * step_v
        weight = step_u * step_v
    else:
        origin = source_at(pose)
        scale = dr.rsqrt(1 + u * u + v * v)
        direction = (forward + u_axis * u + v_axis * v) * scale
        foot_u = (u_axis - direction * dr.dot(direction, u_axis)) * scale * step_u
        foot_v = (v_axis - direction * dr.dot(direction, v_axis)) * scale * step_v
        weight = step_u * step_v * scale * scale * scale
    departure = mi.Vector3f(direction)
    field_re = _project(dr, mi, tx_axis_at(pose), direction, False)
    if transmit.cross:  # H = (direction to the radar) x V, and the radar lies against the ray
        field_re = dr.cross(-direction, field_re)
    fields = [(mi.Vector3f(field_re), mi.Vector3f(0.0)) for _ in range(tables.nodes)]
    length = mi.Float64(0.0) + dr.zeros(mi.Float64, dr.width(index))
    results = []
    active = mi.Bool(True) & (index >= 0)

    for bounce in range(1, max_bounces + 1):
        dr.eval(origin, direction, foot_u, foot_v, weight, departure, fields, length, pose, active)
        ray = mi.Ray3f(origin, direction)
        hit = scene.ray_intersect_preliminary(ray, coherent=bounce == 1, active=active)
        active = active & hit.is_valid()
        face = hit.prim_index
        if bounce == 1 and tables.cluster is not None:
            active &= dr.gather(mi.UInt32, tables.cluster, face, active) == dr.opaque(mi.UInt32, first_hit)
        distance = dr.select(active, hit.t, 0.0)
        corners = tables.corners(tables.corner, face, active)
        normals = tables.corners(tables.normal, face, active)
        b1, b2 = hit.prim_uv.x, hit.prim_uv.y
        b = [1 - b1 - b2, b1, b2]
        flat_normal = dr.normalize(dr.cross(corners[1] - corners[0], corners[2] - corners[0]))
        smooth = normals[0] * b[0] + normals[1] * b[1] + normals[2] * b[2]
        normal = smooth * dr.rsqrt(dr.maximum(dr.squared_norm(smooth), 1e-12))
        sag = mi.Float(0.0)
        for i, j in ((0, 1), (0, 2), (1, 2)):
            sag += b[i] * b[j] * dr.dot(normals[i] - normals[j], corners[j] - corners[i])
        facet_point = origin + direction * distance
        lifted = facet_point - normal * (0.5 * sag)
        side = dr.select(dr.dot(direction, flat_normal) > 0, -1.0, 1.0)
        flat_normal, normal = flat_normal * side, normal * side
        cosine = -dr.dot(direction, normal)
        active &= cosine > COS_GRAZING

        # The lifted point lies off the ray by the sag along the normal: its path length in is that of the point itself.
        length = length + mi.Float64(distance) + mi.Float64(dr.dot(lifted - facet_point, direction))
        to_receiver = receiver_at(pose, active) - lifted if not part.plane else -forward_at(pose, active)
        length_out = dr.norm(to_receiver) if not part.plane else dr.dot(receiver_at(pose, active) - lifted, to_receiver)
        outgoing = dr.normalize(to_receiver)
        seen = active & (dr.dot(outgoing, normal) > COS_GRAZING) & (dr.dot(outgoing, flat_normal) > 0)
        start_point = facet_point + flat_normal * lift
        if not (bounce == 1 and same_place):
            reach = (1 - 1e-4) * length_out if not part.plane else mi.Float(dr.largest(mi.Float))
            seen &= ~scene.ray_test(mi.Ray3f(start_point, outgoing, reach, 0.0, []), seen)
        if occluder is not None:
            if bounce == 1:
                active &= ~_blocked(dr, mi, occluder, pose, origin, facet_point, active)
            seen &= active
            if not (bounce == 1 and same_place):
                seen &= ~_blocked(dr, mi, occluder, pose, receiver_at(pose, active), facet_point, seen)

        # local basis: s across the plane of incidence, p along the field in it
        across = dr.cross(direction, normal)
        across_norm = dr.squared_norm(across)
        helper = mi.coordinate_system(normal)[0]
        s_axis = dr.select(across_norm > 1e-10, across * dr.rsqrt(dr.maximum(across_norm, 1e-12)), helper)
        mirrored = direction + normal * (2 * cosine)
        p_in, p_out = dr.cross(direction, s_axis), dr.cross(mirrored, s_axis)
        receive_axis = _project(dr, mi, rx_axis_at(pose, active), outgoing, receive.cross)

        footprint = mi.Float(length) if not part.plane else mi.Float(1.0)
        g_u = dr.dot(foot_u, normal) * (1 - dr.dot(outgoing, direction)) / cosine - dr.dot(outgoing, foot_u)
        g_v = dr.dot(foot_v, normal) * (1 - dr.dot(outgoing, direction)) / cosine - dr.dot(outgoing, foot_v)
        phase_integral = _sinc(dr, 0.5 * wavenumber * g_u * footprint) * _sinc(dr, 0.5 * wavenumber * g_v * footprint)
        spread = weight * footprint / (cosine * (length_out if not part.plane else 1.0))
        common = dr.select(seen, phase_integral * phase_integral * spread / (8 * np.pi), 0.0)

        outputs, next_fields = [], []
        for node, (e_re, e_im) in enumerate(fields):
            te_re, te_im, tm_re, tm_im = tables.reflection(face, cosine, node, active)
            s_re, s_im, p_re, p_im = dr.dot(e_re, s_axis), dr.dot(e_im, s_axis), dr.dot(e_re, p_in), dr.dot(e_im, p_in)
            r_re = s_axis * (te_re * s_re - te_im * s_im) + p_out * (tm_re * p_re - tm_im * p_im)
            r_im = s_axis * (te_re * s_im + te_im * s_re) + p_out * (tm_re * p_im + tm_im * p_re)
            component = []
            for incident, reflected in ((e_re, r_re), (e_im, r_im)):
                electric = dr.cross(normal, dr.cross(direction, incident) + dr.cross(mirrored, reflected))
                magnetic = dr.cross(dr.cross(incident + reflected, normal), outgoing)
                component.append(common * dr.dot(receive_axis, electric + magnetic))
            outputs.append(component)
            next_fields.append((r_re, r_im))
        if prune:
            level = sum(re * re + im * im for re, im in outputs) * mi.Float(dr.opaque(mi.Float, 1 / len(outputs)))
            dr.scatter_reduce(dr.ReduceOp.Max, strongest, level, pose, seen)
            dr.eval(outputs, seen, level, strongest)
            seen &= level >= prune * prune * dr.gather(mi.Float, strongest, pose, seen)
        results.append(_collect(dr, mi, outputs, seen, pose, tube, bounce, length, length_out, departure, outgoing))
        if bounce == max_bounces:
            break

        # The lifted path also leaves later or earlier by the same amount along the mirrored ray.
        length = length - mi.Float64(dr.dot(lifted - facet_point, mirrored))
        foot_u, foot_v = (f - normal * (2 * dr.dot(f, normal)) for f in (foot_u, foot_v))
        origin, direction, fields = start_point, mirrored, next_fields
        active &= dr.dot(mirrored, flat_normal) > 0
        dr.eval(origin, direction, foot_u, foot_v, fields, length, active)
        alive = dr.compress(active)
        if dr.width(alive) == 0:
            break
        pick = lambda x, i=alive: dr.gather(type(x), x, i)  # noqa: E731
        origin, direction, foot_u, foot_v, departure = map(pick, (origin, direction, foot_u, foot_v, departure))
        weight, length, pose, tube = map(pick, (weight, length, pose, tube))
        fields = [(pick(re), pick(im)) for re, im in fields]
        active = dr.full(mi.Bool, True, dr.width(alive))
    return [r for r in results if r is not None]


def _blocked(dr: Any, mi: Any, occluder: Occluder, pose: Any, start: Any, end: Any, active: Any) -> Any:
    """Whether static geometry stands between two points given in the object's frame, short of either by 0.1 mm."""
    rotation, translation = occluder.rotation, occluder.translation
    columns = [[mi.Float(np.ascontiguousarray(rotation[:, i, j], np.float32)) for j in range(3)] for i in range(3)]
    shift = [mi.Float(np.ascontiguousarray(translation[:, i], np.float32)) for i in range(3)]
    matrix = [[dr.gather(mi.Float, columns[i][j], pose, active) for j in range(3)] for i in range(3)]
    offset = mi.Vector3f(*(dr.gather(mi.Float, s, pose, active) for s in shift))

    def to_world(p: Any) -> Any:
        return mi.Vector3f(*(matrix[i][0] * p.x + matrix[i][1] * p.y + matrix[i][2] * p.z for i in range(3))) + offset

    a, b = to_world(start), to_world(end)
    way = b - a
    distance = dr.norm(way)
    ray = mi.Ray3f(a, way / dr.maximum(distance, 1e-9), distance - 1e-4, 0.0, [])
    return occluder.geometry.scene().ray_test(ray, active)


def _collect(dr, mi, outputs, seen, pose, tube, bounce, length, length_out, departure, outgoing):  # noqa: PLR0913
    """Contributing hits to host arrays; amplitudes become conj(-j x) = +j conj(x)."""
    keep = dr.compress(seen)
    if dr.width(keep) == 0:
        return None

    def host(values: Any) -> np.ndarray:
        return dr.gather(type(values), values, keep).numpy()

    amplitude = np.stack([1j * (host(re).astype(float) - 1j * host(im).astype(float)) for re, im in outputs], axis=1)
    arrival = -host(outgoing).T
    count = dr.width(keep)
    return Hits(
        host(pose).astype(int), host(tube).astype(int), np.full(count, bounce), amplitude, host(length),
        host(mi.Float64(length_out)), host(departure).T.astype(float), arrival.astype(float),
    )  # fmt: skip
