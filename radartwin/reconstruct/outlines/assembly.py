"""Build the scene's surfaces from segments and their polygons, one surface per object, with provenance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh

from radartwin.materials import Layered
from radartwin.reconstruct.distance import Nearest, spread
from radartwin.reconstruct.outlines.looks import coloured, painted
from radartwin.reconstruct.outlines.names import segment_names
from radartwin.reconstruct.outlines.parts import simplified
from radartwin.reconstruct.outlines.surfaces import Flattened
from radartwin.reconstruct.segmentation.colour import face_rgb
from radartwin.reconstruct.segmentation.faces import Segment
from radartwin.scene.scene import Surface

MIN_PART_M2 = 0.01  # smaller parts are omitted from the scene
MISSING_M = 0.05  # scanned points farther than this from every surface count as missing; noise and simplification shift points less


def assembled(
    mesh: trimesh.Trimesh, segments: Sequence[Segment], flattened: Flattened | None, material: str | Layered
) -> tuple[list[Surface], np.ndarray, dict[str, Any]]:
    """Build the surfaces of a segmented scan.

    Args:
        flattened: polygons of the planar segments; None keeps all scanned triangles.
        material: material of every surface.
    Returns:
        The surfaces.
        The surface index (F,) of each face of the scan; -1 for a face without a surface.
        Statistics; `left_out_m2` is the area of the scan that lies near no surface.
    """
    if flattened is not None:
        segments = flattened.segments
    names = segment_names(mesh, segments)
    surface_of_face = np.full(len(mesh.faces), -1, dtype=np.int32)
    surfaces: list[Surface] = []
    pieces = _Pieces(mesh, segments, flattened)
    for members in _objects(segments):
        made = {k: piece for k in members if (piece := pieces.of(k, alone=len(members) == 1)) is not None}
        if not made:
            continue
        first = segments[members[0]]
        planes = sum(segments[k].normal is not None for k in made)
        facts = _facts(planar=planes == len(made) == 1, planes=planes, segment=members[0])
        facts["area_m2"] = round(sum(segments[k].area_m2 for k in made), 4)
        facts["filled_m2"] = round(sum(pieces.filled_m2(k) for k in made), 4)
        whole: Any = next(iter(made.values())) if len(made) == 1 else trimesh.util.concatenate(list(made.values()))
        bounds = first.normal is not None and first.body < 0
        surface = Surface(whole, material, names[members[0]], role="room" if bounds else "auto", provenance=facts)
        for k in made:
            surface_of_face[segments[k].faces] = len(surfaces)
        surfaces.append(surface.replaced(role=surface.kind))
    panes = [] if flattened is None else [f for f in flattened.flats if f.segment < 0]
    for number, flat in enumerate(panes, 1):
        facts = _facts(planar=True, planes=1, segment=-1)
        facts |= {"completed": True, "area_m2": 0.0, "filled_m2": round(flat.filled_m2, 4), "parent": names[flat.parent]}
        surfaces.append(Surface(flat.mesh, material, f"pane_{number}", role="room", provenance=facts))
    statistics: dict[str, Any] = {"flattening_rms_m": 0.0, "flattening_max_m": 0.0} if flattened is None else dict(flattened.statistics)
    statistics |= {"parts_error_m": pieces.error_m, "left_out_m2": round(_missing_m2(mesh, surfaces), 4), "panes": len(panes)}
    return surfaces, surface_of_face, statistics


def _missing_m2(mesh: trimesh.Trimesh, surfaces: Sequence[Surface]) -> float:
    """Return the area of the scan farther than MISSING_M from every surface, m2: fragments, trimmed edges and thin parts."""
    if not surfaces:
        return float(mesh.area)
    points = spread(mesh, MISSING_M)[0]
    away = Nearest([s.mesh for s in surfaces], MISSING_M)(points)[0]
    return float(mesh.area) * float((away > MISSING_M).mean())


class _Pieces:
    """Makes the meshes of segments: polygons, simplified parts, or scanned triangles. `error_m` is the largest simplification error."""

    def __init__(self, mesh: trimesh.Trimesh, segments: Sequence[Segment], flattened: Flattened | None) -> None:
        self._mesh, self._segments = mesh, segments
        self._flats = None if flattened is None else {f.segment: f for f in flattened.flats}
        self._rgb = face_rgb(mesh)
        self._centre = np.asarray(mesh.triangles_center)
        self.error_m = 0.0

    def of(self, k: int, alone: bool) -> trimesh.Trimesh | None:
        """Return the mesh of segment k; None if the segment is omitted.

        `alone` states that no other segment belongs to the same object. The polygon of such a segment gets a texture.
        """
        segment = self._segments[k]
        if self._flats is None:
            piece: Any = self._mesh.submesh([segment.faces], append=True, repair=False)
            return piece
        at, colours = self._centre[segment.faces], None if self._rgb is None else self._rgb[segment.faces]
        if segment.normal is not None:
            flat = self._flats.get(k)
            if flat is None or colours is None:
                return None if flat is None else flat.mesh
            return painted(flat.mesh, flat.grid, at, colours, flat.seen) if alone else coloured(flat.mesh, at, colours)
        if segment.noise or segment.area_m2 < MIN_PART_M2 or (part := simplified(self._mesh, segment.faces)) is None:
            return None
        self.error_m = max(self.error_m, part[1])
        return part[0] if colours is None else coloured(part[0], at, colours)

    def filled_m2(self, k: int) -> float:
        flat = None if self._flats is None else self._flats.get(k)
        return 0.0 if flat is None else flat.filled_m2


def _facts(planar: bool, planes: int, segment: int) -> dict[str, Any]:
    label = {"source": "uniform", "confidence": None, "stand_in": False, "minc": None}
    return {**label, "scanned": True, "planar": planar, "planes": planes, "segment": segment, "completed": False}


def _objects(segments: Sequence[Segment]) -> list[list[int]]:
    """Group the segment indices by body, in the order of each body's first segment."""
    objects: dict[tuple[int, int], list[int]] = {}
    for k, segment in enumerate(segments):
        objects.setdefault((1, segment.body) if segment.body >= 0 else (0, k), []).append(k)
    return list(objects.values())
