"""Areas that the scan missed and the reconstruction filled are listed on the page of the scene and hatched in its scan colours."""

import base64
import io
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from radartwin.label.raster import Camera, Drawing
from radartwin.reconstruct.build import ScanOptions, reconstruct
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.viewer.display_mesh import HATCH, texture
from radartwin.scene.viewer.page import describe

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


def test_the_page_hatches_a_filled_patch_and_the_card_gives_its_area(floor):
    content, _ = describe(Scene([floor]), by="colour")
    card = dict(content["surfaces"][0]["facts"])
    filled = floor.provenance["filled_m2"]
    assert filled == pytest.approx(HOLE_M2, rel=0.2)
    assert card["never scanned"] == f"{filled:.3g} m² of it, filled in"
    assert content["has_filled"]
    picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(content["pictures"][0].partition(",")[2]))).convert("RGB")).astype(int)
    middle = picture[picture.shape[0] // 2 - 8 : picture.shape[0] // 2 + 8, picture.shape[1] // 2 - 8 : picture.shape[1] // 2 + 8]
    assert (np.ptp(middle, axis=2) < 25).mean() > 0.9, "grey"
    assert middle.mean() == pytest.approx(np.mean(np.array(HATCH)), abs=20)
    assert np.ptp(middle.mean(axis=2)) > 25, "hatched"


@pytest.mark.parametrize(
    ("provenance", "fact"),
    [({"filled_m2": 0.0}, None), ({"completed": True, "filled_m2": 2.0}, "all of it, an inferred pane")],
    ids=["scanned completely", "completed"],
)
def test_the_card_tells_how_much_was_never_scanned(floor, provenance, fact):
    content, _ = describe(Scene([floor.replaced(provenance=provenance)]))
    assert dict(content["surfaces"][0]["facts"]).get("never scanned") == fact
    assert content["has_filled"] == (fact is not None)
