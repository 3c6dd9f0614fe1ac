"""A scene as one HTML page: turn it, see what each surface is made of. Needs no server and no network."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from radartwin.errors import SceneError
from radartwin.files import write_atomically
from radartwin.materials import Layered
from radartwin.scene.scene import Scene, Surface

# What people expect a material to look like, kept apart for colour-blind readers by lightness (Okabe and Ito hues).
COLOURS = {
    "metal": "#5b6b7a",
    "concrete": "#a8a8a0",
    "brick": "#b5533c",
    "plasterboard": "#ece3cf",
    "wood": "#c98b4a",
    "plywood": "#d9a86c",
    "chipboard": "#8c5a2b",
    "floorboard": "#7a4a22",
    "glass": "#56b4e9",
    "ceiling_board": "#cfd8dc",
    "marble": "#f0e9f2",
    "water": "#0072b2",
    "oil": "#e69f00",
    "pet": "#009e73",
    "hdpe": "#33c29a",
}
OTHER = "#cc79a7"
SHELL_M2 = 4.0  # larger surfaces hide what is inside, so all but the floor are drawn translucent
SHELL_OPACITY = 0.3
# The epsilons are areas below which Plotly gives a triangle no normal: scan triangles of 1 cm2 would all turn black.
LIGHTING = {"ambient": 0.6, "diffuse": 0.6, "specular": 0.05, "facenormalsepsilon": 0, "vertexnormalsepsilon": 0}


def view(scene: Scene, path: str | Path, poses: np.ndarray | None = None, title: str | None = None) -> Path:
    """Write the page.

    Args:
        path: the .html to write.
        poses: (F, 4, 4) sensor-to-world, drawn as a track with the first boresight; none by default.
        title: above the picture; what the scene's provenance says unless given.
    Returns:
        The path.
    Raises:
        SceneError: nothing to show.
        OutputError: the page cannot be written.
    """
    import plotly.graph_objects as go

    if not len(scene):
        raise SceneError("the scene has no surfaces, so there is nothing to view")
    shown: set[str] = set()
    traces = []
    for surface in sorted(scene, key=lambda s: material_label(s.material)):
        label = material_label(surface.material)
        traces.append(_mesh_trace(go, surface, label, first=label not in shown))
        shown.add(label)
    if poses is not None:
        traces += _sensor_traces(go, np.asarray(poses, dtype=np.float64).reshape(-1, 4, 4))
    figure = go.Figure(traces)
    axis = {"backgroundcolor": "#f7f7f7", "gridcolor": "#dddddd", "zeroline": False}
    figure.update_layout(
        title={"text": title or _title(scene), "x": 0.02},
        scene={
            "aspectmode": "data",
            "xaxis": {"title": "x [m]", **axis},
            "yaxis": {"title": "y [m]", **axis},
            "zaxis": {"title": "z [m]", **axis},
            "camera": {
                "center": {"x": 0.0, "y": 0.0, "z": -0.1},
                "eye": {"x": -1.2, "y": -1.5, "z": 1.3},
                "projection": {"type": "perspective"},
            },
        },
        legend={"title": {"text": "material (click to hide)"}, "groupclick": "togglegroup", "x": 1.0, "y": 0.95},
        margin={"l": 0, "r": 0, "t": 50, "b": 0},
        template="plotly_white",
        font={"family": "Helvetica, Arial, sans-serif", "size": 14},
    )
    config = {"displaylogo": False, "responsive": True}
    page = figure.to_html(include_plotlyjs=True, full_html=True, config=config, default_height="96vh")
    return write_atomically(Path(path), page)


def material_label(material: str | Layered) -> str:
    """`concrete`, or `floorboard 8 mm on concrete`, or `glass 4 mm | air 16 mm | glass 4 mm`."""
    if isinstance(material, str):
        return material
    stack = " | ".join(f"{name} {1000 * thickness:.4g} mm" for name, thickness in material.layers)
    return stack if material.backing == "air" else f"{stack} on {material.backing}"


def _mesh_trace(go, surface: Surface, label: str, first: bool):
    mesh = surface.mesh
    x, y, z = np.asarray(mesh.vertices, dtype=np.float32).T
    i, j, k = np.asarray(mesh.faces).T
    outer = surface.material if isinstance(surface.material, str) else surface.material.layers[0][0]
    upward = float(np.average(mesh.face_normals[:, 2], weights=mesh.area_faces)) > 0.9
    hides = surface.kind == "room" and mesh.area > SHELL_M2 and not upward and float(mesh.extents.max()) > 2.0
    text = f"<b>{surface.name or 'unnamed'}</b><br>{label}<br>{surface.kind}, {mesh.area:.3g} m²"
    if surface.roughness_m:
        text += f"<br>roughness {1000 * surface.roughness_m:.3g} mm"
    return go.Mesh3d(
        x=x, y=y, z=z, i=i, j=j, k=k,
        color=COLOURS.get(outer, OTHER),
        opacity=SHELL_OPACITY if hides else 1.0,
        flatshading=True,
        lighting=LIGHTING,
        lightposition={"x": -2000, "y": -4000, "z": 9000},
        name=label,
        legendgroup=label,
        showlegend=first,
        hovertemplate=text + "<extra></extra>",
    )  # fmt: skip


def _sensor_traces(go, poses: np.ndarray) -> list:
    positions = poses[:, :3, 3]
    beam = np.stack([positions[0], positions[0] + 0.5 * poses[0, :3, 0]])
    return [
        go.Scatter3d(
            x=positions[:, 0], y=positions[:, 1], z=positions[:, 2], mode="lines+markers", name="radar",
            marker={"size": 4, "color": "#d55e00"}, line={"color": "#d55e00"}, legendgroup="radar",
        ),
        go.Scatter3d(
            x=beam[:, 0], y=beam[:, 1], z=beam[:, 2], mode="lines", name="boresight",
            line={"color": "#d55e00", "width": 6}, legendgroup="radar", showlegend=False,
        ),
    ]  # fmt: skip


def _title(scene: Scene) -> str:
    name = scene.provenance.get("room") or scene.provenance.get("source") or "scene"
    faces = sum(len(s.mesh.faces) for s in scene)
    return f"{name}: {len(scene)} surfaces, {faces} triangles"
