"""Draw a scanned room beside its material map, which shows the same view in colours that stand for the MINC material categories.

The legend of the material map names the simulated material of each visible category, in the order of the MINC categories.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from radartwin.label.z_buffer import Camera, Drawing
from radartwin.materials.minc import CATEGORIES
from radartwin.plotting import style
from radartwin.scene.scene import Scene
from radartwin.scene.viewer.colouring import CATEGORY_COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

NO_CATEGORY = "#d0d0d0"
FIELD_DEG = 75.0
PIXELS = 700


def material_map(scene: Scene) -> Figure:
    """Draw two panels: the scanned scene in its own colours, and coloured by MINC category with a legend of the visible categories."""
    figure, axes = style.figure(1, 2, width_in=style.PAGE_WIDTH_IN, height_in=4.1)
    visible = draw_materials(axes, scene)
    minc = [str(surface.provenance.get("minc") or "none") for surface in scene]
    patches = legend({f"{name}: {_materials(scene, minc, name)}": name for name in visible})
    figure.legend(handles=patches, loc="outside lower center", ncols=min(2, max(1, len(patches))))
    return figure


def draw_materials(axes: Sequence[Axes], scene: Scene, scan: Scene | None = None, pixels: int = PIXELS) -> list[str]:
    """Draw the view of a corner camera on two axes, in the colours of the scan and by MINC category. Return the visible categories.

    Args:
        scan: the scanned mesh with its pictures, which the first picture shows; None shows the surfaces of the scene.
    """
    import matplotlib.colors

    drawing = Drawing(scene)
    camera = corner_camera(scene, drawing, pixels)
    seen = drawing.seen(camera)
    surface_index = drawing.surfaces(seen)
    minc = [str(surface.provenance.get("minc") or "none") for surface in scene]
    palette = np.array([matplotlib.colors.to_rgb(CATEGORY_COLOURS.get(name, NO_CATEGORY)) for name in minc] + [(1.0, 1.0, 1.0)])
    # Shading by the cosine of the incidence angle makes edges between faces of the same material visible.
    shade = np.ones(seen.face.shape)
    shade[seen.face >= 0] = 0.7 + 0.3 * np.abs(drawing.facing(camera, seen, seen.face >= 0))
    flat = palette[surface_index] * shade[..., None]
    scanned = drawing if scan is None else Drawing(scan)
    picture = scanned.picture(camera, seen if scan is None else scanned.seen(camera))
    for axis, pixels_rgb, title in zip(axes, (picture, np.clip(flat, 0, 1)), ("scan", "materials"), strict=True):
        axis.imshow(pixels_rgb, interpolation="nearest")
        axis.set_title(title)
        axis.set_axis_off()
    visible = {minc[k] for k in np.unique(surface_index) if k >= 0}
    return [name for name in (*CATEGORIES, "none") if name in visible]


def legend(labels: Mapping[str, str]) -> list[Patch]:
    """Return the entries of a legend from a dictionary of labels to MINC categories."""
    from matplotlib.patches import Patch

    line = {"edgecolor": "#555555", "linewidth": 0.4}
    return [Patch(facecolor=CATEGORY_COLOURS.get(name, NO_CATEGORY), label=label, **line) for label, name in labels.items()]


def _materials(scene: Scene, minc: list[str], category: str) -> str:
    """Return a text for a MINC category: the name of its material with the largest area, and the number of its other materials."""
    from radartwin.scene.viewer.page import material_label

    areas: dict[str, float] = {}
    for surface, surface_category in zip(scene, minc, strict=True):
        if surface_category == category:
            label = material_label(surface.material)
            areas[label] = areas.get(label, 0.0) + float(surface.mesh.area)
    most = max(areas, key=lambda label: areas[label])
    return most + (f" ({len(areas) - 1} more)" if len(areas) > 1 else "")


def corner_camera(scene: Scene, drawing: Drawing, pixels: int) -> Camera:
    """Return a camera at two thirds of the room height in the corner that shows most surfaces, looking slightly downwards."""
    low, high = scene.bounds
    best, best_score = None, -1.0
    for x in (0.12, 0.88):
        for y in (0.12, 0.88):
            eye = low + (high - low) * np.array([x, y, 0.66])
            target = low + (high - low) * np.array([1 - x, 1 - y, 0.35])
            small = Camera.looking(eye, target, FIELD_DEG, 96)
            seen = drawing.seen(small)
            labels, counts = np.unique(drawing.surfaces(seen)[seen.face >= 0], return_counts=True)
            near = float(np.median(seen.depth[np.isfinite(seen.depth)])) if len(labels) else 0.0
            score = float(np.count_nonzero(counts >= 10)) + near
            if score > best_score:
                best, best_score = Camera.looking(eye, target, FIELD_DEG, pixels), score
    assert best is not None
    return best
