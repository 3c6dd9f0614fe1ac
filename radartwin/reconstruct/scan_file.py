"""Read the mesh file of a scan: convert the length unit and the up axis, move it near the origin, merge equal vertices, and count defects.

The length unit is never guessed, because a size of 6400 could be 6400 mm for a room or 6400 cm for a hall. For a file of implausible size,
the reader raises an error whose message names the likely unit. The reader determines the up axis from the areas of the faces: a room has
more area of horizontal faces (floor, ceiling, tables) than of faces perpendicular to another axis. If the areas do not show a clear up
axis, +Y is the up axis of a .glb, as glTF 2.0 defines it, and files of other formats need the option `--up`.
"""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import trimesh

from radartwin.errors import ScanError
from radartwin.scene.mesh_checks import check_mesh
from radartwin.scene.mesh_file import METRES, TO_Z_UP, offset_m, read_meshes

Unit = Literal["auto", "m", "cm", "mm", "in", "ft"]
Axis = Literal["auto", "x", "y", "z", "-x", "-y", "-z"]

MIN_EXTENT_M = 0.05  # smaller than any object in the library's catalogue
DEGENERATE_HEIGHT_M = 1e-5  # a thinner triangle has no usable normal in float32
WELD_DIGITS = 6  # vertices closer than 1 um are merged, because exporters double them along seams
OBJECT_M = 1.0  # a smaller mesh is an object, as in radartwin/scene/layouts/stock.py
# Largest length and height of a room. A squash court is 9.75 m long and 5.64 m high, and the atrium is 12 m long. The radar's range is
# unambiguous to 11 m.
LARGE_M, HIGH_M = 15.0, 7.0
ROOM_M, ROOM_HIGH_M = (1.5, LARGE_M), (1.8, HIGH_M)
FLOOR_M = 0.15  # faces at most this far from the lowest or highest point count as floor or ceiling
LEVEL = 0.9  # smallest |z| of the normal of a horizontal face
UP_MARGIN = 1.2  # smallest ratio of the face area perpendicular to the up axis to the largest face area perpendicular to another axis


class ScanWarning(UserWarning):
    """Warn that a scan has an unusual property, although the scan can be read."""


@dataclasses.dataclass(frozen=True)
class ScanReport:
    """Facts about the mesh file of a scan, with lengths in metres.

    Attributes:
        up: axis of the file's coordinates that points up.
        up_from: text that states how the up axis was determined.
        vertices, faces: numbers of vertices and faces in the file, before equal vertices are merged.
        extents_m, area_m2, components, watertight, non_manifold_edges, boundary_edges: properties of the mesh that `load_scan` returns.
        turned: whether the reader inverted the faces, because faces of a room must look inwards and faces of an object outwards.
        offset_m: the coordinates of the scan minus those of the returned mesh, both with z up.
    """

    source: str
    unit: str
    up: str
    up_from: str
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
    offset_m: list[float]
    turned: bool = False
    is_object: bool = False

    def lines(self) -> list[str]:
        """Return the report on the mesh file as lines of text, one fact per line."""
        x, y, z = self.extents_m
        lines = [
            f"{self.source}: {self.vertices} vertices, {self.faces} faces, {self.area_m2:.1f} m2 in "
            f"{self.components} connected parts, {x:.2f} x {y:.2f} x {z:.2f} m",
            f"unit {self.unit}, up axis {self.up} ({self.up_from})",
            f"{self.degenerate_faces} degenerate and {self.duplicate_faces} duplicate faces removed",
            f"{self.non_manifold_edges} non-manifold and {self.boundary_edges} boundary edges"
            + (" (watertight)" if self.watertight else ", left unchanged because reflection does not need a closed mesh"),
        ]
        if self.is_object:
            lines.append("taken as an object that shows its outside (give --no-object if it is a room)")
        if self.turned:
            side = "inwards" if self.is_object else "outwards"
            lines.append(f"its faces looked {side} and were turned; if the scan is mirrored, export it again")
        return lines


def load_scan(
    path: str | Path, unit: Unit = "auto", up: Axis = "auto", is_object: bool | None = None
) -> tuple[trimesh.Trimesh, ScanReport]:
    """Read a mesh file: convert it to metres with z up, merge equal vertices, and remove degenerate and duplicate faces.

    Args:
        unit: length unit of the file's coordinates; "auto" means metres, and an implausible size is then an error.
        is_object: whether the mesh is a single object, whose faces must look outwards, or a room, whose faces must look inwards. Faces with
            the wrong orientation are inverted. With None, a mesh smaller than 1 m counts as a single object.
    Raises:
        MissingError, MeshError: the file does not exist, or is not a readable mesh.
        ScanError: the mesh is empty, contains NaN, has an implausible size, or has no clear up axis.
    """
    path = Path(path)
    if unit not in ("auto", *METRES) or up not in ("auto", *TO_Z_UP):
        raise ScanError(f"--unit {unit} --up {up}: choose --unit auto, {', '.join(METRES)} and --up auto, {', '.join(TO_Z_UP)}")
    mesh, counts = _welded(path, METRES.get(unit, 1.0))
    axis, up_from = _up_axis(mesh, path) if up == "auto" else (up, "as given")
    visual: Any = mesh.visual
    vertices = np.asarray(mesh.vertices) @ TO_Z_UP[axis].T
    offset = offset_m(vertices)
    mesh = trimesh.Trimesh(vertices - offset, mesh.faces, vertex_colors=visual.vertex_colors if visual.defined else None, process=False)
    if is_object is None:
        is_object = bool(mesh.extents.max() < OBJECT_M)
    turned = bool(mesh.is_watertight and mesh.volume < 0) if is_object else _inside_out(mesh)
    if turned:
        mesh.invert()
    if unit == "auto" and not is_object:
        check_size(mesh.extents, str(path), "--unit", {name: m for name, m in METRES.items() if name != "m"})
    uses = np.bincount(mesh.edges_unique_inverse)  # number of faces at each edge
    return mesh, ScanReport(
        source=path.name,
        unit="m" if unit == "auto" else unit,
        up=axis,
        up_from=up_from,
        turned=turned,
        is_object=is_object,
        offset_m=offset.tolist(),
        extents_m=[float(v) for v in mesh.extents],
        area_m2=float(mesh.area),
        non_manifold_edges=int((uses > 2).sum()),
        boundary_edges=int((uses == 1).sum()),
        components=int(mesh.body_count),
        watertight=bool((uses == 2).all()),
        **counts,
    )


def textured_parts(path: Path, report: ScanReport) -> list[trimesh.Trimesh]:
    """Return the meshes of a scan file with their pictures, in the coordinates of the mesh that `load_scan` returns with the report.

    The list is empty if no mesh has a picture.
    """
    parts = list(read_meshes(path).values())
    if not any(getattr(mesh.visual, "kind", None) == "texture" for mesh in parts):
        return []
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = METRES[report.unit] * TO_Z_UP[report.up], -np.array(report.offset_m)
    return [mesh.apply_transform(transform) for mesh in parts]


def _welded(path: Path, unit_m: float) -> tuple[trimesh.Trimesh, dict[str, int]]:
    """Return the file's mesh in metres, without degenerate and duplicate faces, and the numbers of removed elements for the report."""
    meshes = list(read_meshes(path).values())
    vertices, faces = trimesh.util.append_faces([m.vertices for m in meshes], [m.faces for m in meshes])
    if len(faces) == 0:
        raise ScanError(f"{path} holds no triangles ({len(vertices)} vertices); export a mesh, not a point cloud")
    mesh = trimesh.Trimesh(vertices * unit_m, faces, vertex_colors=_colours(meshes), process=False)
    check_mesh(mesh, str(path))
    if (extent := float(mesh.extents.max())) < MIN_EXTENT_M:
        raise ScanError(f"{path} spans only {extent:.3g} m; give the unit of its coordinates, for example --unit ft")
    mesh.merge_vertices(digits_vertex=WELD_DIGITS, merge_tex=True, merge_norm=True)
    degenerate = ~mesh.nondegenerate_faces(height=DEGENERATE_HEIGHT_M)
    duplicate = ~mesh.unique_faces() & ~degenerate
    mesh.update_faces(~(degenerate | duplicate))
    mesh.remove_unreferenced_vertices()
    if len(mesh.faces) == 0:
        raise ScanError(f"{path}: all {len(faces)} faces are degenerate; export the scan again")
    counts = {"vertices": len(vertices), "faces": len(faces)}
    return mesh, counts | {"degenerate_faces": int(degenerate.sum()), "duplicate_faces": int(duplicate.sum())}


def _colours(meshes: list[trimesh.Trimesh]) -> np.ndarray | None:
    """Return the RGBA colours (V, 4) uint8 of all vertices, sampled from pictures where there are any; None if no mesh has a colour."""
    visuals: list[Any] = [mesh.visual for mesh in meshes]
    if not any(visual.defined for visual in visuals):
        return None
    return np.vstack([(visual.to_color() if visual.kind == "texture" else visual).vertex_colors for visual in visuals])


def _inside_out(mesh: trimesh.Trimesh) -> bool:
    """Return whether the faces of a room (z up) look outwards: most floor faces look down, and most ceiling faces look up."""
    area, up = np.asarray(mesh.area_faces), np.asarray(mesh.face_normals)[:, 2]
    z = np.asarray(mesh.triangles_center)[:, 2]
    low, high = np.quantile(z, [0.001, 0.999])
    near_floor, near_ceiling = z < low + FLOOR_M, z > high - FLOOR_M
    right = area[near_floor & (up > LEVEL)].sum() + area[near_ceiling & (up < -LEVEL)].sum()
    wrong = area[near_floor & (up < -LEVEL)].sum() + area[near_ceiling & (up > LEVEL)].sum()
    return bool(wrong > 2 * right)


def check_size(extents_m: Sequence[float], source: str, option: str, units_m: Mapping[str, float]) -> None:
    """Warn about a scan that is too large for a room, and name the length units with which the scan would have the size of a room.

    Args:
        extents_m: length, width and height of the scan in metres (z up).
        option: name of the command-line option that sets the length unit of the scan file.
        units_m: for each value of that option, its length unit divided by the unit with which the scan was read.
    """
    x, y, z = extents_m
    if max(x, y) <= LARGE_M and z <= HIGH_M:
        return
    fits = [
        f"{option} {name} would make it {x * unit:.1f} x {y * unit:.1f} x {z * unit:.1f} m"
        for name, unit in units_m.items()
        if ROOM_M[0] <= max(x, y) * unit <= ROOM_M[1] and ROOM_HIGH_M[0] <= z * unit <= ROOM_HIGH_M[1]
    ]
    text = f"{source} is {x:.1f} x {y:.1f} x {z:.1f} m, large for a room; check {option}"
    warnings.warn("; ".join([text, *fits]), ScanWarning, stacklevel=3)


def _up_axis(mesh: trimesh.Trimesh, path: Path) -> tuple[str, str]:
    """Return the axis with the largest area of faces perpendicular to it, and a text that states how it was determined."""
    facing = np.abs(mesh.face_normals) > np.cos(np.radians(20))
    area = (np.asarray(mesh.area_faces)[:, None] * facing).sum(axis=0)
    order = np.argsort(area)
    if area[order[2]] >= UP_MARGIN * area[order[1]]:
        return "xyz"[order[2]], "found from the horizontal area"
    if path.suffix.lower() == ".glb":
        return "y", "glTF 2.0 defines +Y as up, and no axis has clearly the most area; give --up if it is another axis"
    x, y, z = area
    areas = f"area facing x {x:.1f}, y {y:.1f}, z {z:.1f} m2"
    raise ScanError(f"{path}: no clear up axis ({areas}); give it: --up z, or --up y as phones export")
