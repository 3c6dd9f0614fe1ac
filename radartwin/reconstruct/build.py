"""A scan becomes a labelled scene: read or fused, segmented, outlined and completed, one material, saved."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh

from radartwin import files
from radartwin.materials import check_name
from radartwin.progress import Progress
from radartwin.reconstruct.colour import face_rgb
from radartwin.reconstruct.looks import coloured, painted
from radartwin.reconstruct.mesh_file import Axis, Unit, load_scan
from radartwin.reconstruct.names import segment_names
from radartwin.reconstruct.parts import simplified
from radartwin.reconstruct.scan_folder import save_reconstruction
from radartwin.reconstruct.segment import PlanarRegionGrowing, Segment, Segmenter
from radartwin.reconstruct.surfaces import Flat, flattened
from radartwin.reconstruct.visibility import Cameras
from radartwin.scene.scene import Scene, Surface

if TYPE_CHECKING:
    from radartwin.materials import Layered
    from radartwin.reconstruct.frames import Frames

FRAGMENT_M2 = 0.01  # connected leftovers below this are noise and are left out


@dataclasses.dataclass(frozen=True, eq=False)
class Scan:
    """A mesh in metres, z up, with what is known of it, and the photographs it was made from."""

    mesh: trimesh.Trimesh
    report: dict[str, Any]
    lines: list[str]
    frames: Frames | None = None


def reconstruct(
    path: str | Path,
    out: str | Path | None = None,
    *,
    material: str | Layered = "plasterboard",
    unit: Unit = "auto",
    up: Axis = "auto",
    flatten: bool = True,
    segmenter: Segmenter | None = None,
    depth_model: str | Path | None = None,
    intrinsics: Sequence[float] | None = None,
    depth_unit_m: float | None = None,
    progress: Progress | None = None,
) -> Scene:
    """Turn a scan into a scene of named surfaces.

    Args:
        path: .glb, .ply or .obj of a room, or a folder of colour-and-depth frames with poses.
        out: folder for scene.glb and manifest.json, the coloured scan and the photographs; None keeps the scene in memory.
        material: what every surface is labelled as until a material source says better.
        unit, up: see `radartwin.reconstruct.mesh_file.load_scan`.
        flatten: planar segments become polygons on their planes, gaps completed; without it they stay as scanned.
        segmenter: `PlanarRegionGrowing()` unless given.
        depth_model: weights of a monocular model, for frames without depth.
        intrinsics, depth_unit_m: of frames whose folder does not say, see `Frames.load`.
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
        scan = _fused(Path(path), up, depth_model, intrinsics, depth_unit_m, progress)
    else:
        scan = _read(Path(path), unit, up, progress)
    for line in scan.lines:
        progress.say(line)
    with progress.task("segmenting", 1) as advance:
        segments = list((segmenter or PlanarRegionGrowing())(scan.mesh))
        advance()
    surfaces, owner, statistics = _surfaces(scan, segments, material, flatten, progress)
    scene = Scene(surfaces, {"source": Path(path).name, "scan": scan.report, "flattened": flatten, **statistics})
    if out is not None:
        save_reconstruction(scene, Path(out), scan.mesh, owner, scan.frames, progress)
    return scene


def _read(path: Path, unit: Unit, up: Axis, progress: Progress) -> Scan:
    with progress.task(f"reading {path.name}", 1) as advance:
        mesh, report = load_scan(path, unit, up)
        advance()
    return Scan(mesh, report.to_dict(), report.lines())


def _fused(path: Path, up: str, model: str | Path | None, intrinsics: Any, depth_unit_m: float | None, progress: Progress) -> Scan:
    from radartwin.reconstruct.from_frames import fused

    return Scan(*fused(path, up, model, progress, intrinsics, depth_unit_m))


def summary(scene: Scene, rows: int = 30) -> list[str]:
    """A table of the surfaces for people, largest first."""
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
    return lines


def _surfaces(
    scan: Scan, segments: list[Segment], material: str | Layered, flatten: bool, progress: Progress
) -> tuple[list[Surface], np.ndarray, dict[str, Any]]:
    """Surfaces, the surface each face of the scan went to (-1 none), and statistics."""
    mesh = scan.mesh
    rgb = face_rgb(mesh)
    centre = np.asarray(mesh.triangles_center)
    flats: list[Flat] = []
    statistics: dict[str, Any] = {"flattening_rms_m": 0.0, "flattening_max_m": 0.0}
    if flatten:
        with progress.task("outlining planes", sum(s.normal is not None for s in segments)) as advance:
            done = flattened(mesh, segments, None if scan.frames is None else _cameras(scan.frames), advance)
        flats, segments, statistics = done.flats, done.segments, done.statistics
    names = segment_names(mesh, segments)
    of_segment = {f.segment: f for f in flats if f.segment >= 0}
    owner = np.full(len(mesh.faces), -1, dtype=np.int32)
    surfaces: list[Surface] = []
    errors = [0.0]
    dropped = 0.0
    for members in _things(segments):
        pieces: list[trimesh.Trimesh] = []
        planes = 0
        for k in members:
            piece = None
            at, colours = centre[segments[k].faces], None if rgb is None else rgb[segments[k].faces]
            if k in of_segment:
                flat = of_segment[k]
                piece = (
                    flat.mesh
                    if colours is None
                    else (painted(flat.mesh, flat.grid, at, colours) if len(members) == 1 else coloured(flat.mesh, at, colours))
                )
                planes += 1
            elif segments[k].normal is None and segments[k].area_m2 >= FRAGMENT_M2 and flatten:
                if k == len(segments) - 1 and _is_fragments(mesh, segments[k]):
                    dropped += segments[k].area_m2
                elif (part := simplified(mesh, segments[k].faces)) is not None:
                    piece = part[0] if colours is None else coloured(part[0], at, colours)
                    errors.append(part[1])
            elif not flatten:
                piece = mesh.submesh([segments[k].faces], append=True, repair=False)
            if piece is not None:
                pieces.append(piece)
                owner[segments[k].faces] = len(surfaces)
        if not pieces:
            continue
        first = segments[members[0]]
        facts = _facts(planar=planes == 1 and len(pieces) == 1, planes=planes, segment=members[0])
        facts["area_m2"] = round(sum(segments[k].area_m2 for k in members), 4)
        facts["filled_m2"] = round(sum(of_segment[k].filled_m2 for k in members if k in of_segment), 4)
        whole = pieces[0] if len(pieces) == 1 else trimesh.util.concatenate(pieces)
        role = "room" if first.normal is not None and first.body < 0 else "auto"
        surface = Surface(whole, material, names[members[0]], role=role, provenance=facts)
        surfaces.append(surface.replaced(role=surface.kind))
    for number, flat in enumerate((f for f in flats if f.segment < 0), 1):
        facts = {
            **_facts(planar=True, planes=1, segment=-1),
            "completed": True,
            "area_m2": 0.0,
            "filled_m2": round(flat.filled_m2, 4),
            "parent": names[flat.parent],
        }
        surfaces.append(Surface(flat.mesh, material, f"pane_{number}", role="room", provenance=facts))
    statistics |= {"parts_error_m": max(errors), "fragments_m2": round(dropped, 4), "panes": sum(f.segment < 0 for f in flats)}
    return surfaces, owner, statistics


def _cameras(frames: Frames) -> Cameras:
    """The depth pictures' cameras; those of one scan are alike."""
    first = frames[0]
    height, width = first.depth_m.shape
    return Cameras(frames.poses, first.intrinsics, (width, height))


def _facts(planar: bool, planes: int, segment: int) -> dict[str, Any]:
    label = {"source": "uniform", "confidence": None, "stand_in": False, "minc": None}
    return {**label, "scanned": True, "planar": planar, "planes": planes, "segment": segment, "completed": False}


def _things(segments: Sequence[Segment]) -> list[list[int]]:
    """Segments by body, in the order of their first; each thing's largest plane first."""
    things: dict[tuple[int, int], list[int]] = {}
    for k, segment in enumerate(segments):
        things.setdefault((1, segment.body) if segment.body >= 0 else (0, k), []).append(k)
    return list(things.values())


def _is_fragments(mesh: trimesh.Trimesh, segment: Segment) -> bool:
    """Whether a segment is the gathered noise rather than one part: its faces lie all over."""
    from radartwin.reconstruct.faces import components

    return components(mesh, segment.faces) > 3
