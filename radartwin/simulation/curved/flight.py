"""Tubes on their way, one lane each, and how they leave the source.

Symbols as in `radartwin.simulation.curved.tubes`. Import only once a Mitsuba variant is active.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from radartwin.simulation.curved.device import rows, scalars, upload
from radartwin.simulation.curved.tube_grid import Launch


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

    def _values(self) -> Iterator[Any]:
        return (getattr(self, field.name) for field in fields(self))


def project(axis: Any, direction: Any) -> Any:
    """Normalised part of `axis` across `direction`."""
    across = axis - direction * dr.dot(axis, direction)
    return across * dr.rsqrt(dr.maximum(dr.squared_norm(across), 1e-12))


def rays(launch: Launch, pose: Any, cell_u: Any, cell_v: Any) -> tuple[Any, Any, Any, Any, Any]:
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
    cell = cell - pose * per_pose  # not in place: that would change the index too
    cell_v = cell // count_u
    cell_u = cell - cell_v * count_u
    origin, direction, foot_u, foot_v, weight = rays(launch, pose, mi.Float(cell_u) * size - offset, mi.Float(cell_v) * size - offset)
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
