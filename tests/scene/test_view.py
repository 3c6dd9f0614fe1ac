"""The content of a scene's 3-D page without a browser: colours, legend, cards, filled areas, and thinning of large meshes."""

import json
import re
from typing import Any

import numpy as np
import pytest
import trimesh
from trimesh.visual import ColorVisuals

from radartwin import cli
from radartwin.label.z_buffer import Camera, Drawing
from radartwin.materials import Layered
from radartwin.reconstruct.build import ScanOptions, reconstruct
from radartwin.scene import objects, rooms
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.viewer import colouring, display_mesh
from radartwin.scene.viewer.display_mesh import texture
from radartwin.scene.viewer.page import describe, view

GLAZING = Layered([("glass", 0.004), ("air", 0.016), ("glass", 0.004)])


def grid(size=3.0, n=80, seed=0, height=0.0):
    """Return a horizontal square of 2 n^2 triangles with height noise of a millimetre."""
    u = np.linspace(0, size, n + 1)
    x, y = np.meshgrid(u, u, indexing="ij")
    z = height + np.random.default_rng(seed).normal(0, 1e-3, x.shape)
    index = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = (index[i:j, k:m].ravel() for i, j, k, m in ((0, -1, 0, -1), (1, None, 0, -1), (1, None, 1, None), (0, -1, 1, None)))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return trimesh.Trimesh(np.stack([x, y, z], axis=-1).reshape(-1, 3), faces, process=False)


def scene():
    can = objects.cylinder(0.033, 0.12).apply_translation([1, 1, 0.5])
    substituted = {"source": "vlm", "confidence": 0.62, "stand_in": True, "minc": "ceramic"}
    return Scene(
        [
            Surface(grid(), "concrete", "floor", 1e-3, role="room", provenance={"source": "true", "stand_in": False}),
            Surface(can, "glass", "can", role="object", provenance=substituted),
            Surface(grid(1.0, 20, height=0.4), GLAZING, "pane", role="room"),
        ]
    )


def read(path):
    """Return the text of a page, and the scene in it."""
    page = path.read_text()
    script = re.search(r'<script type="application/json" id="scene">(.*?)</script>', page, re.S)
    assert script
    return page, json.loads(script.group(1))


def test_the_page_needs_no_other_file_and_lists_surfaces_and_materials(tmp_path):
    page, content = read(view(scene(), tmp_path / "page.html", poses=np.eye(4)))
    assert not re.search(r"""(src|href)=["'](?!data:)""", page)
    assert "http" not in page.replace("http-equiv", "")
    assert [s["name"] for s in content["surfaces"]] == ["floor", "can", "pane"]
    assert {m["label"] for m in content["materials"]} == {"concrete", "ceramic (simulated as glass)", "glass 4 mm | air 16 mm | glass 4 mm"}


def test_the_page_has_every_triangle_and_the_facts_of_each_material():
    original = scene()
    content, (positions, surface, colours, _, faces) = describe(original)
    assert len(positions) == len(surface) == len(colours)
    for k, expected in enumerate(original):
        assert np.allclose(positions[faces[surface[faces[:, 0]] == k]].astype(float), expected.mesh.triangles, atol=1e-6)
    facts = dict(content["surfaces"][1]["facts"])
    assert facts["material"] == "ceramic (simulated as glass)"
    assert (facts["source"], facts["confidence"], facts["category"]) == ("vlm", "62%", "ceramic")
    assert facts["substitute"].startswith("yes")
    floor = dict(content["surfaces"][0]["facts"])
    assert (floor["roughness"], floor["substitute"]) == ("1 mm", "no")
    assert dict(content["surfaces"][2]["facts"])["layers"] == "3, 24 mm together"


def test_reflectivity_is_the_fresnel_value_and_its_colour_is_on_the_ramp():
    assert colouring.reflection_db("metal") == pytest.approx(0, abs=0.01)
    eta = 5.24  # of concrete, ITU-R P.2040-4; its conductivity changes only the last digit
    assert colouring.reflection_db("concrete") == pytest.approx(20 * np.log10((np.sqrt(eta) - 1) / (np.sqrt(eta) + 1)), abs=0.05)
    smooth, rough = colouring.reflection_db("concrete"), colouring.reflection_db("concrete", 1e-3)
    assert smooth is not None
    assert rough is not None
    wavenumber = 2 * np.pi * 79e9 / 299792458
    ament_db = 20 * np.log10(np.e) * 2 * (wavenumber * 1e-3) ** 2  # at the centre of the band
    assert smooth - rough == pytest.approx(ament_db, rel=0.05)
    stops = colouring.ramp()
    assert colouring.reflectivity_colour(0.0, stops) == stops[-1]
    assert colouring.reflectivity_colour(-80.0, stops) == stops[0]
    assert colouring.reflectivity_colour(None, stops) not in stops


def test_a_large_scene_is_thinned_for_the_page_only():
    meshes = [grid(n=200), grid(n=150, height=2.0), objects.sphere(0.1, 2)]
    meshes[0].visual = ColorVisuals(meshes[0], vertex_colors=np.full((len(meshes[0].vertices), 4), [200, 40, 10, 255], np.uint8))
    thin, cell = display_mesh.thinned(meshes, 30_000)
    assert 10_000 < sum(len(m.faces) for m in thin) <= 30_000
    assert thin[2] is meshes[2]
    assert np.all(display_mesh.vertex_colours(thin[0]) == np.array([200, 40, 10, 255]))
    for before, after in zip(meshes, thin, strict=True):
        assert np.allclose(before.bounds, after.bounds, atol=cell)
        assert after.area == pytest.approx(before.area, rel=0.15)  # noise at cell borders adds area
    content, _ = describe(Scene([Surface(m, "wood", role="room") for m in meshes]), max_faces=30_000)
    assert "reduced for this page" in content["note"]
    assert f"{sum(len(m.faces) for m in meshes):,} triangles" in content["note"]
    assert display_mesh.thinned(meshes, 10**6) == (meshes, 0.0)


def test_walls_are_distinguished_from_furniture_for_either_winding():
    box = [
        Surface(grid(4.0), "concrete", "floor", role="room"),
        Surface(grid(4.0, height=2.5), "concrete", "ceiling", role="room"),  # its normals point out of the room
        Surface(grid(1.5, height=0.75).apply_translation([1, 1, 0]), "wood", "table", role="room"),
        Surface(objects.cylinder(0.3, 1.0).apply_translation([2, 2, 0.6]), "metal", "drum", role="room"),
    ]
    floor, ceiling, table, drum = display_mesh.wall_planes(box)
    assert floor
    assert ceiling
    assert floor["normal"][2] > 0.99
    assert ceiling["normal"][2] < -0.99
    assert (table, drum) == (None, None)


def test_the_verb_draws_track_and_layout(tmp_path, capsys):
    folder = rooms.lab(detail="shell").save(tmp_path / "lab")
    (tmp_path / "drive.txt").write_text("0 1 0 0.4 0 0 0 1\n1 1.2 0 0.4 0 0 0 1\n")
    (tmp_path / "layout.yaml").write_text(
        "objects:\n  - object: mug\n    on: floor\n    relations: [{relation: in front of, anchor: radar}]\n"
    )
    options = ["--by", "reflectivity", "--trajectory", str(tmp_path / "drive.txt"), "--layout", str(tmp_path / "layout.yaml")]
    assert cli.main(["view", str(folder), *options]) == 0
    assert capsys.readouterr().out.strip() == str(folder / "view.html")
    _, content = read(folder / "view.html")
    assert content["mode"] == "reflectivity"
    assert content["radar"] == {"position": [1.0, 0.0, 0.4], "boresight": [1.0, 0.0, 0.0]}
    assert any(np.allclose(line["to"], [2, 0, 0.4]) for line in content["lines"])  # a metre along the boresight
    sides = [np.array(line["to"]) - [1.0, 0.0, 0.4] for line in content["lines"] if np.allclose(line["from"], [1.0, 0.0, 0.4])]
    azimuths = {round(float(np.degrees(np.arctan2(y, x)))) for x, y, _ in sides}
    assert azimuths == {-50, 0, 50}, "the edges of the field of view, and the boresight"
    assert {"mug", "radar", "end, after 0.20 m"} <= {label["text"] for label in content["labels"]}
    assert not [s for s in Scene.load(folder) if s.name == "mug"]


def test_each_texture_is_in_the_page_once_with_its_coordinates():
    room = rooms.lab(detail="shell")
    content, (_, surface, _, coordinates, _) = describe(room, by="colour")
    assert all(p.startswith("data:image/jpeg;base64,") for p in content["pictures"])
    assert set(np.unique(coordinates[coordinates[:, 2] >= 0, 2])) == set(range(len(content["pictures"])))
    visual: Any = room.surfaces[floor := room.names.index("floor")].mesh.visual
    assert np.allclose(coordinates[surface == floor, :2], np.column_stack([visual.uv[:, 0], 1 - visual.uv[:, 1]]), atol=1e-5)


RED = (200, 30, 30, 255)
HOLE_M2 = np.pi * 0.4**2


@pytest.fixture(scope="module")
def floor(tmp_path_factory) -> Surface:
    """Return the floor of a red room, saved and loaded again, in which a round area of 0.8 m was never scanned."""
    room: Any = trimesh.creation.box(bounds=[[0, 0, 0], [4, 3, 2.5]])
    for _ in range(5):
        room = room.subdivide()
    room.invert()
    x, y, z = room.triangles_center.T
    room.update_faces(~((z < 0.01) & (np.hypot(x - 2, y - 1.5) < 0.4)))
    room.visual.vertex_colors = np.tile(np.array(RED, np.uint8), (len(room.vertices), 1))
    folder = tmp_path_factory.mktemp("scan")
    room.export(folder / "room.ply")
    reconstruct(folder / "room.ply", folder / "scene", options=ScanOptions(up="z"))
    return next(s for s in Scene.load(folder / "scene") if s.name == "floor")


def test_a_filled_patch_is_transparent_and_keeps_its_estimated_colour(floor):
    image = texture(floor.mesh)
    assert image is not None
    assert image.mode == "RGBA"
    pixels = np.asarray(image)
    u, v = np.ptp(floor.mesh.visual.uv, axis=0) * np.array(image.size)  # pixels that the floor spans
    unseen = (pixels[..., 3] == 0) & (np.cumsum(pixels[..., 3] > 0, axis=1) > 0) & (np.cumsum(pixels[:, ::-1, 3] > 0, axis=1)[:, ::-1] > 0)
    assert unseen.sum() * floor.mesh.area / (u * v) == pytest.approx(HOLE_M2, rel=0.2)
    assert np.abs(pixels[..., :3].astype(int) - RED[:3]).max() < 3, "the picture for a language model is opaque"
    drawing = Drawing(Scene([floor]))
    camera = Camera.looking(np.array([2, 1.5, 4.0]), np.array([2.01, 1.5, 0]), 30.0, 64)
    red, green, blue = drawing.picture(camera, drawing.seen(camera)).reshape(-1, 3).astype(float).T
    assert (red > 3 * np.maximum(green, blue)).all(), "the picture for a language model shows the estimated colour"


def test_the_card_gives_the_area_of_a_filled_patch(floor):
    content, _ = describe(Scene([floor]), by="colour")
    card = dict(content["surfaces"][0]["facts"])
    filled = floor.provenance["filled_m2"]
    assert filled == pytest.approx(HOLE_M2, rel=0.2)
    assert card["never scanned"] == f"{filled:.3g} m² of it, filled in"
    assert content["has_filled"]


def test_the_card_of_an_inferred_pane_says_so(floor):
    for provenance, fact in (({"filled_m2": 0.0}, None), ({"completed": True, "filled_m2": 2.0}, "all of it, an inferred pane")):
        content, _ = describe(Scene([floor.replaced(provenance=provenance)]))
        assert dict(content["surfaces"][0]["facts"]).get("never scanned") == fact
        assert content["has_filled"] == (fact is not None)
