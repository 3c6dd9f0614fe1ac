"""The picture crops for material questions show their surface, are taken from photographs if possible, and are the same in every run."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image
from ray_casting import first_hits
from trimesh import Trimesh
from trimesh.visual import ColorVisuals, TextureVisuals

from radartwin.errors import InputError, MissingError, PoseError
from radartwin.label.answers import FINISH_WORDS
from radartwin.label.crops import Crop, Views
from radartwin.label.photos import load_photos, save_photos
from radartwin.label.questions import LOOKS, MEANINGS, prompt, questions
from radartwin.label.z_buffer import Camera, Drawing
from radartwin.materials.minc import CATEGORIES
from radartwin.scene import objects, rooms
from radartwin.scene.scene import Scene, Surface


def box_room() -> Scene:
    """Return a room of 4 x 3 x 2.5 m with a floor, four walls and a red box in front of the wall at x = 4."""
    x, y, z = np.eye(3)
    walls = {
        "floor": rooms.rectangle([0, 0, 0], x, y, (4, 3)),
        "far": rooms.rectangle([4, 3, 0], -y, z, (3, 2.5)),
        "near": rooms.rectangle([0, 0, 0], y, z, (3, 2.5)),
        "left": rooms.rectangle([0, 3, 0], x, z, (4, 2.5)),
        "right": rooms.rectangle([4, 0, 0], -x, z, (4, 2.5)),
        "box": objects.box([3.0, 1.0, 0.0], [3.5, 2.0, 1.0]),
    }
    shades = {"floor": [120, 80, 40], "far": [230, 230, 230], "box": [200, 30, 30]}
    surfaces = []
    for name, mesh in walls.items():
        mesh.visual = ColorVisuals(mesh, vertex_colors=np.tile([*shades.get(name, [180, 180, 200]), 255], (len(mesh.vertices), 1)))
        surfaces.append(Surface(mesh, "concrete", name, role="room"))
    return Scene(surfaces)


def pixels(crop: Crop) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(crop.jpeg)))


def eye_at(position: list[float], target: list[float], width: int = 640, height: int = 480) -> Camera:
    square = Camera.looking(np.array(position), np.array(target), 70, width)
    return square.part(-0.5, (width - height) / 2 - 0.5, width - 0.5, (width + height) / 2 - 0.5, width, height)


def test_depth_agrees_with_an_independent_ray_caster() -> None:
    scene = rooms.lab(detail="furnished")
    camera = Camera.looking(np.array([1.0, 0.3, 1.2]), np.array([5.0, -0.4, 0.9]), 70, 48)
    seen = Drawing(scene).seen(camera)
    rows, columns = np.indices(seen.depth.shape)
    rays = np.stack([columns, rows, np.ones(seen.depth.shape)], -1).reshape(-1, 3) @ np.linalg.inv(camera.intrinsics).T
    depth = first_hits(camera.pose[:3, 3], rays @ camera.pose[:3, :3].T, np.concatenate([s.mesh.triangles for s in scene]), least=0.05)
    same = np.isclose(depth.reshape(seen.depth.shape), seen.depth, atol=1e-4)
    assert same.mean() > 0.995, "all but rays along edges"
    floor = Surface(rooms.rectangle([-50, -50, 0], np.eye(3)[0], np.eye(3)[1], (99, 99)), "concrete", "floor", role="room")
    depth = Drawing(Scene([floor])).seen(Camera.looking(np.array([0, 0, 1.0]), np.array([1.0, 0, 1.0]), 90, 65)).depth
    assert np.isinf(depth[:32]).all(), "above the horizon"
    rows = np.arange(34, 65)
    assert np.allclose(depth[rows, 32], 32.5 / (rows - 32.0)), "z = height focal / (row - middle), also behind the camera plane"


def test_colours_of_vertices_faces_and_textures_are_drawn() -> None:
    wall = rooms.rectangle([2, 1, 0], -np.eye(3)[1], np.eye(3)[2], (2, 2))
    camera = Camera.looking(np.array([0, 0, 1.0]), np.array([2.0, 0, 1.0]), 60, 33)
    uv = np.column_stack([(1 - wall.vertices[:, 1]) / 2, wall.vertices[:, 2] / 2])
    image = Image.new("RGB", (2, 2))
    image.putdata([(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255)])  # pixels row by row, the top row first
    looks = {
        "vertex": ColorVisuals(wall, vertex_colors=np.tile([10, 200, 30, 255], (len(wall.vertices), 1))),
        "face": ColorVisuals(wall, face_colors=np.tile([10, 200, 30, 255], (len(wall.faces), 1))),
        "texture": TextureVisuals(uv, image=image),
    }
    for name, visual in looks.items():
        mesh = wall.copy()
        mesh.visual = visual
        drawing = Drawing(Scene([Surface(mesh, "wood", "wall")]))
        picture = drawing.picture(camera, drawing.seen(camera))
        if name == "texture":
            assert [picture[place].argmax() for place in ((8, 8), (8, 24), (24, 8))] == [0, 1, 2], "top left, top right, bottom left"
        else:
            assert np.allclose(picture[16, 16], [10, 200, 30], atol=4), name


def test_every_surface_has_three_deterministic_crops_with_outline_surroundings_and_the_colours_of_a_scan_file() -> None:
    scene = box_room()
    crops = Views(scene).crops(range(len(scene)))
    assert [crop.jpeg for crop in Views(scene).crops([5])[5]] == [crop.jpeg for crop in crops[5]]
    for index, found in crops.items():
        name = scene.surfaces[index].name
        assert len(found) == 3, name
        assert len({crop.digest for crop in found}) == 3
        for crop in found:
            picture = pixels(crop).astype(int)
            assert max(picture.shape[:2]) == 512
            assert 0.02 < crop.share < 0.75, f"{name}: surroundings are shown"
            magenta = (picture[..., 0] > 150) & (picture[..., 1] < 110) & (picture[..., 2] > 150)
            assert magenta.sum() > 300, name
    box = crops[5]
    assert box[2].share < 0.5 * box[0].share, "the last crop is wide"
    blue = [s.replaced(mesh=Trimesh(s.mesh.vertices, s.mesh.faces, vertex_colors=[20, 40, 220], process=False)) for s in scene]
    shown, own = pixels(Views(scene, textured=Scene(blue)).crops([5])[5][0]).astype(int), pixels(box[0]).astype(int)
    assert (shown[..., 2] > shown[..., 0] + 50).mean() > 0.5, "the colours are those of the scan file"
    outlines = [(picture[..., 0] > 150) & (picture[..., 1] < 110) & (picture[..., 2] > 150) for picture in (shown, own)]
    assert (outlines[0] == outlines[1]).mean() > 0.99, "the outline is that of the surface"


def test_photographs_are_used_only_if_they_show_the_surface(tmp_path) -> None:
    scene = box_room()
    drawing = Drawing(scene)
    low, high = eye_at([0.4, 1.5, 0.5], [4, 1.5, 0.5]), eye_at([0.4, 1.5, 1.6], [4, 1.5, 1.2])
    shots = [(drawing.picture(camera, drawing.seen(camera)), camera.pose, camera.intrinsics) for camera in (low, high)]
    # this camera looks away from the surface
    shots.append((np.zeros((480, 640, 3), np.uint8), eye_at([-1, 1.5, 1.5], [-4, 1.5, 1.5]).pose, high.intrinsics))

    save_photos(tmp_path, shots)
    crops = Views(scene, load_photos(tmp_path), 2).crops(range(len(scene)))
    by_name = {scene.surfaces[index].name: found for index, found in crops.items()}
    assert {crop.origin for crop in by_name["box"]} == {"photo"}
    assert [crop.origin for crop in by_name["near"]] == ["mesh", "mesh"], "no photograph shows the wall behind the camera"
    box = pixels(by_name["box"][0]).reshape(-1, 3).astype(int)
    assert ((box[:, 0] > 120) & (box[:, 1] < 80) & (box[:, 2] < 80)).mean() > 0.1, "the red box is in its crop"


def test_photographs_round_trip_and_invalid_files_are_named(tmp_path) -> None:
    camera = eye_at([0, 0, 1], [1, 0, 1], 32, 24)
    save_photos(tmp_path, [(np.full((24, 32, 3), 100, np.uint8), camera.pose, camera.intrinsics)])
    [loaded] = load_photos(tmp_path)
    assert np.array_equal(loaded.pose, camera.pose)
    assert np.array_equal(loaded.intrinsics, camera.intrinsics)
    assert np.abs(loaded.pixels().astype(int) - 100).max() <= 1
    assert load_photos(tmp_path / "none") == []
    loaded.path.write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"00000\.jpg cannot be read"):
        loaded.pixels()
    loaded.path.unlink()
    with pytest.raises(MissingError, match=r"is missing, though photos\.json names it"):
        loaded.pixels()
    save_photos(tmp_path, [(np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4)), np.eye(3))])
    with pytest.raises(PoseError, match="not a rigid"):
        load_photos(tmp_path)
    (tmp_path / "photos.json").write_text("{}")
    with pytest.raises(InputError, match=r"photos\.json is not a radartwin-photos"):
        load_photos(tmp_path)


def test_question_has_the_geometry_and_not_the_material() -> None:
    scene = Scene([s.replaced(name=f"secret_{s.name}", material="detergent", provenance={"minc": "leather"}) for s in box_room()])
    asked = questions(scene, views=1)
    assert not any(word in question.text for question in asked for word in ("secret", "detergent"))
    texts = {scene.surfaces[q.surface].name: q.text for q in asked}
    assert "4.0 m x 3.0 m, flat, level, facing up, its middle 0.0 m above" in texts["secret_floor"]
    assert "3.0 m x 2.5 m, flat, upright, its middle 1.2 m above" in texts["secret_far"]
    assert "1.0 m x 1.0 m x 50 cm, not flat" in texts["secret_box"]
    assert len({q.key for q in asked}) == 6


def test_prompt_names_all_categories_and_finishes_and_asks_for_the_contents_of_objects() -> None:
    assert (tuple(MEANINGS), tuple(LOOKS)) == (CATEGORIES, FINISH_WORDS)
    surface, thing = prompt("surface", "flat", ["photo"] * 3), prompt("object", "round", ["mesh"])
    assert all(f"- {word}: " in surface for word in (*CATEGORIES, *FINISH_WORDS))
    assert "wall_thickness_mm" in thing
    assert "wall_thickness_mm" not in surface
