"""Frames with poses become a mesh: a truncated signed distance volume, marching cubes, and figures of how good it is.

`fuse` is the whole road. Its parts: `views` (what a pixel is worth), `alignment` (drift), `volume` (averaging), `marching` (triangles),
`holes` (what is missing).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import trimesh

from radartwin.errors import ScanError
from radartwin.reconstruct.frames.frames import Frames
from radartwin.reconstruct.fusion.alignment import AlignmentReport, align
from radartwin.reconstruct.fusion.holes import Holes, holes
from radartwin.reconstruct.fusion.marching import extract, painted, vertex_colours
from radartwin.reconstruct.fusion.views import REFERENCE_NOISE_M, Views
from radartwin.reconstruct.fusion.volume import View, Volume

VOXELS_ACROSS = 450  # along the room's diagonal: 2 cm for 9 m
VOXEL_M = (0.01, 0.03)
TRUNCATION_VOXELS = 4
MAX_RANGE_M = 5.0  # of phone LiDAR, as Apple states it
MAX_FRAMES = 400  # more are thinned out evenly
SMALLEST_PART_M2 = 0.03  # a connected part with less area floats: a flying pixel, not a cup
RESIDUAL_STEP = 7  # every seventh pixel of every view is enough for the residual


@dataclasses.dataclass(frozen=True)
class FusionReport:
    """What fusion did and how well; lengths in metres.

    Attributes:
        residual_rms_m, residual_median_m: distance of the used depth pixels from the fused surface; the pixels within the truncation.
        explained: share of the used depth pixels that lie within the truncation of the surface.
        coloured: share of the vertices that some colour picture saw.
        small_parts: connected parts removed.
        poses: (N, 4, 4) of the frames as fused: `frames.with_poses(report.poses)` shows the mesh where it is.
        alignment: how drift was taken out, None where it was not tried.
        scale: where the unit of length comes from: "measured" by the depth sensor, or what a monocular model says.
    """

    source: str
    frames: int
    frames_used: int
    voxel_m: float
    truncation_m: float
    blocks: int
    vertices: int
    faces: int
    area_m2: float
    extents_m: list[float]
    residual_rms_m: float
    residual_median_m: float
    explained: float
    coloured: float
    small_parts: int
    holes: Holes
    poses: np.ndarray
    alignment: AlignmentReport | None = None
    scale: str = "measured"

    def to_dict(self) -> dict[str, Any]:
        """Plain values, without the poses."""
        return dataclasses.asdict(dataclasses.replace(self, poses=np.zeros(0))) | {"poses": None}

    def lines(self) -> list[str]:
        """The report for people, one fact a line."""
        x, y, z = self.extents_m
        moved = self.alignment
        drift = []
        if moved is not None and moved.pairs:
            drift = [
                f"drift: poses moved by up to {1000 * moved.largest_shift_m:.0f} mm and {moved.largest_turn_deg:.2f} degrees; "
                f"overlapping views lie {1000 * moved.after_m:.1f} mm apart, {1000 * moved.before_m:.1f} mm before"
            ]
        return [
            f"{self.source}: {self.frames_used} of {self.frames} frames fused, voxels of {1000 * self.voxel_m:.0f} mm, scale {self.scale}",
            f"{self.vertices} vertices, {self.faces} faces, {self.area_m2:.1f} m2, {x:.2f} x {y:.2f} x {z:.2f} m",
            f"depth lies {1000 * self.residual_rms_m:.1f} mm rms ({1000 * self.residual_median_m:.1f} mm median) from the surface, "
            f"which explains {100 * self.explained:.1f} % of it; {100 * self.coloured:.0f} % of the vertices have colour",
            f"{self.holes.count} holes, {self.holes.area_m2:.2f} m2 in all, the largest {self.holes.largest_m2:.2f} m2; "
            f"{self.holes.boundary_m:.1f} m of boundary; {self.small_parts} floating parts removed",
            *drift,
        ]


def fuse(
    frames: Frames,
    voxel_m: float | None = None,
    max_range_m: float = MAX_RANGE_M,
    refine: bool = True,
    max_faces: int | None = None,
    scale: str = "measured",
    progress: Callable[[int, int], None] | None = None,
) -> tuple[trimesh.Trimesh, FusionReport]:
    """A coloured mesh of what the frames show.

    Args:
        frames: depth with poses; colour and confidence are used where they are there. Of more than MAX_FRAMES every n-th is taken.
        voxel_m: edge of a voxel; about 2 cm, by the room's size, unless given.
        max_range_m: depth beyond it is ignored.
        refine: take the drift out of the poses first, see `alignment`.
        max_faces: simplify to at most so many triangles (quadric error), colours carried over.
        scale: where lengths come from, for the report.
        progress: called with (done, of) after every frame of either pass.
    Returns:
        The mesh, in metres, z up, vertex colours RGBA, triangles facing free space; and the report.
    Raises:
        ScanError: nothing to fuse, no surface, or a room too large for the voxels.
    """
    if len(frames) > MAX_FRAMES:
        frames = frames[:: -(-len(frames) // MAX_FRAMES)]
    views = Views(frames, max_range_m)
    steps = 2 * len(views)
    low, high, used = _bounds(views, lambda i: progress(i, steps) if progress else None)
    alignment = None
    if refine:
        alignment = align(views)
        low, high, used = _bounds(views, lambda _: None)
    if voxel_m is None:
        voxel_m = round(float(np.clip(np.linalg.norm(high - low) / VOXELS_ACROSS, *VOXEL_M)), 3)
    elif not 0.002 <= voxel_m <= 0.5:
        raise ScanError(f"voxel_m={voxel_m:g}: choose 0.002 to 0.5 m; 0.02 suits a room")
    volume = Volume(low, high, voxel_m, TRUNCATION_VOXELS * voxel_m)
    for i in used:
        volume.mark(views[i])
    blocks = volume.allocate()
    for i, view in enumerate(views.coloured()):
        volume.integrate(view)
        if progress:
            progress(len(views) + i + 1, steps)

    # A surface less sure than the truncation is none; what is wrong is carved away by those that see through it.
    mesh, coloured = extract(volume, (REFERENCE_NOISE_M / volume.truncation_m) ** 2)
    mesh, coloured, removed = without_small_parts(mesh, coloured)
    residual = np.concatenate([_residual(volume, views[i]) for i in used])
    near = residual[np.isfinite(residual) & (np.abs(residual) < 0.99 * volume.truncation_m)]
    if max_faces is not None and len(mesh.faces) > max_faces:
        mesh = simplified(mesh, max_faces)
    report = FusionReport(
        source=frames.source,
        frames=len(frames),
        frames_used=len(used),
        voxel_m=voxel_m,
        truncation_m=volume.truncation_m,
        blocks=blocks,
        vertices=len(mesh.vertices),
        faces=len(mesh.faces),
        area_m2=float(mesh.area),
        extents_m=[float(e) for e in mesh.extents],
        residual_rms_m=float(np.sqrt(np.mean(near**2))) if len(near) else float("nan"),
        residual_median_m=float(np.median(np.abs(near))) if len(near) else float("nan"),
        explained=len(near) / max(len(residual), 1),
        coloured=float(coloured.mean()),
        small_parts=removed,
        holes=holes(mesh),
        poses=views.poses,
        alignment=alignment,
        scale=scale,
    )
    return mesh, report


def without_small_parts(mesh: trimesh.Trimesh, kept_along: np.ndarray) -> tuple[trimesh.Trimesh, np.ndarray, int]:
    """The mesh without connected parts under SMALLEST_PART_M2, the values (V,) of its vertices, and how many parts went.

    The largest part stays whatever its size.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    faces, count = np.asarray(mesh.faces), len(mesh.vertices)
    links = coo_matrix((np.ones(2 * len(faces), bool), (faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel())), (count, count))
    parts, label = connected_components(links, directed=False)
    area = np.bincount(label[faces[:, 0]], weights=mesh.area_faces, minlength=parts)
    large = area >= min(SMALLEST_PART_M2, area.max())
    keep = large[label]
    number = np.cumsum(keep) - 1
    out = trimesh.Trimesh(np.asarray(mesh.vertices)[keep], number[faces[keep[faces[:, 0]]]], process=False)
    return painted(out, vertex_colours(mesh)[keep]), kept_along[keep], int(parts - large.sum())


def simplified(mesh: trimesh.Trimesh, max_faces: int) -> trimesh.Trimesh:
    """At most `max_faces` triangles by quadric error metrics; each vertex takes the colour of the nearest one before."""
    from scipy.spatial import KDTree

    fewer = mesh.simplify_quadric_decimation(face_count=max_faces)
    _, nearest = KDTree(mesh.vertices).query(fewer.vertices)
    return painted(trimesh.Trimesh(fewer.vertices, fewer.faces, process=False), vertex_colours(mesh)[nearest])


def _bounds(views: Views, done: Callable[[int], None]) -> tuple[np.ndarray, np.ndarray, list[int]]:
    """Lowest and highest corner of what the views see, and which of them see anything."""
    low, high, used = np.full(3, np.inf), np.full(3, -np.inf), []
    for i in range(len(views)):
        seen = _points(views[i], 2)
        done(i + 1)
        if len(seen):
            used.append(i)
            low, high = np.minimum(low, seen.min(axis=0)), np.maximum(high, seen.max(axis=0))
    if not used:
        raise ScanError(
            f"{views.frames.source}: no depth within {views.max_range_m:g} m that can be trusted in any of {len(views)} frames; "
            "is it a scan of a room?"
        )
    return low, high, used


def _points(view: View, step: int) -> np.ndarray:
    """World points (N, 3) of every step-th trusted pixel."""
    v, u = np.nonzero(view.weight[::step, ::step])
    u, v = u * step, v * step
    depth = view.depth[v, u].astype(np.float64)
    k = view.intrinsics
    camera = np.stack([(u - k[0, 2]) / k[0, 0] * depth, (v - k[1, 2]) / k[1, 1] * depth, depth], axis=1)
    return camera @ view.pose[:3, :3].T + view.pose[:3, 3]


def _residual(volume: Volume, view: View) -> np.ndarray:
    return volume.distance(_points(view, RESIDUAL_STEP))[0]
