"""Scans that cannot be used are refused in one line. Each row is the error, a part of the message, and the call that is refused."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_files import LFS
from test_frames import arkit, pose_file, stored, wall
from test_fusion import frames
from test_scan_mesh import HALL, field, room, write_glb, write_obj

from radartwin.errors import MeshError, MissingError, PoseError, ScanError
from radartwin.reconstruct.build import ScanOptions, reconstruct
from radartwin.reconstruct.frames.frames import Frame, Frames
from radartwin.reconstruct.frames.layouts import load_frames
from radartwin.reconstruct.fusion import volume
from radartwin.reconstruct.fusion.fusion import fuse
from radartwin.reconstruct.fusion.monocular import with_depth
from radartwin.reconstruct.scan_file import load_scan

Row = tuple[type[Exception], str, Callable[[Path], object]]
CORNERS, FACES = np.array([[0, 0, 0], [1.0, 0, 0], [0, 1, 1]]), [[0, 1, 2]]


def of_mesh(error: type[Exception], message: str, vertices: np.ndarray, faces: Any, **options: Any) -> Row:
    return error, message, lambda folder: load_scan(write_obj(folder / "a.obj", vertices, faces), **options)


def of_file(message: str, name: str, write: Callable[[Path], object]) -> Row:
    def call(folder: Path) -> object:
        write(folder / name)
        return load_scan(folder / name)

    return MeshError, message, call


def of_field(message: str, name: str, error: type[Exception] = MeshError) -> Row:
    return error, message, lambda folder: load_scan(field(name))


def of_folder(error: type[Exception], message: str, make: Callable[[Path], object], **options: Any) -> Row:
    def call(folder: Path) -> object:
        make(folder / "frames")
        return load_frames(folder / "frames", **options)

    return error, message, call


def changed(make: Callable[[Path], Path], name: str, content: bytes | None) -> Callable[[Path], object]:
    return lambda folder: (make(folder) / name).unlink() if content is None else (make(folder) / name).write_bytes(content)


LENS = (40, 40, 15.5, 11.5)


def dark() -> Frames:
    """Return frames that see nothing within 5 m."""
    return Frames.of([Frame(f.name, f.pose, f.intrinsics, f.depth_m + np.float32(6)) for f in frames(count=3)])


ROWS: list[Row] = [
    of_mesh(MeshError, r"a\.obj spans 6000 m.*millimetres.*--unit mm", room().vertices * 1000, room().faces),
    of_mesh(ScanError, r"spans only 0\.006 m", room().vertices, room().faces, unit="mm"),
    of_mesh(MeshError, r"a\.obj: 3 of 3 vertices are NaN", CORNERS * [1, np.nan, 1], FACES),
    of_mesh(MeshError, "all vertices coincide; the mesh is degenerate", 0 * CORNERS + 1, FACES),
    of_mesh(ScanError, r"a\.obj holds no triangles", CORNERS, []),
    of_mesh(ScanError, "all 1 faces are degenerate", CORNERS * [1, 0, 0], FACES),
    of_mesh(ScanError, "--unit yard", CORNERS, FACES, unit="yard"),
    of_mesh(ScanError, r"a\.obj: no clear up axis.*--up z", room(3, 3, 3).vertices, room().faces),
    (MissingError, r"gone\.ply", lambda folder: load_scan(folder / "gone.ply")),
    *(of_field("holds no triangles", name, ScanError) for name in ("mesh/cloud.ply", "mesh2/points.glb", "mesh2/tristrips.ply")),
    *(of_field("lfs.*: it is a Git LFS pointer", f"mesh/lfs.{kind}") for kind in ("glb", "ply", "obj")),
    of_field("needs the glTF extension EXT_meshopt_compression, which RadarTwin does not read; export it without", "mesh/meshopt.glb"),
    of_field("needs the glTF extension EXT_mesh_gpu_instancing", "mesh2/instanced.glb"),
    of_file("is a Git LFS pointer", "pointer.stl", lambda path: path.write_bytes(LFS)),
    of_file(r"empty\.stl", "empty.stl", lambda path: path.write_text("solid nothing\nendsolid nothing\n")),
    of_file("needs the glTF extension VENDOR_points", "a.glb", lambda path: write_glb(path, HALL, extensionsRequired=["VENDOR_points"])),
    of_file("EXT_mesh_gpu_instancing", "a.glb", lambda path: write_glb(path, HALL, extensionsUsed=["EXT_mesh_gpu_instancing"])),
    of_file("has a node with two parents, or a cycle of nodes", "a.glb", lambda path: write_glb(path, HALL, node={"children": [0]})),
    of_file("a face has a corner without a vertex", "a.obj", lambda path: path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 4\n")),
    *(
        (ScanError, f"--{name} does not apply to frames", lambda folder, given=given: reconstruct(stored(folder / "a"), options=given))
        for name, given in (("unit", ScanOptions(unit="mm")), ("object", ScanOptions(is_object=True)))
    ),
    (MissingError, "not a folder", lambda folder: load_frames(folder / "nowhere")),
    of_folder(ScanError, "no frames found", Path.mkdir),
    of_folder(ScanError, "--up up is unknown; choose x, y, z", stored, up="up"),
    of_folder(ScanError, "--poses sideways is unknown; choose opencv, opengl", stored, poses="sideways"),
    of_folder(ScanError, "--intrinsics does not apply because frames.json defines it; leave --", stored, intrinsics=LENS),
    of_folder(ScanError, "--depth-unit does not apply because frames.json defines it; leave --", stored, depth_unit_m=0.001),
    of_folder(ScanError, "--up does not apply because frames.json defines it; leave --", stored, up="y"),
    of_folder(ScanError, "--poses does not apply because frames.json defines it; leave --", stored, poses="opengl"),
    of_folder(ScanError, "--depth-unit 0: give metres", arkit, depth_unit_m=0.0),
    of_folder(ScanError, "--depth-unit does not apply", arkit, depth_unit_m=0.001, colour_only=True),
    of_folder(ScanError, "--depth-unit 1 ", lambda folder: arkit(folder, unit=1.0)),
    of_folder(ScanError, "--depth-unit 0.0002 .* or 0.0001 ", lambda folder: arkit(folder, unit=10_000.0)),
    of_folder(ScanError, r"the depth pictures are empty \(depth_00000\.png and all others\)", lambda folder: arkit(folder, unit=0.0)),
    of_folder(ScanError, r"depth_00001\.png: damaged", changed(arkit, "depth_00001.png", b"\x89PNG\r\n\x1a\n no more")),
    of_folder(ScanError, r"3 frame_N\.json and 2 depth_N\.png; number 00001", changed(arkit, "depth_00001.png", None)),
    of_folder(ScanError, r"frame_00001\.json: no camera", changed(arkit, "frame_00001.json", b"{}")),
    of_folder(PoseError, "00000 mirrors", lambda folder: arkit(folder, flip=-1.0)),
    of_folder(PoseError, "not a rotation", lambda folder: arkit(folder, flip=1.1)),
    of_folder(ScanError, r"frames\.json: damaged", changed(stored, "frames.json", b"{}")),
    of_folder(ScanError, "no poses", changed(stored, "frames.json", None)),
    of_folder(MissingError, r"depth/a\.png", changed(stored, "depth/a.png", None)),
    of_folder(ScanError, "1 pose, 2 depth and 2 colour", lambda path: pose_file(path, ["0 0 0 0 0 0 1"], 2), intrinsics=LENS),
    of_folder(PoseError, "line 1: 7 numbers", lambda path: pose_file(path, ["0 0 0 0 0 1"]), intrinsics=LENS),
    of_folder(PoseError, "length 2", lambda path: pose_file(path, ["0 0 0 0 0 0 2"]), intrinsics=LENS),
    of_folder(ScanError, "give --intrinsics FX FY CX CY", lambda path: pose_file(path, ["0 0 0 0 0 0 1"])),
    of_folder(ScanError, "lie outside the picture", lambda path: pose_file(path, ["0 0 0 0 0 0 1"]), intrinsics=(60, 60, 999, 9)),
    of_folder(ScanError, "no poses", lambda path: pose_file(path, [], 1), intrinsics=LENS),
    (ScanError, "no frames", lambda _: Frames.of([])),
    (ScanError, "same name", lambda _: Frames.of([wall("a"), wall("a")])),
    (ScanError, "1 frame and 2 poses;", lambda _: Frames.of([wall("a")]).with_poses(np.tile(np.eye(4), (2, 1, 1)))),
    (PoseError, "not finite", lambda _: Frames(["0"], wall().pose[None] * np.nan, lambda i: wall())),
    (ScanError, "no usable depth within 5 m", lambda _: fuse(dark())),
    (ScanError, r"pass voxel_m=0\.0[4-9]", lambda _: fuse(frames(count=12), voxel_m=0.03, refine=False)),
    (ScanError, "no frame has colour", lambda _: with_depth(dark(), lambda colour: colour[..., 0])),
]


@pytest.mark.parametrize(("error", "message", "call"), ROWS, ids=[message for _, message, _ in ROWS])
@pytest.mark.filterwarnings("ignore::radartwin.scene.mesh_file.MeshWarning")
def test_a_wrong_scan_is_refused_in_one_line(error, message, call, tmp_path, monkeypatch):
    monkeypatch.setattr(volume, "MAX_BLOCKS", 300)
    with pytest.raises(error, match=message) as caught:
        call(tmp_path)
    assert "\n" not in str(caught.value)
