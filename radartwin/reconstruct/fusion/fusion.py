"""Fuse colour-and-depth frames with poses into a mesh, and report the quality of the mesh.

The module `views` computes the weights of the pixels, `alignment` corrects the drift of the poses, `volume` averages the depth, and
`marching` extracts triangles.
"""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import trimesh

from radartwin.errors import ScanError
from radartwin.io.one_line import plural
from radartwin.reconstruct.frames.frames import Frames
from radartwin.reconstruct.fusion.alignment import AlignmentReport, align
from radartwin.reconstruct.fusion.marching import extract
from radartwin.reconstruct.fusion.views import REFERENCE_NOISE_M, Views
from radartwin.reconstruct.fusion.volume import View, Volume
from radartwin.reconstruct.mesh_distance import to_mesh
from radartwin.reconstruct.scan_file import ScanWarning

VOXELS_ACROSS = 450  # number of voxels along the room's diagonal, which gives 2 cm voxels for a diagonal of 9 m
VOXEL_M = (0.01, 0.03)
TRUNCATION_VOXELS = 4
MAX_RANGE_M = 5.0  # range of phone LiDAR, as Apple states it; greater depths are ignored
FAR_SHARE = 0.05  # a larger share of depth pixels beyond MAX_RANGE_M causes a warning
CHECKED_FRAMES = 12  # number of frames in which the share of depth pixels beyond MAX_RANGE_M is determined
MAX_FRAMES = 400  # if there are more frames, every n-th frame is used
SMALLEST_PART_M2 = 0.03  # smaller connected parts of the mesh are removed as flying pixels
RESIDUAL_STEP = 21  # the distance of the depth pixels from the fused surface is computed at every 21st pixel in both directions


@dataclasses.dataclass(frozen=True)
class Holes:
    """The boundary edges and holes of a mesh.

    The longest boundary loop of a connected part is the rim of the part, and all shorter loops are holes.

    Attributes:
        boundary_m: total length of all boundary edges in metres, including rims.
        area_m2: total area of the triangle fans that would close all holes, m2.
        largest_m2: area of the triangle fan that would close the largest hole, m2.
    """

    count: int
    boundary_m: float
    area_m2: float
    largest_m2: float


@dataclasses.dataclass(frozen=True)
class FusionReport:
    """Facts about the fusion of frames into a mesh, with lengths in metres.

    Attributes:
        residual_rms_m, residual_median_m: rms and median distance of the used depth pixels from the fused surface, for pixels within the
            truncation distance.
        explained: fraction (0 to 1) of the used depth pixels that lie within the truncation distance of the fused surface.
        coloured: fraction (0 to 1) of the mesh vertices that a colour picture shows.
        small_parts: number of connected parts of the mesh that were removed because of their small area.
        poses: (N, 4, 4) camera-to-world poses with which the frames were fused.
        alignment: report of the drift correction; None if the drift was not corrected.
        scale: source of the unit of length: "measured" by the depth sensor, or a description of the monocular model.
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
        """Return the report without the poses, as a dictionary of plain values."""
        return dataclasses.asdict(dataclasses.replace(self, poses=np.zeros(0))) | {"poses": None}

    def lines(self) -> list[str]:
        """Return the fusion report as lines of text, one fact per line."""
        x, y, z = self.extents_m
        lines = [
            f"{self.source}: {self.frames_used} of {self.frames} frames fused, voxels of {1000 * self.voxel_m:.0f} mm, scale {self.scale}",
            f"{self.vertices} vertices, {self.faces} faces, {self.area_m2:.1f} m2, {x:.2f} x {y:.2f} x {z:.2f} m",
            f"depth pixels lie {1000 * self.residual_rms_m:.1f} mm rms ({1000 * self.residual_median_m:.1f} mm median) from the surface; "
            f"{100 * self.explained:.1f} % lie within {1000 * self.truncation_m:.0f} mm; {100 * self.coloured:.0f} % of the vertices have "
            "colour",
            f"{plural(self.holes.count, 'hole')}, {self.holes.area_m2:.2f} m2 in all, the largest {self.holes.largest_m2:.2f} m2; "
            f"{self.holes.boundary_m:.1f} m of boundary; {plural(self.small_parts, 'floating part')} removed",
        ]
        if self.alignment is not None and self.alignment.pairs:
            a = self.alignment
            lines.append(
                f"drift: poses moved by up to {1000 * a.largest_shift_m:.0f} mm and {a.largest_turn_deg:.2f} degrees; "
                f"the surfaces in overlapping views are {1000 * a.after_m:.1f} mm apart, before {1000 * a.before_m:.1f} mm"
            )
        return lines


def fuse(
    frames: Frames, voxel_m: float | None = None, refine: bool = True, scale: str = "measured", done: Callable[[], object] = lambda: None
) -> tuple[trimesh.Trimesh, FusionReport]:
    """Fuse frames into a coloured mesh of the surfaces that they show.

    Args:
        frames: frames to fuse; if there are more than MAX_FRAMES, only every n-th frame is used.
        voxel_m: edge length of a voxel in metres; None derives the length from the size of the room, about 2 cm for a diagonal of 9 m.
        refine: whether to correct the drift of the poses before the fusion, with the module `alignment`.
        scale: text for the report that names the source of the unit of length.
        done: function that is called after each frame; the fusion passes over all frames twice.
    Returns:
        The mesh in metres with z up, RGBA vertex colours and triangles that face free space.
        The report of the fusion.
    Raises:
        ScanError: the frames have no usable depth or show no surface, or the room needs more voxels than the memory limit allows.
    Warns:
        ScanWarning: there are more than MAX_FRAMES frames, or more than FAR_SHARE of the depth pixels are beyond MAX_RANGE_M.
    """
    if len(frames) > MAX_FRAMES:
        every = -(-len(frames) // MAX_FRAMES)
        text = f"{len(frames)} frames are over the limit MAX_FRAMES of {MAX_FRAMES}, so only one frame in {every} is used"
        warnings.warn(f"{frames.source}: {text}; reconstruct parts of the scan if it lacks detail", ScanWarning, stacklevel=2)
        frames = frames[::every]
    _warn_of_far_depths(frames)
    views = Views(frames, MAX_RANGE_M)
    low, high, usable = _bounds(views, done)
    alignment = None
    if refine:
        alignment = align(views)
        low, high, usable = _bounds(views, lambda: None)
    volume = _filled_volume(views, low, high, usable, voxel_m, done)
    # A surface is kept only if the standard deviation of its distance is below the truncation distance. A view that measures points behind
    # a wrong surface removes this surface.
    mesh, coloured = extract(volume, (REFERENCE_NOISE_M / volume.truncation_m) ** 2)
    mesh, coloured, removed = without_small_parts(mesh, coloured)
    residual = to_mesh(np.concatenate([_points(views[i], RESIDUAL_STEP) for i in usable]), mesh)
    near = residual[residual < 0.99 * volume.truncation_m]
    return mesh, FusionReport(
        source=frames.source,
        frames=len(frames),
        frames_used=len(usable),
        voxel_m=volume.voxel_m,
        truncation_m=volume.truncation_m,
        blocks=len(volume.blocks),
        vertices=len(mesh.vertices),
        faces=len(mesh.faces),
        area_m2=float(mesh.area),
        extents_m=[float(e) for e in mesh.extents],
        residual_rms_m=float(np.sqrt(np.mean(near**2))) if len(near) else float("nan"),
        residual_median_m=float(np.median(near)) if len(near) else float("nan"),
        explained=len(near) / max(len(residual), 1),
        coloured=float(coloured.mean()),
        small_parts=removed,
        holes=holes(mesh),
        poses=views.poses,
        alignment=alignment,
        scale=scale,
    )


def _warn_of_far_depths(frames: Frames) -> None:
    """Warn if the fusion ignores more than FAR_SHARE of the depth pixels, because they are beyond MAX_RANGE_M."""
    checked = np.unique(np.linspace(0, len(frames) - 1, min(len(frames), CHECKED_FRAMES)).round()).astype(int)
    depths = np.concatenate([depth[depth > 0] for depth in (frames[int(i)].depth_m for i in checked)])
    share = float(np.mean(depths > MAX_RANGE_M)) if len(depths) else 0.0
    if FAR_SHARE < share < 1:  # if all pixels are too far, the fusion raises an error
        text = f"{100 * share:.0f} % of the depth pixels are beyond the limit MAX_RANGE_M of {MAX_RANGE_M:g} m and are ignored"
        warnings.warn(f"{frames.source}: {text}; record the far surfaces from a smaller distance", ScanWarning, stacklevel=3)


def _filled_volume(
    views: Views, low: np.ndarray, high: np.ndarray, usable: list[int], voxel_m: float | None, done: Callable[[], object]
) -> Volume:
    """Average all views into a new signed distance volume between the corners `low` and `high`, and call `done` after each view."""
    if voxel_m is None:
        voxel_m = round(float(np.clip(np.linalg.norm(high - low) / VOXELS_ACROSS, *VOXEL_M)), 3)
    elif not 0.002 <= voxel_m <= 0.5:
        raise ScanError(f"voxel_m={voxel_m:g}: choose 0.002 to 0.5 m; 0.02 suits a room")
    volume = Volume(low, high, voxel_m, TRUNCATION_VOXELS * voxel_m)
    for i in usable:
        volume.mark(views[i])
    volume.allocate()
    for i in range(len(views)):
        volume.integrate(views[i])
        done()
    return volume


def without_small_parts(mesh: trimesh.Trimesh, values: np.ndarray) -> tuple[trimesh.Trimesh, np.ndarray, int]:
    """Remove the connected parts of a mesh that are smaller than SMALLEST_PART_M2, except the largest part.

    Returns:
        The mesh, the `values` (V,) of the remaining vertices, and the number of removed connected parts.
    """
    faces = np.asarray(mesh.faces)
    label = trimesh.graph.connected_component_labels(faces[:, [0, 1, 1, 2]].reshape(-1, 2), len(mesh.vertices))
    area = np.bincount(label[faces[:, 0]], weights=mesh.area_faces, minlength=label.max() + 1)
    large = area >= min(SMALLEST_PART_M2, area.max())
    keep = large[label]
    out = mesh.copy()
    out.update_faces(keep[faces[:, 0]])
    out.update_vertices(keep)
    return out, values[keep], int((~large).sum())


def holes(mesh: trimesh.Trimesh) -> Holes:
    """Count and measure the holes of a mesh.

    >>> sheet = trimesh.creation.box((1, 1, 1))
    >>> holes(sheet).count
    0
    """
    edges = np.asarray(mesh.edges_sorted, dtype=np.int64)
    unique, uses = np.unique(edges, axis=0, return_counts=True)
    boundary = unique[uses == 1]
    if not len(boundary):
        return Holes(0, 0.0, 0.0, 0.0)
    count = len(mesh.vertices)
    ends = np.asarray(mesh.vertices)[boundary]
    length = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    loop, part = (trimesh.graph.connected_component_labels(links, count)[boundary[:, 0]] for links in (boundary, unique))
    perimeter = np.bincount(loop, weights=length)
    sums = np.stack([np.bincount(loop, weights=ends.mean(axis=1)[:, axis] * length) for axis in range(3)], axis=1)
    centre = sums / np.maximum(perimeter, 1e-12)[:, None]
    fan = 0.5 * np.linalg.norm(np.cross(ends[:, 0] - centre[loop], ends[:, 1] - centre[loop]), axis=1)
    area = np.bincount(loop, weights=fan)
    is_hole = perimeter > 0
    part_of_loop = np.zeros(len(perimeter), dtype=np.int64)
    part_of_loop[loop] = part
    for p in np.unique(part):
        loops = np.flatnonzero((part_of_loop == p) & (perimeter > 0))
        is_hole[loops[np.argmax(perimeter[loops])]] = False
    return Holes(int(is_hole.sum()), float(length.sum()), float(area[is_hole].sum()), float(area[is_hole].max(initial=0.0)))


def _bounds(views: Views, done: Callable[[], object]) -> tuple[np.ndarray, np.ndarray, list[int]]:
    """Return the lowest and the highest corner of all depth points, and the indices of the views with any usable depth."""
    low, high, usable = np.full(3, np.inf), np.full(3, -np.inf), []
    for i in range(len(views)):
        seen = _points(views[i], 2)
        done()
        if len(seen):
            usable.append(i)
            low, high = np.minimum(low, seen.min(axis=0)), np.maximum(high, seen.max(axis=0))
    if not usable:
        reason = f"no usable depth within {views.max_range_m:g} m in any of {len(views)} frames"
        raise ScanError(f"{views.frames.source}: {reason}; scan from nearer, or correct --depth-unit")
    return low, high, usable


def _points(view: View, step: int) -> np.ndarray:
    """Return the world points (N, 3) of every step-th depth pixel in both directions, without pixels of weight 0."""
    v, u = np.nonzero(view.weight[::step, ::step])
    u, v = u * step, v * step
    depth = view.depth[v, u].astype(np.float64)
    fx, fy, cx, cy = view.lens
    camera = np.stack([(u - cx) / fx * depth, (v - cy) / fy * depth, depth], axis=1)
    return camera @ view.pose[:3, :3].T + view.pose[:3, 3]
