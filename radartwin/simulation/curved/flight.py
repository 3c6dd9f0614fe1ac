"""Define the state of ray tubes between two reflections (one Dr.Jit lane per tube) and start the tubes at the transmitter.

`radartwin.simulation.curved.tubes` explains the symbols. Import this module only after a Mitsuba variant is active.
"""

from dataclasses import dataclass, fields, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from radartwin.simulation.curved.borders import CORNERS, PIECES, Pieces
from radartwin.simulation.curved.tube_grid import TubeGrid
from radartwin.simulation.drjit_arrays import upload, vectors

WHOLE = 15  # share of a tube that contributes in all four squares around its centre ray


@dataclass(frozen=True)
class TubeSelection:
    """List the N tubes of a grid to trace, which are whole grid cells or pieces of cells."""

    index: np.ndarray  # (N,) uint32 indices of grid cells, counted over all poses; for a piece, only the pose counts
    # (N,) four bits that tell in which squares around its centre ray a tube contributes: towards (-u, -v), (+u, -v), (-u, +v) and (+u, +v).
    # For piece p of `cut`, the share is (WHOLE + 1)(p + 1). For a narrow tube of a finer grid, at the place of piece p, the four bits are
    # added. None: all tubes contribute in all four squares.
    share: np.ndarray | None = None
    cut: Pieces | None = None


def on_device(grid: TubeGrid) -> Any:
    """Return a grid whose arrays and counts are on the device."""
    places = {name: vectors(getattr(grid, name)) for name in ("source", "forward", "u_axis", "v_axis")}
    steps = {name: upload(mi.Float, getattr(grid, name)) for name in ("low_u", "low_v", "step_u", "step_v")}
    return replace(grid, **places, **steps, **{name: dr.opaque(mi.UInt32, getattr(grid, name)) for name in ("count_u", "count_v")})


@dataclass
class PieceArrays:
    """Hold the pieces of a `TubeSelection` on the device."""

    share: Any  # share of each tube, as in TubeSelection
    centre: Any  # (P x 2,) centroids, as in `borders.Pieces`
    corner: Any  # (P x CORNERS x 2,) corners, as in `borders.Pieces`
    size: Any  # width of a narrow tube, in cells

    @staticmethod
    def of(selection: TubeSelection) -> "PieceArrays | None":
        """Copy the pieces of a selection to the device; None if all tubes are whole cells."""
        if selection.share is None or selection.cut is None:
            return None
        centre, corner = (upload(mi.Float, values) for values in (selection.cut.centre, selection.cut.corner))
        return PieceArrays(upload(mi.UInt32, selection.share), centre, corner, dr.opaque(mi.Float, 1 / PIECES))

    def middles(self, cell: list[Any]) -> list[Any]:
        """Return the coordinates of the tubes' centre rays along both grid axes, which are `cell` for tubes that are no pieces."""
        cut = self.share > WHOLE
        first = 2 * (self.share // (WHOLE + 1) - 1)
        return [dr.select(cut, dr.gather(mi.Float, self.centre, first + i, cut), at) for i, at in enumerate(cell)]

    @staticmethod
    def corners(source: Any, share: Any, cut: Any) -> list[tuple[Any, Any]]:
        """Return the corners of pieces relative to their centre rays, in cells, from the array `source` (`corner`)."""
        first = 2 * CORNERS * (share // (WHOLE + 1) - 1)
        u, v = ([dr.gather(mi.Float, source, first + 2 * k + i, cut) for k in range(CORNERS)] for i in range(2))
        return list(zip(u, v, strict=True))


@dataclass
class Tubes:
    """Hold the state of ray tubes between two hits, with one array entry per tube."""

    index: Any  # index of the tube in its grid
    pose: Any  # index of the sensor pose
    origin: Any  # start point of the tube's centre ray, in metres
    direction: Any  # unit direction of the tube's centre ray
    position_du: Any  # derivative of the ray's position along the grid's u axis, per grid cell
    position_dv: Any  # derivative of the ray's position along the grid's v axis, per grid cell
    direction_du: Any  # derivative of the ray's direction along the grid's u axis, per grid cell
    direction_dv: Any  # derivative of the ray's direction along the grid's v axis, per grid cell
    weight: Any  # solid angle of the tube at the source in steradians, or the tube's area in square metres for a plane wave
    share: Any  # share of the tube, as in TubeSelection; None if all tubes are whole
    departure: Any  # unit direction of the ray at the source
    across: Any  # unit vector across the direction, along which the field's first component lies, see `jones`
    encounters: list[Any]  # facets that the tube has met, as `contact.Encounter`
    caustics: Any  # number of caustics that the tube has passed, each of which turns the phase of the field by 90 degrees
    length: Any  # float64 path length from the source over all hits to the current position, in metres
    first: Any  # float64 path length from the source to the first hit, in metres
    face: Any = None  # index of the triangle that the tube meets next, set by `contact.cast`
    inner_u: Any = None  # first barycentric coordinate of the next hit, set by `contact.cast`
    inner_v: Any = None  # second barycentric coordinate of the next hit, set by `contact.cast`

    def compacted(self, alive: Any) -> "Tubes":
        """Return only the tubes at the lane indices `alive`."""
        return Tubes(*picked([getattr(self, field.name) for field in fields(self)], alive))

    @staticmethod
    def joined(parts: "list[Tubes]") -> "Tubes":
        """Join tubes that have met equally many facets.

        The function writes each part to an opaque offset of the joined arrays, because Dr.Jit would compile a kernel of `dr.concat` anew
        for each number of tubes.
        """
        if len(parts) == 1:
            return parts[0]
        counts = [dr.width(part.index) for part in parts]
        places = [dr.arange(mi.UInt32, count) + dr.opaque(mi.UInt32, sum(counts[:i])) for i, count in enumerate(counts)]

        def join(values: list[Any]) -> Any:
            if values[0] is None:
                return None
            if isinstance(values[0], list | tuple):
                return [join(list(column)) for column in zip(*values, strict=True)]
            if isinstance(values[0], mi.Vector3f):
                return mi.Vector3f(*(join(list(column)) for column in zip(*values, strict=True)))
            whole = dr.empty(type(values[0]), sum(counts))
            for value, place in zip(values, places, strict=True):
                dr.scatter(whole, value, place)
            return whole

        return Tubes(*(join([getattr(part, field.name) for part in parts]) for field in fields(Tubes)))


def picked(value: Any, keep: Any) -> Any:
    """Return arrays at the lane indices `keep`, for an array, None, or nested sequences of these."""
    if isinstance(value, list | tuple):
        return [picked(v, keep) for v in value]
    return None if value is None else dr.gather(type(value), value, keep)


def project(axis: Any, direction: Any) -> Any:
    """Return the component of the vector `axis` perpendicular to the unit vector `direction`, normalised to unit length."""
    across = axis - direction * dr.dot(axis, direction)
    return across * dr.rsqrt(dr.maximum(dr.squared_norm(across), 1e-12))


def rays(grid: Any, pose: Any, cell_u: Any, cell_v: Any) -> tuple[Any, Any, Any, Any, Any]:
    """Compute the centre rays of tubes at the grid coordinates `cell_u` and `cell_v` of a grid from `on_device`.

    Returns:
        Origin and direction of the rays, derivatives along the grid axes u and v, and weights of the tubes. For a spherical wave, the
        derivatives are those of the direction, and the weight is a solid angle. For a plane wave, the derivatives are those of the
        position, and the weight is an area.
    """
    step_u, step_v = dr.gather(mi.Float, grid.step_u, pose), dr.gather(mi.Float, grid.step_v, pose)
    u = dr.gather(mi.Float, grid.low_u, pose) + cell_u * step_u
    v = dr.gather(mi.Float, grid.low_v, pose) + cell_v * step_v
    frame: list[Any] = [dr.gather(mi.Vector3f, x, pose) for x in (grid.source, grid.forward, grid.u_axis, grid.v_axis)]
    origin, forward, u_axis, v_axis = frame
    if grid.plane:
        return origin + u_axis * u + v_axis * v, forward, u_axis * step_u, v_axis * step_v, step_u * step_v
    scale = dr.rsqrt(1 + u * u + v * v)
    direction = (forward + u_axis * u + v_axis * v) * scale
    direction_du = (u_axis - direction * dr.dot(direction, u_axis)) * scale * step_u
    direction_dv = (v_axis - direction * dr.dot(direction, v_axis)) * scale * step_v
    return origin, direction, direction_du, direction_dv, step_u * step_v * scale * scale * scale


def start(grid: Any, axis: Any, cross: bool, index: Any, pieces: PieceArrays | None) -> Tubes:
    """Start tubes of a grid at their source.

    Args:
        grid: grid of tubes for F sensor poses, from `on_device`.
        axis: F antenna axes. The electric field of a tube lies along the projection of the axis perpendicular to its ray.
        cross: whether the electric field is turned by 90 degrees about the ray, for horizontal (H) polarisation.
        index: indices of the tubes to start, as in `TubeSelection`.
        pieces: pieces of cells among these tubes; None if all tubes are whole cells.
    """
    pose = index // grid.per_pose
    cell = index - pose * grid.per_pose
    cell_v = cell // grid.count_u
    cell_u = cell - cell_v * grid.count_u
    at = [mi.Float(cell_u), mi.Float(cell_v)]
    origin, direction, direction_du, direction_dv, weight = rays(grid, pose, *(at if pieces is None else pieces.middles(at)))
    share = None
    if pieces is not None:
        share = mi.UInt32(pieces.share)
        size = dr.select((share > WHOLE) & (share & WHOLE != 0), pieces.size, 1.0)
        direction_du, direction_dv, weight = direction_du * size, direction_dv * size, weight * size * size
    field = project(dr.gather(mi.Vector3f, axis, pose), direction)
    if cross:  # the H vector is the cross product of the direction towards the radar with the V vector; the ray points away from the radar
        field = dr.cross(-direction, field)
    # The result is zero, because no index is 0xFFFFFFFF. It depends on the array `index`, so that it has the width of this array also when
    # Dr.Jit replays a recorded program.
    none = dr.select(index == 0xFFFFFFFF, mi.UInt32(1), mi.UInt32(0))
    nothing = mi.Vector3f(mi.Float(none))
    position_du, position_dv = (direction_du, direction_dv) if grid.plane else (mi.Vector3f(nothing), mi.Vector3f(nothing))
    if grid.plane:
        direction_du, direction_dv = mi.Vector3f(nothing), mi.Vector3f(nothing)
    zero = mi.Float64(none)
    return Tubes(
        index, pose, origin, direction, position_du, position_dv, direction_du, direction_dv, weight, share,
        mi.Vector3f(direction), field, [], none, zero, mi.Float64(zero),
    )  # fmt: skip
