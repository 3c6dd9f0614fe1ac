"""The generated rooms have closed walls, furniture without contact, true materials on every surface, and free space at the measurement
bench.
"""

import functools
import itertools

import numpy as np
import pytest
import trimesh
from test_textures import visual

from radartwin.materials import Layered, roughness_m
from radartwin.materials.minc import CATEGORIES
from radartwin.radar.chirp import Radar
from radartwin.scene import rooms
from radartwin.scene.checks import inside_solid
from radartwin.scene.rooms.parts import DETAILS, FINISHES
from radartwin.scene.scene import Scene
from radartwin.simulation.backends.static_scene import static_scene

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


@pytest.mark.parametrize("case", CASES)
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
            for mine, other in ((first, second), (second, first)):
                assert not inside_solid(other, mine.vertices).any(), (a, b)
                distance = trimesh.proximity.closest_point_naive(other, mine.vertices)[1]
                assert distance.min() > 0.002, (a, b)


@pytest.mark.parametrize("case", CASES)
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


def test_category_and_material_of_a_finish_agree():
    for name, finish in FINISHES.items():
        if finish.minc == "metal":
            assert finish.material == "metal", name
        if finish.minc == "glass":
            layers = finish.material.layers if isinstance(finish.material, Layered) else [(finish.material, 0)]
            assert {material for material, _ in layers} <= {"glass", "air"}, name
            assert roughness_m(finish.roughness) == 0


@pytest.mark.parametrize("case", CASES)
def test_the_tracer_treats_rooms_as_flat_faces_except_for_clutter(case):
    scene = built(case)
    static = static_scene(list(scene.surfaces), Radar.iwr1843())
    assert static.is_flat
    by_tubes = {scene.surfaces[i].name for i in np.unique(static.geometry.surface[static.compact])}
    assert by_tubes <= set(scene.provenance["clutter"])


@pytest.mark.parametrize("name", ["lab", "atrium", "squash_court"])
def test_rover_and_objects_have_a_clear_place(name):
    scene, bench = rooms.room(name, detail="cluttered"), rooms.bench(name)
    assert bench.sensor_pose[2, 3] == 0.4
    drive = [bench.sensor_pose[:3, 3] + [0.0, y, 0.0] for y in (-0.6, 0.0, 0.6)]
    scene.check_sensor(np.array(drive + [bench.target_position(d) for d in (0.5, 1.0, 2.0)]))
    for surface in scene:
        if surface.name not in SHELL:
            x, y, _ = surface.mesh.triangles.reshape(-1, 3).T
            beside = (x > 1.0) & (x < bench.target_position(2.0)[0] + 0.3)
            assert not (beside & (np.abs(y) < 0.75)).any(), surface.name


def test_detail_levels_are_nested_and_clutter_can_be_left_out():
    shell, furnished, cluttered = (rooms.lab(detail=d).names for d in DETAILS)
    assert cluttered[: len(furnished)] == furnished
    assert furnished[: len(shell)] == shell
    assert rooms.lab(detail="cluttered").without(rooms.CLUTTER).names == furnished


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


def test_court_lines_have_their_regulation_heights():
    """The picture of the squash court's front wall shows a line at the regulation heights, and wall at other heights."""
    wall = next(s for s in rooms.squash_court() if s.name == "wall_front")
    texture = visual(wall.mesh)
    image = np.asarray(texture.material.baseColorTexture).astype(int)
    top = int(np.argmin(np.abs(wall.mesh.vertices[:, 2] - 5.64)))
    assert texture.uv[top, 1] == pytest.approx(1.0)  # v rises with z; row 0 is the top

    def red(height):
        row = image[round((1 - height / 5.64) * (len(image) - 1)), image.shape[1] // 3]
        return row[0] - row[2] > 80

    assert [red(h) for h in (0.9, 1.80, 1.95, 4.40, 4.59, 4.75)] == [False, True, False, False, True, False]


def test_support_ends_under_the_object_and_clears_the_floor():
    scene = rooms.empty() + rooms.support(np.array([2.5, 0, 0.95]))
    assert isinstance(scene, Scene)
    assert np.allclose(scene.bounds, [[2.35, -0.15, rooms.GAP], [2.65, 0.15, 0.95]])
    assert {s.kind for s in scene} == {"object"}
