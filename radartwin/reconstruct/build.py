"""A scan becomes a labelled scene: read or fused, segmented, outlined and completed, one material, saved."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import trimesh

from radartwin.errors import ScanError
from radartwin.io import files
from radartwin.io.progress import Progress
from radartwin.materials import check_name
from radartwin.reconstruct.frames.frames import scan_digest
from radartwin.reconstruct.mesh_file import Axis, Unit, load_scan
from radartwin.reconstruct.outlines.assembly import assembled
from radartwin.reconstruct.outlines.surfaces import flattened as flatten_planes
from radartwin.reconstruct.outlines.visibility import Cameras
from radartwin.reconstruct.scan_folder import save_reconstruction
from radartwin.reconstruct.segmentation.segment import PlanarRegionGrowing, Segmenter
from radartwin.scene.scene import Scene

if TYPE_CHECKING:
    from radartwin.materials import Layered
    from radartwin.reconstruct.frames.frames import Frames


@dataclasses.dataclass(frozen=True, eq=False)
class Scan:
    """A mesh in metres, z up, with what is known of it, what it is a scan of, and the photographs it was made from."""

    mesh: trimesh.Trimesh
    report: dict[str, Any]
    lines: list[str]
    scan_of: str
    frames: Frames | None = None


def reconstruct(
    path: str | Path,
    out: str | Path | None = None,
    *,
    material: str | Layered = "plasterboard",
    unit: Unit = "auto",
    up: Axis = "auto",
    is_object: bool | None = None,
    flatten: bool = True,
    segmenter: Segmenter | None = None,
    depth_model: str | Path | None = None,
    intrinsics: Sequence[float] | None = None,
    depth_unit_m: float | None = None,
    poses: str | None = None,
    progress: Progress | None = None,
) -> Scene:
    """Turn a scan into a scene of named surfaces.

    Args:
        path: .glb, .ply or .obj of a room, or a folder of colour-and-depth frames with poses.
        out: folder for scene.glb and manifest.json, the coloured scan and the photographs; None keeps the scene in memory.
        material: what every surface is labelled as until a material source says better.
        unit, up, is_object: see `radartwin.reconstruct.mesh_file.load_scan`.
        flatten: planar segments become polygons on their planes, gaps completed; without it they stay as scanned.
        segmenter: `PlanarRegionGrowing()` unless given.
        depth_model: weights of a monocular model, for frames without depth.
        intrinsics, depth_unit_m, poses: of frames whose folder does not say, see `Frames.load`.
        progress: says what is being done; silent unless given.
    Returns:
        The scene; its provenance holds the scan report, and how far flattening moved what was scanned.
    Raises:
        MissingError, MeshError, ScanError: the scan, see `load_scan`.
        MaterialError: an unknown material.
        OutputError: `out` cannot be written.
    """
    if isinstance(material, str):
        check_name(material)
    if out is not None:
        files.check_folder(Path(out))
    progress = progress or Progress(quiet=True)
    if Path(path).is_dir():
        if is_object is not None:
            raise ScanError(f"{path}: --object is not read for frames, which show the side that was seen; leave it out")
        if unit != "auto":
            raise ScanError(f"{path}: --unit is not read for frames, whose poses are in metres; --depth-unit is that of their depth")
        scan = _fused(Path(path), up, depth_model, intrinsics, depth_unit_m, poses, progress)
    else:
        of_frames = {"--depth-model": depth_model, "--intrinsics": intrinsics, "--depth-unit": depth_unit_m, "--poses": poses}
        for option in (name for name, value in of_frames.items() if value is not None):
            raise ScanError(f"{path}: {option} is only read for a folder of frames; leave it out for a mesh")
        scan = _read(Path(path), unit, up, is_object, progress)
    for line in scan.lines:
        progress.say(line)
    with progress.task("segmenting", 1) as advance:
        segments = list((segmenter or PlanarRegionGrowing())(scan.mesh))
        advance()
    flattened = None
    if flatten:
        cameras = None if scan.frames is None else _cameras(scan.frames)
        with progress.task("outlining planes", sum(s.normal is not None for s in segments)) as advance:
            flattened = flatten_planes(scan.mesh, segments, cameras, advance)
    surfaces, owner, statistics = assembled(scan.mesh, segments, flattened, material)
    scene = Scene(surfaces, {"source": Path(path).name, "scan_of": scan.scan_of, "scan": scan.report, "flattened": flatten, **statistics})
    if out is not None:
        save_reconstruction(scene, Path(out), scan.mesh, owner, scan.frames, progress)
    return scene


def _read(path: Path, unit: Unit, up: Axis, is_object: bool | None, progress: Progress) -> Scan:
    with progress.task(f"reading {path.name}", 1) as advance:
        mesh, report = load_scan(path, unit, up, is_object)
        advance()
    return Scan(mesh, report.to_dict(), report.lines(), scan_digest([path]))


def _fused(
    path: Path, up: str, model: str | Path | None, intrinsics: Any, unit: float | None, poses: str | None, progress: Progress
) -> Scan:
    from radartwin.reconstruct.from_frames import fused

    mesh, report, lines, frames = fused(path, up, model, progress, intrinsics, unit, poses)
    return Scan(mesh, report, lines, frames.scan_of, frames)


def summary(scene: Scene, rows: int = 30) -> list[str]:
    """A table of the surfaces for people, largest first, and where they lie."""
    order = sorted(scene, key=lambda s: -float(s.mesh.area))
    lines = [f"{'surface':16} {'m2':>8} {'faces':>6} {'kind':>7}  made of"]
    for surface in order[:rows]:
        facts = surface.provenance
        what = (
            "a pane nobody saw"
            if facts.get("completed")
            else f"{facts['planes']} planes"
            if facts.get("planes")
            else "a part that is not flat"
        )
        what = "a plane" if facts.get("planar") and not facts.get("completed") else what
        lines.append(f"{surface.name[:16]:16} {surface.mesh.area:8.2f} {len(surface.mesh.faces):6d} {surface.kind:>7}  {what}")
    if len(order) > rows:
        lines.append(f"and {len(order) - rows} smaller ones, {sum(float(s.mesh.area) for s in order[rows:]):.2f} m2")
    spans = (f"{axis} from {low:.2f} to {high:.2f}" for axis, low, high in zip("xyz", *scene.bounds, strict=True))
    return [*lines, f"it lies at {', '.join(spans)} m; trajectory.position_m is in these coordinates"]


def _cameras(frames: Frames) -> Cameras:
    """The depth pictures' cameras; those of one scan are alike."""
    first = frames[0]
    height, width = first.depth_m.shape
    return Cameras(frames.poses, first.intrinsics, (width, height))
