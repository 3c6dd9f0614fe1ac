"""Write a scene as a single HTML page that shows the material of every surface. The page needs no server and no network.

This module computes the contents of the page, and the scripts in the folder `assets` draw the contents with WebGL 2.
docs/decisions/012-own-or-library.md compares this solution with plotly.
"""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from radartwin.errors import OutputError, PoseError, SceneError
from radartwin.io.files import write_atomically
from radartwin.io.one_line import plural
from radartwin.materials import Layered
from radartwin.scene.scene import Scene
from radartwin.scene.surface import Surface
from radartwin.scene.thing_names import things
from radartwin.scene.viewer import colouring as colours
from radartwin.scene.viewer.colouring import material_label
from radartwin.scene.viewer.display_mesh import MAX_FACES, NO_COLOUR, pictures, thinned, vertex_colours, wall_planes
from radartwin.scene.viewer.overlay import overlay

__all__ = ["COLOURINGS", "material_label", "view"]

COLOURINGS = ("material", "segment", "reflectivity", "colour")
MAX_SURFACES = 65_000  # largest number of surfaces in a page, because the page stores the number of a surface in 16 bits
CRISP_FACES = 2000  # the page draws sharp edges only on surfaces with fewer faces, because on a noisy scan every edge would be sharp
_SCRIPTS = ("camera.js", "renderer.js", "panel.js", "main.js")


def view(scene: Scene, path: str | Path, poses: np.ndarray | None = None, title: str | None = None, by: str = "material") -> Path:
    """Write a scene as an HTML page. If the scene is large, the page contains simplified meshes and a note about the simplification.

    Args:
        path: path of the .html file.
        poses: (F, 4, 4) or (4, 4) sensor-to-world poses, which the page draws as a track with boresight directions; by default no track is
            drawn.
        title: heading of the page; by default the name of the room or the source of the scan, from the scene's provenance.
        by: property by which surfaces are coloured when the page opens: material, segment, reflectivity or colour (of the scan); the user
            can switch to a different property.
    Raises:
        SceneError: the scene has no surfaces, `by` is unknown, or `by` is "colour" and the scene has no scanned colours.
        PoseError: the array `poses` does not have the shape (F, 4, 4) or (4, 4).
        OutputError: the path does not end with .html, or the HTML file cannot be written.
    """
    path = Path(path)
    if path.suffix != ".html":
        raise OutputError(f"{path} does not end with .html; give the page a name such as {path.with_suffix('.html').name}")
    return write_atomically(path, page_of(*describe(scene, poses, title, by)))


def describe(
    scene: Scene, poses: np.ndarray | None = None, title: str | None = None, by: str = "material", max_faces: int = MAX_FACES
) -> tuple[dict[str, Any], Sequence[np.ndarray]]:
    """Return the contents of the page as a JSON dictionary, and the arrays of the page.

    The arguments and errors are the same as for the function `view`.

    The arrays are vertex positions (V, 3), surface number of each vertex (V,), vertex colours (V, 4), texture coordinates with the number
    of the picture (V, 3), and faces (T, 3).
    """
    if not len(scene):
        raise SceneError("the scene has no surfaces, so there is nothing to view; reconstruct a scan or add surfaces")
    if by not in COLOURINGS:
        raise SceneError(f"view: by is {by!r}; choose {', '.join(COLOURINGS)}")
    if len(scene) > MAX_SURFACES:
        raise SceneError(f"the scene has {len(scene)} surfaces, and a page shows at most {MAX_SURFACES}; join some of them")
    surfaces = scene.surfaces
    meshes, cell = thinned([s.mesh for s in surfaces], max_faces)
    scanned = [vertex_colours(m) for m in meshes]
    if by == "colour" and all(c is None for c in scanned):
        raise SceneError("the scene has no colours of a scan; view it by material, segment or reflectivity")
    labels = [colours.surface_label(s) for s in surfaces]
    colour_of = colours.material_colours(labels)
    levels = [colours.reflection_db(s.material, s.roughness_m) for s in surfaces]
    stops = colours.ramp()
    jpegs, coordinates = pictures(meshes)
    low, high = scene.bounds
    content = {
        "title": title or str(scene.provenance.get("room") or scene.provenance.get("source") or "scene"),
        "note": _note(scene, meshes, cell),
        "mode": by,
        "bounds": [low.tolist(), high.tolist()],
        "materials": [{"label": label, "colour": colour} for label, colour in colour_of.items()],
        "surfaces": [
            _surface(s, str(thing) or f"surface {index}", wall, level, c is not None)
            for index, (s, thing, wall, level, c) in enumerate(
                zip(surfaces, things(scene), wall_planes(surfaces), levels, scanned, strict=True)
            )
        ],
        "colours": {
            "material": [colour_of[label] for label in labels],
            "segment": colours.segment_colours([float(s.mesh.area) for s in surfaces]),
            "reflectivity": [colours.reflectivity_colour(level, stops) for level in levels],
        },
        "has_colour": any(c is not None for c in scanned),
        "has_filled": any(_filled_m2(s) > 0 for s in surfaces),
        "ramp": {
            "stops": stops,
            "low_db": colours.LOW_DB,
            "ticks_db": np.linspace(colours.LOW_DB, 0, 5).astype(int).tolist(),
            "band": f"{colours.BAND_HZ[0] / 1e9:g} to {colours.BAND_HZ[1] / 1e9:g} GHz",
            "unknown": colours.UNKNOWN,
        },
        **overlay(scene, _poses(poses)),
        "pictures": [f"data:image/jpeg;base64,{base64.b64encode(jpeg).decode()}" for jpeg in jpegs],
    }
    return content, _arrays(meshes, scanned, coordinates)


def _surface(surface: Surface, name: str, wall: dict[str, list[float]] | None, level: float | None, scanned: bool) -> dict[str, Any]:
    mesh, provenance = surface.mesh, surface.provenance
    facts = [["material", colours.surface_label(surface)], ["kind", surface.kind], ["area", f"{mesh.area:.3g} m²"]]
    if isinstance(surface.material, Layered) and surface.material.layers:
        total = sum(thickness for _, thickness in surface.material.layers)
        facts.append(["layers", f"{len(surface.material.layers)}, {1000 * total:.4g} mm together"])
    if (filled := _filled_m2(surface)) > 0:
        share = "all of it, an inferred pane" if provenance.get("completed") else f"{filled:.3g} m² of it, filled in"
        facts.append(["never scanned", share])
    facts.append(["roughness", f"{1000 * surface.roughness_m:.3g} mm" if surface.roughness_m else "smooth"])
    facts.append(["reflects", "no values at this frequency" if level is None else _decibels(level)])
    facts.append(["source", str(provenance.get("source", "not recorded"))])
    if (confidence := provenance.get("confidence")) is not None:
        facts.append(["confidence", f"{confidence:.0%}" if isinstance(confidence, int | float) else str(confidence)])
    if (category := provenance.get("minc")) is not None:
        facts.append(["category", str(category)])
    if (stand_in := provenance.get("stand_in")) is not None:
        facts.append(["substitute", ("yes: another material is used" if stand_in is True else str(stand_in)) if stand_in else "no"])
    if surface.name not in ("", name):
        facts.append(["segment", surface.name])
    return {
        "name": name,
        "material": colours.surface_label(surface),
        "area_m2": float(mesh.area),
        "reflection_db": level,
        "wall": wall,
        "crisp": len(mesh.faces) < CRISP_FACES,
        "centre": mesh.bounds.mean(axis=0).tolist(),
        "has_colour": scanned,
        "facts": facts,
    }


def _filled_m2(surface: Surface) -> float:
    """Return the area in m^2 of a surface that was not scanned but filled in; 0 if the area is unknown or less than a square decimetre."""
    filled = surface.provenance.get("filled_m2")
    return float(filled) if isinstance(filled, int | float) and filled >= 0.01 else 0.0


def _decibels(level: float) -> str:
    text = f"{level:.1f}".replace("-", "−")
    return f"{'0.0' if text == '−0.0' else text} dB"


def _arrays(meshes: Sequence[trimesh.Trimesh], scanned: Sequence[np.ndarray | None], coordinates: np.ndarray) -> Sequence[np.ndarray]:
    vertices, faces = trimesh.util.append_faces([m.vertices for m in meshes], [m.faces for m in meshes])
    colours = [np.tile(NO_COLOUR, (len(m.vertices), 1)) if c is None else c for m, c in zip(meshes, scanned, strict=True)]
    return (
        vertices.astype("<f4"),
        np.repeat(np.arange(len(meshes)), [len(m.vertices) for m in meshes]).astype("<u2"),
        np.vstack(colours).astype("u1"),
        coordinates.astype("<f4"),
        faces.astype("<u4"),
    )


def page_of(content: dict[str, Any], arrays: Sequence[np.ndarray]) -> str:
    folder = resources.files("radartwin.scene.viewer") / "assets"
    part = {name: (folder / name).read_text(encoding="utf-8") for name in ("page.html", "style.css", *_SCRIPTS)}
    parts = {
        "__TITLE__": html.escape(content["title"]),
        "__STYLE__": part["style.css"],
        "__SCRIPT__": "\n".join(part[name] for name in _SCRIPTS),
        "__ARRAYS__": "\n".join(base64.b64encode(a.tobytes()).decode() for a in arrays),
        # "</script>" in the name of a surface must not end the script element of the page.
        "__SCENE__": json.dumps(content, allow_nan=False).replace("<", "\\u003c"),
    }
    page = part["page.html"]
    for key, text in parts.items():  # the scene is inserted last, so that no placeholder inside the user's text is replaced
        page = page.replace(key, text)
    return page


def _poses(poses: np.ndarray | None) -> np.ndarray | None:
    if poses is None:
        return None
    poses = np.asarray(poses, dtype=np.float64)
    if poses.shape[-2:] != (4, 4) or poses.ndim not in (2, 3) or not poses.size or not np.isfinite(poses).all():
        raise PoseError(f"view: poses of shape {poses.shape}; give finite (F, 4, 4) sensor-to-world poses")
    return poses.reshape(-1, 4, 4)


def _note(scene: Scene, meshes: Sequence[trimesh.Trimesh], cell: float) -> str:
    faces, size = sum(len(s.mesh.faces) for s in scene), np.ptp(scene.bounds, axis=0)
    dimensions = " × ".join(f"{x:.2f}" for x in size)
    note = f"{plural(len(scene), 'surface')}, {faces:,} triangles, {dimensions} m"
    if cell:
        page_faces = sum(len(m.faces) for m in meshes)
        note += f" · reduced for this page to {page_faces:,} triangles on a {1000 * cell:.0f} mm grid; the scene keeps all triangles"
    return note
