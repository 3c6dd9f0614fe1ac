"""Turn a scan into a scene: read or fuse the scan, segment it, outline and complete its planes, assign one material, and save the scene.

The scene folder contains scene.glb, manifest.json, photos/*.jpg, photos.json, `scan.ply` (the mesh of the scan before segmentation, in
metres with z up), `scan_surfaces.npy` (for each face of the scan, the index of its surface in the manifest, or -1 if the face belongs to
no surface) and, if the scan is a mesh with pictures, `scan_textured.glb` (the scan with its pictures, which `radartwin label` shows).
"""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from trimesh.exchange.ply import export_ply

from radartwin.errors import OutputError, ScanError
from radartwin.io import files
from radartwin.io.one_line import plural
from radartwin.io.progress import Progress
from radartwin.label.photos import FOLDER, INDEX, TEXTURED, save_photos
from radartwin.materials import Layered, check_name
from radartwin.reconstruct.frames.frames import Frames, scan_digest
from radartwin.reconstruct.frames.layouts import layout_of, load_frames
from radartwin.reconstruct.fusion.agreement import check_agreement
from radartwin.reconstruct.fusion.fusion import fuse
from radartwin.reconstruct.fusion.monocular import DepthModel, with_depth
from radartwin.reconstruct.mesh_distance import farthest_points
from radartwin.reconstruct.outlines.assembly import assembled
from radartwin.reconstruct.outlines.seen_points import Cameras
from radartwin.reconstruct.outlines.surfaces import flattened
from radartwin.reconstruct.scan_file import Axis, Unit, check_size, load_scan, textured_parts
from radartwin.reconstruct.segmentation.segment import segmented
from radartwin.scene.mesh_file import offset_m
from radartwin.scene.scene import Scene
from radartwin.scene.storage import GEOMETRY, MANIFEST, is_scene

MESH_FILE, FACE_SURFACES_FILE = "scan.ply", "scan_surfaces.npy"
SAID_M2 = 0.1  # smallest area that the report names
PHOTOS = 40  # largest number of colour pictures saved in the scene folder
TURN_M = 1.5  # when pictures are selected by camera pose, a shift of this length counts as much as a rotation by one radian


@dataclasses.dataclass(frozen=True)
class ScanOptions:
    """Options for reading a scan. An option that does not apply to the kind of scan (mesh file or frame folder) is an error.

    Attributes:
        up: axis of the scan's coordinates that points up (such as "y"); "auto" determines this axis from the scan.
        unit, is_object: options for a mesh file; `radartwin.reconstruct.scan_file.load_scan` explains them.
        depth_model: name or folder of the weights of a monocular depth model, which estimates the depth of frames without depth pictures.
        intrinsics, depth_unit_m, poses: options for a frame folder; `radartwin.reconstruct.frames.layouts.load_frames` explains them.
    """

    up: Axis = "auto"
    unit: Unit = "auto"
    is_object: bool | None = None
    depth_model: str | Path | None = None
    intrinsics: Sequence[float] | None = None
    depth_unit_m: float | None = None
    poses: str | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class Scan:
    """A scan that was read or fused into a single mesh, in metres with z up.

    Attributes:
        report: facts about the scan, such as its size, as a dictionary that is stored in the scene's provenance.
        lines: the same facts about the scan as lines of text.
        scan_of: identifier of the scanned room (room name or file digest).
        offset_m: (3,) the coordinates of the scan minus those of the mesh; see `radartwin.scene.mesh_file.offset_m`.
        frames: colour-and-depth frames from which the mesh was fused, with their aligned poses; None for a mesh file.
        textured: the meshes of a mesh file with their pictures; empty if the file has none.
    """

    mesh: trimesh.Trimesh
    report: dict[str, Any]
    lines: list[str]
    scan_of: str
    offset_m: np.ndarray
    frames: Frames | None = None
    textured: Sequence[trimesh.Trimesh] = ()


def reconstruct(
    path: str | Path,
    out: str | Path | None = None,
    *,
    options: ScanOptions = ScanOptions(),
    material: str | Layered = "plasterboard",
    progress: Progress | None = None,
) -> Scene:
    """Turn a scan into a scene of named surfaces: planes of walls and furniture, and objects.

    Args:
        path: .glb, .ply or .obj of a room, or a folder of colour-and-depth frames with poses.
        out: folder into which the scene is written; with None, no file is written.
        options: unit, axes, camera and poses of the scan, if its files do not state them.
        material: first material of every surface, until `radartwin label` or the user assigns one to each surface.
        progress: display that shows the steps and the lines of the scan report; None shows nothing.
    Returns:
        The scene. Its provenance holds the scan report and the distances by which flattening moved the scanned faces.
    Raises:
        MissingError, MeshError, ScanError, PoseError: the scan or an option is invalid.
        MaterialError: the material is unknown.
        OutputError: `out` cannot be written, contains the scan, or holds files with the names of scene files that RadarTwin did not write.
    """
    if isinstance(material, str):
        check_name(material)
    if out is not None:
        _check_out(Path(out), Path(path))
    progress = progress or Progress(quiet=True)
    scan = (_from_frames if Path(path).is_dir() else _from_mesh_file)(Path(path), options, progress)
    for line in scan.lines:
        progress.say(line)
    if scan.offset_m.any():
        moved = ", ".join(f"{0 - metres:.0f}" for metres in scan.offset_m)
        progress.say(f"moved by ({moved}) m, because it is far from its origin; poses in its old coordinates move with it")
    with progress.task("segmenting", 1) as advance:
        segments = segmented(scan.mesh)
        advance()
    cameras = None
    if scan.frames is not None:
        first = scan.frames[0]  # all frames of a scan have the same intrinsics and picture size
        cameras = Cameras(scan.frames.poses, first.intrinsics, first.depth_m.shape[::-1])
    flat = flattened(scan.mesh, segments, cameras, lambda planes: progress.over(planes, "outlining planes"))
    surfaces, surface_of_face, statistics = assembled(scan.mesh, flat, material)
    for line in _changes(statistics):
        progress.say(line)
    provenance = {"source": Path(path).name, "scan_of": scan.scan_of, "scan": scan.report, "flattened": True, **statistics}
    scene = Scene(surfaces, provenance | ({"offset_m": scan.offset_m.tolist()} if scan.offset_m.any() else {}))
    if out is not None:
        _save(scene, Path(out), scan, surface_of_face, progress)
    return scene


def _changes(statistics: Mapping[str, Any]) -> Iterator[str]:
    """Yield a line for each way in which the surfaces cover more or less than the scan."""
    closed, hidden = statistics["closed_m2"], statistics["filled_m2"] - statistics["closed_m2"]
    if closed or statistics["panes"]:
        panes = f"{plural(statistics['panes'], 'framed gap')} became panes of glass"
        yield f"closed {closed:.1f} m2 of gaps in which the scan shows nothing; {panes}"
    if hidden > SAID_M2:
        yield f"filled {hidden:.1f} m2 of surfaces behind other surfaces; an opening behind an object is closed, too"
    if statistics["left_out_m2"] > SAID_M2:
        yield f"left out {statistics['left_out_m2']:.1f} m2 of the scan, which no surface covers"


def _check_out(out: Path, scan: Path) -> None:
    """Raise OutputError if the scene cannot be written to `out`, or if it would replace the scan or files that RadarTwin did not write."""
    files.check_folder(out)
    held = [out / name for name in (GEOMETRY, MANIFEST, INDEX, FOLDER, MESH_FILE, TEXTURED, FACE_SURFACES_FILE) if (out / name).exists()]
    if scan.exists() and (scan.resolve().is_relative_to(out.resolve()) or any(path.samefile(scan) for path in held)):
        raise OutputError(f"{out}: the folder contains the scan {scan}; choose another folder for --out")
    # `_save` writes the file of face surfaces first. An interrupted reconstruction therefore leaves this file, but no manifest.
    if held and out / FACE_SURFACES_FILE not in held and not is_scene(out):
        raise OutputError(f"{held[0]}: RadarTwin did not write this file; choose a new or empty folder for --out")


def _from_mesh_file(path: Path, options: ScanOptions, progress: Progress) -> Scan:
    for_frames = {
        "--depth-model": options.depth_model, "--intrinsics": options.intrinsics, "--depth-unit": options.depth_unit_m,
        "--poses": options.poses,
    }  # fmt: skip
    for option in (name for name, value in for_frames.items() if value is not None):
        raise ScanError(f"{path}: {option} applies only to a folder of frames; leave it out for a mesh")
    with progress.task(f"reading {path.name}", 1) as advance:
        mesh, report = load_scan(path, options.unit, options.up, options.is_object)
        textured = textured_parts(path, report)
        advance()
    offset = np.array(report.offset_m)
    return Scan(mesh, dataclasses.asdict(report), report.lines(), scan_digest([path]), offset, textured=textured)


def _from_frames(path: Path, options: ScanOptions, progress: Progress) -> Scan:
    """Fuse a folder of frames into a mesh, with the depth pictures of the folder or with depth estimated by a monocular model."""
    if options.is_object is not None:
        raise ScanError(f"{path}: --object does not apply to frames, which show only the side that the camera saw; leave it out")
    if options.unit != "auto":
        raise ScanError(f"{path}: --unit does not apply to frames, whose poses are in metres; --depth-unit is the unit of their depth")
    up = None if options.up == "auto" else options.up
    layout = layout_of(path)
    if options.depth_model is None:
        any_up = "z" if "--up" in layout.options else up  # the check of unit and pose convention needs no up axis
        convention = (options.poses or "opencv") if "--poses" in layout.options else None
        with progress.task("comparing views", 1) as advance:
            frames, _ = _centred(load_frames(path, options.intrinsics, options.depth_unit_m, any_up, poses=options.poses))
            check_agreement(frames, options.depth_unit_m or layout.unit_m, convention, layout.metadata_file)
            advance()
    loaded = load_frames(path, options.intrinsics, options.depth_unit_m, up, options.depth_model is not None, options.poses)
    frames, offset = _centred(loaded)
    scale = "measured"
    if options.depth_model is not None:
        model = DepthModel.load(options.depth_model)
        frames, scale = with_depth(frames, model), model.scale
    with progress.task(f"fusing {plural(len(frames), 'frame')}") as advance:
        mesh, report = fuse(frames, scale=scale, done=advance)
    if options.depth_unit_m is None:
        check_size(report.extents_m, str(path), "--depth-unit", {})
    if len(report.poses) != len(frames):  # fusion used only every n-th frame
        frames = frames[:: -(-len(frames) // len(report.poses))]
    return Scan(mesh, report.to_dict(), report.lines(), frames.scan_of, offset, frames.with_poses(report.poses))


def _centred(frames: Frames) -> tuple[Frames, np.ndarray]:
    """Move frames that are far from the origin, because depth is fused in single precision. Return also the shift (3,) in metres."""
    offset = offset_m(frames.poses[:, :3, 3])
    return frames.with_poses(frames.poses - np.pad(offset[:, None], ((0, 1), (3, 0)))), offset


def _save(scene: Scene, folder: Path, scan: Scan, surface_of_face: np.ndarray, progress: Progress) -> None:
    """Write the scene, the scan's mesh, the surface index (F,) of each of its faces, and the photographs."""
    files.make_folder(folder)
    files.sweep(folder)
    mesh = bytes(export_ply(scan.mesh, encoding="binary", vertex_normal=False))
    stream = io.BytesIO()
    np.save(stream, surface_of_face)
    try:  # the manifest is removed first and written last: an interrupted write leaves a folder without it, which `Scene.load` rejects
        (folder / MANIFEST).unlink(missing_ok=True)
        for name in (INDEX, TEXTURED):
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot replace the scene in it ({error.strerror}); choose another folder") from error
    files.write_atomically(folder / FACE_SURFACES_FILE, stream.getvalue())
    files.write_atomically(folder / MESH_FILE, mesh)
    if scan.textured:
        textured: Any = trimesh.Scene(list(scan.textured)).export(file_type="glb")
        files.write_atomically(folder / TEXTURED, bytes(textured))
    if scan.frames is not None:
        save_photos(folder, _photos(scan.frames, progress))
    scene.save(folder)


def distinct_views(poses: np.ndarray, count: int) -> list[int]:
    """Return the ascending indices of at most `count` of the poses (N, 4, 4), selected to differ most in position and viewing direction."""
    return sorted(set(farthest_points(np.column_stack([poses[:, :3, 3], TURN_M * poses[:, :3, 2]]), count)))


def _photos(frames: Frames, progress: Progress):
    """Yield up to PHOTOS colour pictures as (colour, pose, intrinsics). Up to 2 PHOTOS frames are read, because some may have no colour."""
    saved = 0
    for i in progress.over(distinct_views(frames.poses, 2 * PHOTOS), "photographs"):
        frame = frames[i]
        if frame.colour is not None and frame.colour_intrinsics is not None and saved < PHOTOS:
            saved += 1
            yield frame.colour, frame.pose, frame.colour_intrinsics


def summary(scene: Scene, rows: int = 30) -> list[str]:
    """Return text lines with a table of the scene's surfaces, sorted by area (largest first), and with the extent of the scene."""
    order = sorted(scene, key=lambda s: -float(s.mesh.area))
    lines = [f"{'surface':16} {'m2':>8} {'faces':>6} {'kind':>7}  shape"]
    for surface in order[:rows]:
        facts = surface.provenance
        flat = "a plane" if facts.get("planar") else plural(facts["planes"], "plane") if facts.get("planes") else "not flat"
        shape = "a pane that the scan missed" if facts.get("completed") else flat
        lines.append(f"{surface.name[:16]:16} {surface.mesh.area:8.2f} {len(surface.mesh.faces):6d} {surface.kind:>7}  {shape}")
    if len(order) > rows:
        lines.append(f"and {plural(len(order) - rows, 'smaller surface')}, {sum(float(s.mesh.area) for s in order[rows:]):.2f} m2")
    spans = (f"{axis} from {low:.2f} to {high:.2f}" for axis, low, high in zip("xyz", *scene.bounds, strict=True))
    return [*lines, f"the scene extends over {', '.join(spans)} m; trajectory.position_m is in these coordinates"]
