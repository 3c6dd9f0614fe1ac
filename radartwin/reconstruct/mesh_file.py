"""A scan's mesh file, checked: unit, up axis, defects. What is wrong is counted and reported, or refused.

Units are never guessed: 6400 could be millimetres of a room or centimetres of a hall, so an implausible size is
refused with a hint and the user says which. The up axis is found: a room spreads more area horizontally (floor,
ceiling, tables) than across any other axis, and where that is not clear the user is asked.
"""

from __future__ import annotations

import dataclasses
import warnings
from pathlib import Path
from typing import Any, Literal

import numpy as np
import trimesh

from radartwin.errors import ScanError
from radartwin.reconstruct.axes import TO_Z_UP
from radartwin.reconstruct.frames.plausible import OBJECT_M, check_size
from radartwin.scene.checks import MAX_EXTENT_M, unit_hint
from radartwin.scene.mesh_file import read_meshes

Unit = Literal["auto", "m", "cm", "mm", "in", "ft"]
Axis = Literal["auto", "x", "y", "z", "-x", "-y", "-z"]

METRES = {"auto": 1.0, "m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}

MIN_EXTENT_M = 0.05  # smaller than any object of the catalogue, let alone a room
DEGENERATE_HEIGHT_M = 1e-5  # a sliver thinner than this has no usable normal in float32
WELD_DIGITS = 6  # vertices closer than 1 um are one: exporters double them along seams
FLOOR_M = 0.15  # what lies this close to the lowest or highest point is floor or ceiling
LEVEL = 0.9
MIRRORED = "if the scan is mirrored, export it again"
UP_MARGIN = 1.2  # the up axis must spread this much more area than the next one


@dataclasses.dataclass(frozen=True)
class ScanReport:
    """What a scan file held. Counts of vertices, faces and edges; lengths in metres; see `lines`."""

    source: str
    unit: str
    up: str
    up_found: bool
    vertices: int
    faces: int
    extents_m: list[float]
    area_m2: float
    degenerate_faces: int
    duplicate_faces: int
    non_manifold_edges: int
    boundary_edges: int
    components: int
    watertight: bool
    turned: bool = False
    is_object: bool = False

    def to_dict(self) -> dict[str, Any]:
        return dataclasses.asdict(self)

    def lines(self) -> list[str]:
        """The report for people, one fact a line."""
        x, y, z = self.extents_m
        how = "found from the horizontal area" if self.up_found else "as given"
        return [
            f"{self.source}: {self.vertices} vertices, {self.faces} faces, {self.area_m2:.1f} m2 in "
            f"{self.components} connected parts, {x:.2f} x {y:.2f} x {z:.2f} m",
            f"unit {self.unit}, up axis {self.up} ({how})",
            f"{self.degenerate_faces} degenerate and {self.duplicate_faces} duplicate faces removed",
            f"{self.non_manifold_edges} non-manifold and {self.boundary_edges} boundary edges"
            + (" (watertight)" if self.watertight else ", left as they are: reflection does not need a closed mesh"),
            *(["taken as an object, seen from outside (--no-object if it is a room)"] if self.is_object else []),
            *([f"its faces looked {'inwards' if self.is_object else 'outwards'} and were turned; {MIRRORED}"] if self.turned else []),
        ]


def load_scan(
    path: str | Path, unit: Unit = "auto", up: Axis = "auto", is_object: bool | None = None
) -> tuple[trimesh.Trimesh, ScanReport]:
    """Read, convert to metres with z up, weld, and remove what cannot reflect.

    Args:
        path: .glb, .ply or .obj.
        unit: of the file's coordinates; "auto" takes metres and refuses what cannot be.
        up: the file's up axis; "auto" finds it.
        is_object: an object shows its outside, a room its inside, and what does the opposite is turned; None takes what is smaller than
            a metre for an object.
    Returns:
        The mesh (vertices welded, degenerate and duplicate faces gone) and what was found on the way.
    Raises:
        MissingError, MeshError: no such file, or not a readable mesh.
        ScanError: empty, NaN, an implausible size, no clear up axis.
    """
    path = Path(path)
    if unit not in METRES or up not in ("auto", *TO_Z_UP):
        raise ScanError(f"--unit {unit} --up {up}: choose --unit {', '.join(METRES)} and --up auto, {', '.join(TO_Z_UP)}")
    meshes = list(read_meshes(path).values())
    vertices, faces = _stacked(meshes)
    if len(vertices) == 0 or len(faces) == 0:
        raise ScanError(f"{path} holds no triangles ({len(vertices)} vertices); export a mesh, not a point cloud")
    bad = int((~np.isfinite(vertices).all(axis=1)).sum())
    if bad:
        raise ScanError(f"{path}: {bad} of {len(vertices)} vertices are NaN or infinite; export the scan again")
    vertices = vertices * METRES[unit]
    _check_size(path, float(np.ptp(vertices[faces.reshape(-1)], axis=0).max()))

    mesh = trimesh.Trimesh(vertices, faces, vertex_colors=_colours(meshes, path), process=False)
    mesh.merge_vertices(digits_vertex=WELD_DIGITS, merge_tex=True, merge_norm=True)
    degenerate = _heights(mesh) < DEGENERATE_HEIGHT_M
    duplicate = _duplicates(np.asarray(mesh.faces)) & ~degenerate
    mesh.update_faces(~(degenerate | duplicate))
    mesh.remove_unreferenced_vertices()
    if len(mesh.faces) == 0:
        raise ScanError(f"{path}: all {len(faces)} faces are degenerate; export the scan again")
    axis = _up_axis(mesh, path) if up == "auto" else up
    visual: Any = mesh.visual
    colours = visual.vertex_colors if visual.defined else None
    mesh = trimesh.Trimesh(np.asarray(mesh.vertices) @ TO_Z_UP[axis].T, mesh.faces, vertex_colors=colours, process=False)
    if is_object is None:
        is_object = bool(mesh.extents.max() < OBJECT_M)
    turned = _hollow(mesh) if is_object else inside_out(mesh)
    if turned:
        mesh.invert()
    if unit == "auto" and not is_object:
        check_size(mesh.extents, str(path), "--unit", {name: m for name, m in METRES.items() if name not in ("auto", "m")})
    return mesh, ScanReport(
        source=path.name,
        unit="m" if unit == "auto" else unit,
        up=axis,
        up_found=up == "auto",
        vertices=len(vertices),
        faces=len(faces),
        degenerate_faces=int(degenerate.sum()),
        duplicate_faces=int(duplicate.sum()),
        turned=turned,
        is_object=is_object,
        **topology(mesh),
    )


def topology(mesh: trimesh.Trimesh) -> dict[str, Any]:
    """What a report says of the mesh itself: extents, area, edges, parts."""
    _, uses = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
    return {
        "extents_m": [float(v) for v in mesh.extents],
        "area_m2": float(mesh.area),
        "non_manifold_edges": int((uses > 2).sum()),
        "boundary_edges": int((uses == 1).sum()),
        "components": int(mesh.body_count),
        "watertight": bool((uses == 2).all()),
    }


def _colours(meshes: list[trimesh.Trimesh], path: Path) -> np.ndarray | None:
    """RGBA of all vertices (V, 4) uint8, textures looked up at them; None unless every mesh has colours.

    A texture that is not there is said once, and leaves the scan without colours.
    """
    colours = []
    for mesh in meshes:
        visual: Any = mesh.visual
        if visual.kind == "texture":
            material = visual.material
            image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
            if image is None or visual.uv is None:
                if visual.uv is not None:
                    warnings.warn(f"{path}: its texture is not there, so the scan has no colours; put the picture beside it", stacklevel=3)
                return None
            visual = visual.to_color()
        if visual.kind not in ("vertex", "face"):
            return None
        colours.append(np.asarray(visual.vertex_colors))
    return np.vstack(colours) if colours else None


def inside_out(mesh: trimesh.Trimesh) -> bool:
    """Whether a room (z up) shows its outside: what lies lowest should look up, what lies highest down."""
    area, up = np.asarray(mesh.area_faces), np.asarray(mesh.face_normals)[:, 2]
    z = np.asarray(mesh.triangles_center)[:, 2]
    low, high = np.quantile(z, [0.001, 0.999])
    near_floor, near_ceiling = z < low + FLOOR_M, z > high - FLOOR_M
    right = area[near_floor & (up > LEVEL)].sum() + area[near_ceiling & (up < -LEVEL)].sum()
    wrong = area[near_floor & (up < -LEVEL)].sum() + area[near_ceiling & (up > LEVEL)].sum()
    return bool(wrong > 2 * right)


def _hollow(mesh: trimesh.Trimesh) -> bool:
    """Whether a closed mesh shows its inside: by the sign of its volume. An open one looks as its file says."""
    return bool(mesh.is_watertight and mesh.volume < 0)


def _stacked(meshes: list[trimesh.Trimesh]) -> tuple[np.ndarray, np.ndarray]:
    offsets = np.cumsum([0] + [len(m.vertices) for m in meshes])
    vertices = [np.asarray(m.vertices, dtype=np.float64) for m in meshes]
    faces = [np.asarray(m.faces) + offset for m, offset in zip(meshes, offsets, strict=False)]
    return np.vstack([np.zeros((0, 3)), *vertices]), np.vstack([np.zeros((0, 3), dtype=int), *faces])


def _check_size(path: Path, extent: float) -> None:
    if extent > MAX_EXTENT_M:
        raise ScanError(f"{path} spans {extent:.4g} m, over the limit of {MAX_EXTENT_M:.0f} m; {unit_hint(extent)}")
    if extent == 0:
        raise ScanError(f"{path} is degenerate: all its corners coincide, so no unit makes it a scan; export it again")
    if extent < MIN_EXTENT_M:
        raise ScanError(f"{path} spans only {extent:.3g} m; say which unit it is in, for example --unit ft")


def _heights(mesh: trimesh.Trimesh) -> np.ndarray:
    """Smallest height of each triangle (F,), metres; zero where corners coincide."""
    triangles = np.asarray(mesh.triangles)
    longest = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2).max(axis=1)
    return 2 * np.asarray(mesh.area_faces) / np.maximum(longest, 1e-12)


def _duplicates(faces: np.ndarray) -> np.ndarray:
    """Which faces (F,) repeat the corners of an earlier one, in any order."""
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    repeated = np.ones(len(faces), dtype=bool)
    repeated[first] = False
    return repeated


def _up_axis(mesh: trimesh.Trimesh, path: Path) -> Literal["x", "y", "z"]:
    """The axis most of the axis-aligned area faces along: floors and ceilings outweigh any pair of walls."""
    facing = np.abs(mesh.face_normals) > np.cos(np.radians(20))
    area = (np.asarray(mesh.area_faces)[:, None] * facing).sum(axis=0)
    order = np.argsort(area)
    if area[order[2]] < UP_MARGIN * area[order[1]]:
        x, y, z = area
        raise ScanError(
            f"{path}: no clear up axis (area facing x {x:.1f}, y {y:.1f}, z {z:.1f} m2); say which: --up z, or --up y as phones export"
        )
    return ("x", "y", "z")[int(order[2])]
