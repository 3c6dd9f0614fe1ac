"""Bitmaps repeat without a seam and depend on the seed; textured meshes have true size and survive saving."""

import json
import struct
import time
from typing import Any

import numpy as np
import pytest
import trimesh

from radartwin.errors import SceneError
from radartwin.scene import objects, rooms, textures
from radartwin.scene.mesh_file import TextureWarning, read_meshes
from radartwin.scene.scene import Scene, Surface


def visual(mesh: Any) -> Any:
    """The texture or colours of a mesh; trimesh declares no type for them."""
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
    """The step across the border is no larger than the steps inside, except for joints on the border."""
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


def test_unknown_looks_are_refused():
    with pytest.raises(SceneError, match="no texture 'tweed'"):
        textures.textured(objects.box([0, 0, 0], [1, 1, 1]), "tweed")


@pytest.mark.parametrize("name", ["lab", "atrium", "squash_court"])
def test_rooms_round_trip_with_their_textures(name, tmp_path):
    scene = rooms.room(name, detail="cluttered")
    scene.save(tmp_path)
    again = Scene.load(tmp_path)
    assert again.provenance == scene.provenance
    for a, b in zip(scene, again, strict=True):
        assert (a.name, a.material, a.roughness_m, dict(a.provenance)) == (b.name, b.material, b.roughness_m, dict(b.provenance))
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
    """Saving takes 0.4 s and loading 0.2 s on an idle core."""
    n, count = 36, 208
    u = np.stack(np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n), indexing="ij"), -1).reshape(-1, 2)
    i = np.arange(n * n).reshape(n, n)
    a, b, c, d = i[:-1, :-1].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel(), i[:-1, 1:].ravel()
    faces = np.vstack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    rng = np.random.default_rng(0)
    surfaces = []
    for k in range(count):
        vertices = np.column_stack([u, 0.01 * rng.standard_normal(n * n)]) + np.array([k % 20, k // 20, 0])
        colours = rng.integers(0, 255, (n * n, 4)).astype(np.uint8)
        surfaces.append(Surface(trimesh.Trimesh(vertices, faces, vertex_colors=colours, process=False), "wood", f"s{k}", role="room"))
    assert sum(len(s.mesh.faces) for s in surfaces) > 500_000
    start = time.process_time()
    Scene(surfaces).save(tmp_path)
    again = Scene.load(tmp_path)
    assert time.process_time() - start < 10
    assert sum(len(s.mesh.faces) for s in again) == sum(len(s.mesh.faces) for s in surfaces)
    assert np.array_equal(visual(again.surfaces[7].mesh).vertex_colors, visual(surfaces[7].mesh).vertex_colors)


def write_glb_with_missing_picture(path):
    """Write a red .glb that refers to a picture file that does not exist."""
    scene = trimesh.Scene()
    scene.add_geometry(textures.textured(objects.box([0, 0, 0], [1, 1, 1]), "brick"), geom_name="brick")
    blob = bytes(scene.export(file_type="glb"))  # type: ignore[arg-type]
    size = struct.unpack("<I", blob[12:16])[0]
    header, rest = json.loads(blob[20 : 20 + size]), blob[20 + size :]
    header["images"] = [{"uri": "gone.png"}]
    header["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [1, 0, 0, 1]
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest)) + struct.pack("<I4s", len(text), b"JSON") + text + rest)


def test_a_missing_texture_causes_a_warning_and_the_plain_colour_stays(tmp_path):
    write_glb_with_missing_picture(tmp_path / "room.glb")
    with pytest.warns(TextureWarning, match=r"room\.glb names the texture gone\.png"):
        (mesh,) = read_meshes(tmp_path / "room.glb").values()
    assert visual(mesh).kind == "vertex"
    assert (visual(mesh).vertex_colors == [255, 0, 0, 255]).all()


def test_a_missing_material_file_causes_a_warning(tmp_path):
    path = tmp_path / "room.obj"
    textures.textured(objects.box([0, 0, 0], [1, 1, 1]), "brick").export(path)
    assert visual(next(iter(read_meshes(path).values()))).kind == "texture"
    (tmp_path / "material.mtl").unlink()
    with pytest.warns(TextureWarning, match=r"material\.mtl"):
        assert len(next(iter(read_meshes(path).values())).faces) == 12
