"""State of the tubes (one Dr.Jit lane per tube) and their start at the source.

Symbols as in `radartwin.simulation.curved.tubes`. Import only after a Mitsuba variant is active.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from radartwin.simulation.curved.device import rows, scalars, upload
from radartwin.simulation.curved.tube_grid import TubeGrid


@dataclass(frozen=True)
class TubeSelection:
    """Select the tubes of a grid to trace: whole cells and pieces of divided cells."""

    # (N,) uint32. An index below the number of cells of all poses is a whole cell. A larger index is a piece: an index in the grid that is
    # `pieces` times finer along each axis and extends (pieces - 1)/2 pieces beyond the cells on every side.
    index: np.ndarray
    hat_share: np.ndarray | None = None  # (N,) factor of the tube's hat weight; None if all tubes are whole cells
    in_box: np.ndarray | None = None  # (N,) whether the tube contributes with box weights; None as for hat_share
    pieces: int = 1  # odd number of pieces of a divided cell along each axis


@dataclass
class Tubes:
    """Hold the state of tubes between two hits."""

    index: Any  # of the tube in its grid
    pose: Any
    origin: Any  # of the ray
    direction: Any
    position_du: Any  # derivatives of position and direction along the grid axes
    position_dv: Any
    direction_du: Any
    direction_dv: Any
    weight: Any  # solid angle at the source, or area for a plane wave
    hat_share: Any  # as in TubeSelection
    in_box: Any
    departure: Any  # direction at the source
    field_re: list[Any]  # real and imaginary part of the field vector per frequency node
    field_im: list[Any]
    length: Any  # float64, unfolded length from the source to here
    first: Any  # float64, unfolded length from the source to the first hit
    sequence: Any  # labels of the faces met, see `hits.unpack_labels`
    face: Any = None  # triangle and two barycentric coordinates of the next hit, set by `contact.cast`
    inner_u: Any = None
    inner_v: Any = None

    def evaluate(self, *others: Any) -> None:
        """Evaluate all values and `others` in one kernel."""
        dr.eval(*(value for value in self._values() if value is not None), *others)

    def compacted(self, alive: Any) -> "Tubes":
        """Return the tubes at these lane indices."""

        def pick(value: Any) -> Any:
            if value is None:
                return None
            return [pick(v) for v in value] if isinstance(value, list) else dr.gather(type(value), value, alive)

        return Tubes(*(pick(value) for value in self._values()))

    def _values(self) -> Iterator[Any]:
        return (getattr(self, field.name) for field in fields(self))


def project(axis: Any, direction: Any) -> Any:
    """Return the normalised component of `axis` perpendicular to `direction`."""
    across = axis - direction * dr.dot(axis, direction)
    return across * dr.rsqrt(dr.maximum(dr.squared_norm(across), 1e-12))


def rays(grid: TubeGrid, pose: Any, cell_u: Any, cell_v: Any) -> tuple[Any, Any, Any, Any, Any]:
    """Return origin, direction, two derivatives along the grid axes, and weight of the tubes at grid coordinates.

    A spherical wave has derivatives of the direction and a solid angle as weight. A plane wave has derivatives of the position and an area.
    """
    step_u, step_v = scalars(grid.step_u)(pose), scalars(grid.step_v)(pose)
    u = scalars(grid.low_u)(pose) + cell_u * step_u
    v = scalars(grid.low_v)(pose) + cell_v * step_v
    origin, forward, u_axis, v_axis = (rows(x)(pose) for x in (grid.source, grid.forward, grid.u_axis, grid.v_axis))
    if grid.plane:
        return origin + u_axis * u + v_axis * v, forward, u_axis * step_u, v_axis * step_v, step_u * step_v
    scale = dr.rsqrt(1 + u * u + v * v)
    direction = (forward + u_axis * u + v_axis * v) * scale
    direction_du = (u_axis - direction * dr.dot(direction, u_axis)) * scale * step_u
    direction_dv = (v_axis - direction * dr.dot(direction, v_axis)) * scale * step_v
    return origin, direction, direction_du, direction_dv, step_u * step_v * scale * scale * scale


def start(grid: TubeGrid, axis: np.ndarray, cross: bool, selection: TubeSelection, nodes: int) -> Tubes:
    """Start the selected tubes at their source. Fields lie along the projected antenna axis; `cross` turns them by 90 degrees for H."""
    index = upload(mi.UInt32, selection.index)
    per_pose, count_u = dr.opaque(mi.UInt32, grid.per_pose), dr.opaque(mi.UInt32, grid.count_u)
    cell, size, offset = index, mi.Float(1.0), mi.Float(0.0)
    if selection.hat_share is not None:
        total, margin = grid.poses * grid.per_pose, selection.pieces - 1
        piece = index >= dr.opaque(mi.UInt32, total)
        cell = dr.select(piece, index - dr.opaque(mi.UInt32, total), index)
        fine_u, fine_v = (selection.pieces * count + margin for count in (grid.count_u, grid.count_v))
        per_pose = dr.select(piece, dr.opaque(mi.UInt32, fine_u * fine_v), per_pose)
        count_u = dr.select(piece, dr.opaque(mi.UInt32, fine_u), count_u)
        size = dr.select(piece, dr.opaque(mi.Float, 1 / selection.pieces), size)
        offset = dr.select(piece, dr.opaque(mi.Float, margin / selection.pieces), offset)
    pose = cell // per_pose
    cell = cell - pose * per_pose  # not in place, because `cell` and `index` may be the same array
    cell_v = cell // count_u
    cell_u = cell - cell_v * count_u
    origin, direction, direction_du, direction_dv, weight = rays(
        grid, pose, mi.Float(cell_u) * size - offset, mi.Float(cell_v) * size - offset
    )
    direction_du, direction_dv, weight = direction_du * size, direction_dv * size, weight * size * size
    field = project(rows(axis)(pose), direction)
    if cross:  # H = (direction to the radar) x V, and the ray points away from the radar
        field = dr.cross(-direction, field)
    nothing = dr.zeros(mi.Vector3f, dr.width(index))
    position_du, position_dv = (direction_du, direction_dv) if grid.plane else (mi.Vector3f(nothing), mi.Vector3f(nothing))
    if grid.plane:
        direction_du, direction_dv = mi.Vector3f(nothing), mi.Vector3f(nothing)
    hat_share = None if selection.hat_share is None else upload(mi.Float, selection.hat_share)
    in_box = None if selection.in_box is None else upload(mi.Bool, selection.in_box)
    length = dr.zeros(mi.Float64, dr.width(index))
    field_re, field_im = [mi.Vector3f(field) for _ in range(nodes)], [mi.Vector3f(nothing) for _ in range(nodes)]
    return Tubes(
        index, pose, origin, direction, position_du, position_dv, direction_du, direction_dv, weight, hat_share, in_box,
        mi.Vector3f(direction), field_re, field_im, length, dr.zeros(mi.Float64, dr.width(index)), dr.zeros(mi.UInt64, dr.width(index)),
    )  # fmt: skip
