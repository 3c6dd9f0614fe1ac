"""Texture bitmaps repeat without a visible border and depend on the seed. Textured meshes have their true size and are unchanged by saving
and loading.
"""

import time
from typing import Any

import numpy as np
import pytest
import trimesh

from radartwin.scene import objects, rooms, textures
from radartwin.scene.scene import Scene, Surface


def visual(mesh: Any) -> Any:
    """Return the texture or the colours of a mesh; trimesh declares no type for them."""
    return mesh.visual


@pytest.mark.parametrize("name", sorted(textures.LOOKS))
def test_bitmaps_depend_on_the_seed_and_have_a_pattern(name):
    first = textures.bitmap(name).copy()
    textures.bitmap.cache_clear()
    assert np.array_equal(first, textures.bitmap(name))
    if name not in ("monitor",):
        assert first.std(axis=(0, 1)).max() > 0.5
    assert not np.array_equal(first, textures.bitmap(name, 1))


@pytest.mark.parametrize("name", [n for n, look in textures.LOOKS.items() if not (look.fits or look.wraps or n == "cardboard")])
def test_bitmaps_repeat_without_a_seam(name):
    """The brightness step across the border of the bitmap is no larger than the steps inside, except for joints of bricks or tiles on the
    border.
    """
    image = textures.bitmap(name).astype(float)
    for axis in (0, 1):
        inside = np.abs(np.diff(image, axis=axis)).mean(axis=(1 - axis, 2))
        border = np.abs(image.take(0, axis) - image.take(-1, axis)).mean()
        assert border <= inside.max() * 1.5 + 2


def test_bricks_have_the_same_size_on_every_wall():
    for width in (1.0, 3.0):
        wall = textures.textured(rooms.rectangle([0, 0, 0], np.eye(3)[0], np.eye(3)[2], (width, 2.0)), "brick")
        assert np.ptp(visual(wall).uv[:, 0]) * textures.LOOKS["brick"].width_m == pytest.approx(width)
        assert np.ptp(visual(wall).uv[:, 1]) * textures.LOOKS["brick"].height_m == pytest.approx(2.0)


def test_texturing_keeps_triangles_and_normals():
    for mesh in (objects.box([0, 0, 0], [1, 2, 3]), objects.cylinder(0.1, 0.3), objects.make("can_211_400")[0].mesh):
        for look in ("wood", "label_red"):
            result = textures.textured(mesh, look)
            assert np.array_equal(result.triangles, mesh.triangles)
            assert np.allclose(result.vertex_normals[result.faces], mesh.vertex_normals[mesh.faces])


def test_a_room_round_trips_with_its_textures(tmp_path):
    scene = rooms.room("lab", detail="cluttered")
    scene.save(tmp_path)
    for a, b in zip(scene, Scene.load(tmp_path), strict=True):
        assert np.abs(visual(a.mesh).uv - visual(b.mesh).uv).max() < 1e-5
        pictures = [np.asarray(visual(s.mesh).material.baseColorTexture.convert("RGB")) for s in (a, b)]
        assert np.array_equal(pictures[0], pictures[1]), a.name


def test_vertex_and_face_colours_survive_saving(tmp_path):
    box = objects.box([0, 0, 0], [1, 1, 1])
    colours = np.random.default_rng(0).integers(0, 255, (len(box.vertices), 4)).astype(np.uint8)
    painted = trimesh.Trimesh(box.vertices, box.faces, vertex_colors=colours, process=False)
    sides = trimesh.Trimesh(box.vertices, box.faces, face_colors=np.repeat(colours[:6], 2, axis=0), process=False)
    Scene([Surface(painted, "wood", "vertices"), Surface(sides, "wood", "faces"), Surface(box, "wood", "none")]).save(tmp_path)
    vertices, faces, none = Scene.load(tmp_path)
    assert np.array_equal(visual(vertices.mesh).vertex_colors, colours)
    assert np.array_equal(visual(faces.mesh).vertex_colors, np.repeat(colours[:6], 4, axis=0))
    assert visual(none.mesh).kind != "texture"
    Scene.load(tmp_path).save(tmp_path / "again")
    assert (tmp_path / "again" / "scene.glb").read_bytes() == (tmp_path / "scene.glb").read_bytes()


def test_half_a_million_faces_are_saved_and_loaded_in_seconds(tmp_path):
    """On an idle core, saving takes 0.4 s and loading takes 0.2 s."""
    ball = trimesh.creation.icosphere(subdivisions=6)
    ball.visual.vertex_colors = np.random.default_rng(0).integers(0, 255, (len(ball.vertices), 4)).astype(np.uint8)  # type: ignore[union-attr]
    surfaces = [Surface(ball, "wood", f"s{k}", role="room") for k in range(7)]
    start = time.process_time()
    Scene(surfaces).save(tmp_path)
    again = Scene.load(tmp_path)
    assert time.process_time() - start < 10
    assert sum(len(s.mesh.faces) for s in again) == 7 * len(ball.faces) > 500_000
    assert np.array_equal(visual(again.surfaces[3].mesh).vertex_colors, visual(ball).vertex_colors)
