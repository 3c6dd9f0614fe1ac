"""Build the surfaces of a scene from the segments of a scan and their polygons: one surface per object, with name,
colours and provenance.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import fast_simplification
import numpy as np
import scipy.sparse as sp
import trimesh
from PIL import Image
from scipy.spatial import KDTree
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from radartwin.materials import Layered
from radartwin.reconstruct.mesh_distance import Nearest, spread, to_mesh
from radartwin.reconstruct.outlines.surfaces import Flat, Flattened
from radartwin.reconstruct.segmentation.bodies import LEVEL, UPRIGHT
from radartwin.reconstruct.segmentation.colour import face_rgb
from radartwin.reconstruct.segmentation.face_arrays import Segment
from radartwin.reconstruct.segmentation.grid import Grid
from radartwin.reconstruct.segmentation.masks import nearest
from radartwin.scene.scene import Surface

MIN_PART_M2 = 0.01  # segments with a smaller area are omitted from the scene
MIN_WALL_M2 = 1.0  # a smaller upright plane is furniture
MISSING_M = 0.05  # scanned points farther than this from every surface count as missing; noise and simplification shift points by less
LARGEST_PX = 1024  # largest width and height of a texture
FACE_M2 = 0.003  # area per face after simplification, which gives triangles of 8 cm
MIN_FACES, MAX_FACES = 24, 600
ERROR_M = 0.03  # 95 % of the scanned vertices must lie within this distance of the simplified mesh
TRIES = 4


def assembled(mesh: trimesh.Trimesh, flattened: Flattened, material: str | Layered) -> tuple[list[Surface], np.ndarray, dict[str, Any]]:
    """Build the surfaces of a segmented scan, all with the same material.

    Returns:
        The surfaces.
        The surface index (F,) int32 of each face of the scan; -1 for a face without a surface.
        A dictionary of statistics, in which `left_out_m2` is the area of the scan that lies farther than MISSING_M from every surface.
    """
    segments = flattened.segments
    names = segment_names(mesh, segments)
    surface_of_face = np.full(len(mesh.faces), -1, dtype=np.int32)
    surfaces: list[Surface] = []
    flats, rgb, error_m = {flat.segment: flat for flat in flattened.flats}, face_rgb(mesh), 0.0
    for members in _objects(segments):
        pieces = {k: _piece(mesh, segments[k], flats.get(k), rgb, len(members) == 1) for k in members}
        error_m = max(error_m, *(error for _, error in pieces.values()))
        made = {k: piece for k, (piece, _) in pieces.items() if piece is not None}
        if not made:
            continue
        first = segments[members[0]]
        planes = sum(segments[k].normal is not None for k in made)
        facts = _facts(planar=planes == len(made) == 1, planes=planes, segment=members[0])
        facts["area_m2"] = round(sum(segments[k].area_m2 for k in made), 4)
        facts["filled_m2"] = round(sum((flats[k].filled_m2 for k in made if k in flats), 0.0), 4)
        whole: Any = next(iter(made.values())) if len(made) == 1 else trimesh.util.concatenate(list(made.values()))
        bounds = first.normal is not None and first.body < 0
        surface = Surface(whole, material, names[members[0]], role="room" if bounds else "auto", provenance=facts)
        for k in made:
            surface_of_face[segments[k].faces] = len(surfaces)
        surfaces.append(surface.replaced(role=surface.kind))
    panes = [f for f in flattened.flats if f.segment < 0]
    for number, flat in enumerate(panes, 1):
        facts = _facts(planar=True, planes=1, segment=-1)
        facts |= {"completed": True, "area_m2": 0.0, "filled_m2": round(flat.filled_m2, 4), "parent": names[flat.parent]}
        surfaces.append(Surface(flat.mesh, material, f"pane_{number}", role="room", provenance=facts))
    left_out = {"parts_error_m": error_m, "left_out_m2": round(_missing_m2(mesh, surfaces), 4), "panes": len(panes)}
    return surfaces, surface_of_face, {**flattened.statistics, **left_out}


def _missing_m2(mesh: trimesh.Trimesh, surfaces: Sequence[Surface]) -> float:
    """Return the area in m2 of the scan farther than MISSING_M from every surface, such as fragments, trimmed edges and thin parts."""
    if not surfaces:
        return float(mesh.area)
    points = spread(mesh, MISSING_M)[0]
    away = Nearest([s.mesh for s in surfaces], MISSING_M)(points)[0]
    return float(mesh.area) * float((away > MISSING_M).mean())


def _piece(
    mesh: trimesh.Trimesh, segment: Segment, flat: Flat | None, rgb: np.ndarray | None, alone: bool
) -> tuple[trimesh.Trimesh | None, float]:
    """Return a segment's polygon, textured if it is alone in its object, or its simplified part of the scan with its error in metres."""
    at, colours = np.asarray(mesh.triangles_center)[segment.faces], None if rgb is None else rgb[segment.faces]
    if segment.normal is not None:
        if flat is None or colours is None:
            return None if flat is None else flat.mesh, 0.0
        return painted(flat.mesh, flat.grid, at, colours, flat.seen) if alone else coloured(flat.mesh, at, colours), 0.0
    if segment.noise or segment.area_m2 < MIN_PART_M2 or (part := simplified(mesh, segment.faces)) is None:
        return None, 0.0
    return part[0] if colours is None else coloured(part[0], at, colours), part[1]


def _facts(planar: bool, planes: int, segment: int) -> dict[str, Any]:
    label = {"source": "uniform", "confidence": None, "stand_in": False, "minc": None}
    return {**label, "scanned": True, "planar": planar, "planes": planes, "segment": segment, "completed": False}


def _objects(segments: Sequence[Segment]) -> list[list[int]]:
    """Group the indices of the segments by object (`Segment.body`), in the order of the first segment of each object."""
    objects: dict[tuple[int, int], list[int]] = {}
    for k, segment in enumerate(segments):
        objects.setdefault((1, segment.body) if segment.body >= 0 else (0, k), []).append(k)
    return list(objects.values())


def segment_names(mesh: trimesh.Trimesh, segments: Sequence[Segment]) -> list[str]:
    """Name each segment by its geometry: floor, ceiling, wall_1, level_1, plane_1, part_1, numbered in the order of the segments.

    The floor is the largest level plane that faces up. The ceiling is the largest level plane above the floor that faces down.
    """
    names: list[str] = [""] * len(segments)
    order = sorted(range(len(segments)), key=lambda k: -segments[k].area_m2)
    centre = np.asarray(mesh.triangles_center)[:, 2]
    heights = [float(centre[s.faces].mean()) for s in segments]
    vertical = [0.0 if s.normal is None else float(s.normal[2]) for s in segments]
    below = -np.inf
    if (floor := next((k for k in order if vertical[k] > LEVEL), None)) is not None:
        names[floor], below = "floor", heights[floor]
    if (ceiling := next((k for k in order if vertical[k] < -LEVEL and heights[k] > below), None)) is not None:
        names[ceiling] = "ceiling"
    counts: Counter[str] = Counter()
    for k, segment in enumerate(segments):
        if not names[k]:
            kind = _kind(segment, vertical[k])
            counts[kind] += 1
            names[k] = f"{kind}_{counts[kind]}"
    return names


def _kind(segment: Segment, vertical: float) -> str:
    if segment.normal is None:
        return "part"
    if abs(vertical) > LEVEL:
        return "level"
    return "wall" if abs(vertical) < UPRIGHT and segment.area_m2 >= MIN_WALL_M2 else "plane"


def simplified(mesh: trimesh.Trimesh, faces: np.ndarray) -> tuple[trimesh.Trimesh, float] | None:
    """Simplify the part of a scan that consists of `faces` (K,).

    The part of the scan is smoothed without shrinkage (Taubin 1995). Edges are then collapsed by quadric error (Garland and Heckbert 1997).

    Returns:
        The simplified mesh, and the 95th percentile in metres of the distances between the scanned vertices and this mesh; None if no face
        remains.
    """
    vertex_ids, index = np.unique(np.asarray(mesh.faces)[faces], return_inverse=True)
    points = np.asarray(mesh.vertices)[vertex_ids]
    index = index.reshape(-1, 3)
    piece = trimesh.Trimesh(points, index, process=False)
    area = float(piece.area)
    if area <= 0 or float(np.ptp(points, axis=0).max()) <= 0:
        return None
    target = int(np.clip(area / FACE_M2, MIN_FACES, MAX_FACES))
    smooth = _smoothed(piece) if target < len(index) else points
    best, error = piece, 0.0
    for goal in (target * 2**k for k in range(TRIES)):
        best, error = _decimated(smooth, index, goal, points) if goal < len(index) else (piece, 0.0)
        if error <= ERROR_M:
            break
    corners = np.asarray(best.triangles)
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    best.update_faces(2 * np.asarray(best.area_faces) >= 1e-6 * np.maximum(sides.max(axis=1), 1e-12))  # heights below 1 um
    best.remove_unreferenced_vertices()
    return (best, error) if len(best.faces) else None


def _decimated(smooth: np.ndarray, index: np.ndarray, target: int, points: np.ndarray) -> tuple[trimesh.Trimesh, float]:
    triangles: Any = index
    out: Any = fast_simplification.simplify(smooth, triangles, target_count=target)
    mesh = trimesh.Trimesh(np.asarray(out[0], dtype=float), out[1], process=False)
    if not len(mesh.faces):
        return trimesh.Trimesh(points, index, process=False), 0.0
    return mesh, float(np.quantile(to_mesh(points[:: max(1, len(points) // 4000)], mesh), 0.95))


def _smoothed(piece: trimesh.Trimesh) -> np.ndarray:
    """Return the vertices after a smoothing that alternates a step towards the mean of the neighbours with a longer step away from it."""
    first, second = np.asarray(piece.edges_unique).T
    links = sp.coo_matrix((np.ones(2 * len(first)), (np.r_[first, second], np.r_[second, first])))
    mean = sp.diags(1 / np.asarray(links.sum(axis=1)).ravel()) @ links
    smooth: Any = trimesh.smoothing.filter_taubin(piece.copy(), 0.5, 0.53, 12, laplacian_operator=mean)
    return np.asarray(smooth.vertices)


def painted(mesh: trimesh.Trimesh, grid: Grid, points: np.ndarray, rgb: np.ndarray, seen: np.ndarray | None) -> trimesh.Trimesh:
    """Add a texture of the scanned colours to a flat mesh. Texture pixels without a scanned colour take the nearest scanned colour.

    Args:
        grid: grid of square cells on the plane of the mesh.
        points, rgb: (N, 3) scanned points on the plane in metres, and (N, 3) colours of these points, 0..255.
        seen: boolean mask of the scanned grid cells; unscanned cells become transparent. None means that all cells were scanned.
    """
    cell = max(grid.cell_m, grid.cell_m * max(grid.shape) / LARGEST_PX)
    shape = tuple(int(np.ceil(s * grid.cell_m / cell)) for s in grid.shape)
    at = np.floor((points @ grid.axes.T - grid.low) / cell).astype(int)
    at = np.clip(at, 0, np.array(shape) - 1)
    index = at[:, 0] * shape[1] + at[:, 1]
    count = np.bincount(index, minlength=shape[0] * shape[1])
    picture = np.stack([np.bincount(index, rgb[:, k], minlength=count.size) for k in range(3)], axis=-1) / np.maximum(count, 1)[:, None]
    picture = np.rint(picture).astype(np.uint8).reshape(*shape, 3)[nearest((count > 0).reshape(shape))]
    if seen is not None and not seen.all():
        column, row = (
            np.minimum(((np.arange(n) + 0.5) * cell / grid.cell_m).astype(int), m - 1) for n, m in zip(shape, seen.shape, strict=True)
        )
        picture = np.dstack([picture, np.where(seen[np.ix_(column, row)], 255, 0).astype(np.uint8)])
    uv = (np.asarray(mesh.vertices) @ grid.axes.T - grid.low) / (cell * np.array(shape))
    image = Image.fromarray(np.ascontiguousarray(picture.transpose(1, 0, 2)[::-1]))
    material = PBRMaterial(baseColorTexture=image, metallicFactor=0.0, roughnessFactor=1.0)
    return trimesh.Trimesh(
        mesh.vertices, mesh.faces, vertex_normals=mesh.vertex_normals, visual=TextureVisuals(uv=uv, material=material), process=False
    )


def coloured(mesh: trimesh.Trimesh, points: np.ndarray, rgb: np.ndarray) -> trimesh.Trimesh:
    """Give each vertex of a mesh the mean colour of the nearest scanned points (N, 3), whose colours are `rgb` (N, 3), 0..255."""
    _, near = KDTree(points).query(np.asarray(mesh.vertices), k=min(16, len(points)))
    near = np.asarray(near).reshape(len(mesh.vertices), -1)
    mean = np.rint(rgb[near].mean(axis=1)).astype(np.uint8)
    return trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_normals=mesh.vertex_normals, vertex_colors=mean, process=False)
