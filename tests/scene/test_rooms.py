"""Textures repeat without a seam and survive saving. Rooms are closed, with free-standing furniture, true materials and clear places."""

import functools
import itertools
from typing import Any

import numpy as np
import pytest
import trimesh

from radartwin.materials import Layered, roughness_m
from radartwin.materials.minc import CATEGORIES
from radartwin.radar.chirp import Radar
from radartwin.scene import objects, rooms, textures
from radartwin.scene.mesh_checks import inside_solid
from radartwin.scene.rooms.parts import DETAILS, FINISHES
from radartwin.scene.scene import Scene, Surface
from radartwin.simulation.backends.static_scene import static_scene


def visual(mesh: Any) -> Any:
    """Return the texture or the colours of a mesh; trimesh declares no type for them."""
    return mesh.visual


@pytest.mark.parametrize("name", sorted(textures.LOOKS))
def test_bitmaps_depend_on_the_seed_have_a_pattern_and_repeat_without_a_seam(name):
    """The step across the border is no larger than the steps inside, except for joints of bricks or tiles on the border."""
    first, look = textures.bitmap(name).copy(), textures.LOOKS[name]
    textures.bitmap.cache_clear()
    assert np.array_equal(first, textures.bitmap(name))
    assert name == "monitor" or first.std(axis=(0, 1)).max() > 0.5
    assert not np.array_equal(first, textures.bitmap(name, 1))
    for axis in () if look.fits or look.wraps or name == "cardboard" else (0, 1):
        inside = np.abs(np.diff(first.astype(float), axis=axis)).mean(axis=(1 - axis, 2))
        border = np.abs(first.take(0, axis).astype(float) - first.take(-1, axis)).mean()
        assert border <= inside.max() * 1.5 + 2


def test_texturing_keeps_triangles_and_normals_and_the_size_of_bricks():
    for width in (1.0, 3.0):
        wall = textures.textured(rooms.rectangle([0, 0, 0], np.eye(3)[0], np.eye(3)[2], (width, 2.0)), "brick")
        look = textures.LOOKS["brick"]
        assert np.ptp(visual(wall).uv, axis=0) * [look.width_m, look.height_m] == pytest.approx([width, 2.0])
    for mesh in (objects.box([0, 0, 0], [1, 2, 3]), objects.cylinder(0.1, 0.3), objects.make("can_211_400")[0].mesh):
        for look in ("wood", "label_red"):
            result = textures.textured(mesh, look)
            assert np.array_equal(result.triangles, mesh.triangles)
            assert np.allclose(result.vertex_normals[result.faces], mesh.vertex_normals[mesh.faces])


def test_textures_and_vertex_and_face_colours_survive_saving(tmp_path):
    built("lab").save(tmp_path / "lab")
    for a, b in zip(built("lab"), Scene.load(tmp_path / "lab"), strict=True):
        assert np.abs(visual(a.mesh).uv - visual(b.mesh).uv).max() < 1e-5
        pictures = [np.asarray(visual(s.mesh).material.baseColorTexture.convert("RGB")) for s in (a, b)]
        assert np.array_equal(pictures[0], pictures[1]), a.name
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


CASES = {
    "lab": {},
    "lab of another size": {"size_m": (8.0, 6.0, 3.2)},
    "atrium": {},
    "atrium of another size": {"size_m": (14.0, 10.0, 6.0)},
    "squash_court": {},
    "squash_court with glass": {"back": "glass"},
}
SHELL = {"floor", "ceiling", "wall_front", "wall_back", "wall_left", "wall_right", "door", "skylight", "door_frame", "transom"}


@functools.cache
def built(case, detail="cluttered"):
    return rooms.room(case.split()[0], detail=detail, **CASES[case])


MAIN = ["lab", "atrium", "squash_court with glass"]


def solids(scene):
    """Return (surface name, connected part of its mesh) for all surfaces except walls, windows and doors."""
    for surface in scene:
        if surface.name in SHELL or surface.name.startswith(("window", "lift", "glass_", "door_left", "door_right")):
            continue
        mesh = trimesh.Trimesh(surface.mesh.vertices, surface.mesh.faces, process=False)
        mesh.merge_vertices()
        for part in mesh.split(only_watertight=False):
            yield surface.name, part


@pytest.mark.parametrize("case", CASES)
def test_the_shell_is_closed_and_faces_inwards(case):
    scene = Scene((s for s in built(case, "shell") if s.name != "tin"), built(case, "shell").provenance)
    length, width, height = scene.provenance["size_m"]
    area = sum(s.mesh.area for s in scene)
    assert area == pytest.approx(2 * (length * width + length * height + width * height))
    flux = sum(float((s.mesh.triangles_center * s.mesh.face_normals).sum(axis=1) @ s.mesh.area_faces) for s in scene)
    assert flux / 3 == pytest.approx(-length * width * height)  # divergence theorem: no gap, no overlap, normals inwards
    assert all(s.kind == "room" for s in scene)


@pytest.mark.parametrize("case", [case for case in CASES if "glass" not in case])
def test_furniture_is_closed_and_touches_neither_walls_nor_other_furniture(case):
    scene = built(case)
    low, high = scene.bounds
    parts = list(solids(scene))
    assert parts
    for name, part in parts:
        assert part.is_watertight, name
        assert part.volume > 0, name
        assert (part.bounds[0] - low).min() > 0.005, name
        assert (high - part.bounds[1]).min() > 0.005, name
    boxes = np.array([part.bounds for _, part in parts])
    for i, j in itertools.combinations(range(len(parts)), 2):
        if (boxes[i, 0] < boxes[j, 1] + 0.002).all() and (boxes[j, 0] < boxes[i, 1] + 0.002).all():
            (a, first), (b, second) = parts[i], parts[j]
            for part, other in ((first, second), (second, first)):
                assert not inside_solid(other, part.vertices).any(), (a, b)
                distance = trimesh.proximity.closest_point_naive(other, part.vertices)[1]
                assert distance.min() > 0.002, (a, b)


@pytest.mark.parametrize("case", MAIN)
def test_every_surface_has_its_true_material(case):
    scene = built(case) + rooms.support(np.array([3.0, 0, 0.4]))
    assert len(set(scene.names)) == len(scene)
    heights = {roughness_m(finish.roughness) for finish in FINISHES.values()}
    for surface in scene:
        truth = surface.provenance
        assert (truth["source"], truth["confidence"]) == ("true", 1.0)
        assert truth["minc"] in CATEGORIES
        assert isinstance(truth["stand_in"], bool)
        assert surface.roughness_m in heights
        assert visual(surface.mesh).kind == "texture", surface.name
    assert all(isinstance(s.material, Layered) for s in scene if s.name.startswith("wall"))
    for name, finish in FINISHES.items():
        layers = finish.material.layers if isinstance(finish.material, Layered) else [(finish.material, 0)]
        assert finish.minc != "metal" or finish.material == "metal", name
        assert finish.minc != "glass" or {material for material, _ in layers} <= {"glass", "air"}, name
        assert finish.minc != "glass" or roughness_m(finish.roughness) == 0


@pytest.mark.parametrize("case", MAIN)
def test_the_tracer_treats_rooms_as_flat_faces_except_for_clutter(case):
    scene = built(case)
    static = static_scene(list(scene.surfaces), Radar.iwr1843())
    assert static.is_flat
    by_tubes = {scene.surfaces[i].name for i in np.unique(static.geometry.surface[static.compact])}
    assert by_tubes <= set(scene.provenance["clutter"])


@pytest.mark.parametrize("name", ["lab", "atrium", "squash_court"])
def test_rover_and_objects_have_a_clear_place(name):
    scene, bench = built(name), rooms.bench(name)
    assert bench.sensor_pose[2, 3] == 0.4
    drive = [bench.sensor_pose[:3, 3] + [0.0, y, 0.0] for y in (-0.6, 0.0, 0.6)]
    scene.check_sensor(np.array(drive + [bench.target_position(d) for d in (0.5, 1.0, 2.0)]))
    for surface in scene:
        if surface.name not in SHELL:
            x, y, _ = surface.mesh.triangles.reshape(-1, 3).T
            beside = (x > 1.0) & (x < bench.target_position(2.0)[0] + 0.3)
            assert not (beside & (np.abs(y) < 0.75)).any(), surface.name


def test_squash_court_is_regulation():
    scene = rooms.squash_court()
    assert np.allclose(scene.bounds, [[0, -3.2, 0], [9.75, 3.2, 5.64]])
    tin = next(s for s in scene if s.name == "tin")
    assert tin.mesh.bounds[1, 2] == pytest.approx(0.48)
    assert 9.75 - tin.mesh.bounds[0, 0] <= 0.045 + 1e-6  # coordinates are float32 numbers
    door = next(s for s in scene if s.name == "door")
    assert np.allclose(door.mesh.extents, [0, 0.9, 2.13])
    glass = rooms.squash_court(back="glass")
    panes = sum(s.mesh.area for s in glass if s.provenance["minc"] == "glass")
    assert 0.9 * 6.4 * 2.13 < panes < 6.4 * 2.13


def test_detail_levels_are_nested_and_a_support_ends_under_its_object():
    shell, furnished, cluttered = (rooms.lab(detail=d).names for d in DETAILS)
    assert cluttered[: len(furnished)] == furnished
    assert furnished[: len(shell)] == shell
    assert rooms.lab(detail="cluttered").without(rooms.CLUTTER).names == furnished
    support = rooms.empty() + rooms.support(np.array([2.5, 0, 0.95]))
    assert np.allclose(support.bounds, [[2.35, -0.15, rooms.GAP], [2.65, 0.15, 0.95]])
    assert {s.kind for s in support} == {"object"}
