"""A folder of frames becomes a mesh: fused from its depth, or from the depth a monocular model sees in its pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import trimesh

from radartwin.io.progress import Progress
from radartwin.reconstruct.frames.frames import Frames


def fused(
    path: Path,
    up: str,
    depth_model: str | Path | None,
    progress: Progress,
    intrinsics: Sequence[float] | None = None,
    depth_unit_m: float | None = None,
    poses: str | None = None,
) -> tuple[trimesh.Trimesh, dict[str, Any], list[str], Frames]:
    """The mesh, its report as plain values and for people, and the frames at the poses the mesh was fused with.

    Raises:
        MissingError, ScanError, PoseError: the folder or its frames, see `Frames.load` and `check_agreement`.
    """
    from radartwin.reconstruct.frames.agreement import check_agreement
    from radartwin.reconstruct.frames.layouts import layout_of
    from radartwin.reconstruct.frames.plausible import check_size
    from radartwin.reconstruct.fusion.fusion import fuse

    axis = None if up == "auto" else up
    layout = layout_of(path)
    if depth_model is None:
        unturned = "z" if "--up" in layout.reads else None
        asked = (poses or "opencv") if "--poses" in layout.reads else None
        with progress.task("comparing views", 1) as advance:
            seen = Frames.load(path, intrinsics, depth_unit_m, unturned or axis, poses=poses)
            check_agreement(seen, depth_unit_m or layout.unit_m, asked, layout.told_by)
            advance()
    frames = Frames.load(path, intrinsics, depth_unit_m, axis, depth_model is not None, poses)
    scale = "measured"
    if depth_model is not None:
        from radartwin.reconstruct.fusion.monocular import DepthModel, with_depth

        model = DepthModel.load(depth_model)
        frames, scale = with_depth(frames, model), model.scale
    with progress.task(f"fusing {len(frames)} frames") as advance:
        mesh, report = fuse(frames, scale=scale, progress=lambda _, __: advance())
    if depth_unit_m is None:
        check_size(report.extents_m, str(path), "--depth-unit", {})
    if len(report.poses) != len(frames):  # more than fusion takes were thinned out evenly
        frames = frames[:: -(-len(frames) // len(report.poses))]
    return mesh, report.to_dict(), report.lines(), frames.with_poses(report.poses)
