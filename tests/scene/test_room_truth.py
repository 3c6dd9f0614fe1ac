"""Every procedural room: closed shell, closed furniture clear of everything else, the truth on every surface, panels throughout."""

import itertools
from typing import Any

import numpy as np
import pytest
import trimesh

from radartwin.errors import SceneError
from radartwin.materials import Layered, roughness_m
from radartwin.materials.minc import CATEGORIES
from radartwin.scene import rooms
from radartwin.scene.checks import inside_solid
from radartwin.simulation import geometry
from radartwin.simulation.flat import panel_room

CASES = {
    "lab": {},
    "atrium": {},
    "atrium without a skylight": {"skylight": False},
    "squash_court": {},
    "squash_court with glass": {"back": "glass"},
}


def visual(mesh: Any) -> Any:
    """A mesh's texture or colours; trimesh declares neither."""
    return mesh.visual


def built(case, detail="cluttered"):
    return rooms.room(case.split()[0], detail=detail, **CASES[case])


def solids(scene):
    """(surface name, closed part) of everything that is no wall."""
    for surface in scene:
        if surface.name in SHELL or surface.name.startswith(("window", "lift", "glass_", "door_left", "door_right")):
            continue
        mesh = trimesh.Trimesh(surface.mesh.vertices, surface.mesh.faces, process=False)
        mesh.merge_vertices()
        for part in mesh.split(only_watertight=False):
            yield surface.name, part


SHELL = {"floor", "ceiling", "wall_front", "wall_back", "wall_left", "wall_right", "door", "skylight", "door_frame", "transom"}


@pytest.mark.parametrize("case", CASES)
def test_the_shell_is_closed_and_faces_inwards(case):
    scene = built(case, "shell").without({"tin"} & set(built(case, "shell").names))
    length, width, height = scene.provenance["size_m"]
    area = sum(s.mesh.area for s in scene)
    assert area == pytest.approx(2 * (length * width + length * height + width * height))
    flux = sum(float((s.mesh.triangles_center * s.mesh.face_normals).sum(axis=1) @ s.mesh.area_faces) for s in scene)
    assert flux / 3 == pytest.approx(-length * width * height)  # divergence theorem: no gap, no overlap, normals inwards


@pytest.mark.parametrize("case", CASES)
def test_furniture_is_closed_clear_of_walls_and_of_all_else(case):
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
def test_every_surface_carries_its_truth(case):
    scene = built(case) + rooms.support(np.array([3.0, 0, 0.4]))
    assert len(set(scene.names)) == len(scene)
    heights = {roughness_m(finish.roughness) for finish in rooms.FINISHES.values()}
    for surface in scene:
        truth = surface.provenance
        assert (truth["source"], truth["confidence"]) == ("true", 1.0)
        assert truth["minc"] in CATEGORIES
        assert isinstance(truth["stand_in"], bool)
        assert surface.roughness_m in heights
        assert visual(surface.mesh).kind == "texture", surface.name
    layered = [s.name for s in scene if s.name.startswith("wall")]
    assert all(isinstance(s.material, Layered) for s in scene if s.name in layered)


def test_finishes_agree_with_themselves():
    for name, finish in rooms.FINISHES.items():
        if finish.minc == "metal":
            assert finish.material == "metal", name
        if finish.minc == "glass":
            layers = finish.material.layers if isinstance(finish.material, Layered) else [(finish.material, 0)]
            assert {material for material, _ in layers} <= {"glass", "air"}, name
            assert roughness_m(finish.roughness) == 0
    assert rooms.FINISHES["tiled floor"].stand_in
    assert not rooms.FINISHES["court wall"].stand_in


@pytest.mark.parametrize("case", CASES)
def test_rooms_are_flat_to_the_tracer_and_nothing_of_theirs_is_left_to_tubes(case):
    for detail in ("furnished", "cluttered"):
        scene = built(case, detail)
        merged = geometry.build([s.mesh for s in scene])
        found = panel_room.build(scene.surfaces, merged, None)  # type: ignore[arg-type]
        assert found.is_flat(scene.surfaces)
        by_tubes = {scene.surfaces[i].name for i in np.unique(merged.surface[found.compact])}
        assert by_tubes <= set(scene.provenance["clutter"])


@pytest.mark.parametrize("name", ["lab", "atrium", "squash_court"])
def test_rover_and_objects_have_a_clear_place(name):
    scene, bench = rooms.room(name, detail="cluttered"), rooms.bench(name)
    assert bench.sensor_pose[2, 3] == 0.4
    ways = [bench.sensor_pose[:3, 3] + [0.0, y, 0.0] for y in (-0.6, 0.0, 0.6)] + [
        bench.target_position(d) for d in rooms.ROVER_DISTANCES_M
    ]
    scene.check_sensor(np.array(ways))
    for surface in scene:
        if surface.name not in SHELL:
            away = np.abs(surface.mesh.triangles.reshape(-1, 3)[:, 1])
            ahead = surface.mesh.triangles.reshape(-1, 3)[:, 0]
            beside = (ahead > 1.0) & (ahead < bench.target_position(2.0)[0] + 0.3)
            assert not (beside & (away < 0.75)).any(), surface.name


def test_squash_court_is_regulation():
    scene = rooms.squash_court()
    assert np.allclose(scene.bounds, [[0, -3.2, 0], [9.75, 3.2, 5.64]])
    tin = next(s for s in scene if s.name == "tin")
    assert tin.mesh.bounds[1, 2] == pytest.approx(0.48)
    assert 9.75 - tin.mesh.bounds[0, 0] <= 0.045 + 1e-9
    door = next(s for s in scene if s.name == "door")
    assert np.allclose(door.mesh.extents, [0, 0.9, 2.13])
    glass = rooms.squash_court(back="glass")
    panes = sum(s.mesh.area for s in glass if s.provenance["minc"] == "glass")
    assert 0.9 * 6.4 * 2.13 < panes < 6.4 * 2.13


def test_court_lines_are_where_the_rules_have_them():
    """The front wall's picture, read back at heights: line, wall, line."""
    wall = next(s for s in rooms.squash_court() if s.name == "wall_front")
    worn = visual(wall.mesh)
    image = np.asarray(worn.material.baseColorTexture).astype(int)
    up = int(np.argmin(np.abs(wall.mesh.vertices[:, 2] - 5.64)))
    assert worn.uv[up, 1] == pytest.approx(1.0)  # v rises with z; row 0 is the top

    def red(height):
        row = image[round((1 - height / 5.64) * (len(image) - 1)), image.shape[1] // 3]
        return row[0] - row[2] > 80

    assert [red(h) for h in (0.9, 1.80, 1.95, 4.40, 4.59, 4.75)] == [False, True, False, False, True, False]


@pytest.mark.parametrize("size", [(10.0, 8.0, 3.5), (14.0, 10.0, 6.0)])
def test_the_atrium_grows_and_shrinks(size):
    assert np.allclose(np.ptp(rooms.atrium(size).bounds, axis=0), size)


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("attic", {}, "choose lab, atrium, squash_court"),
        ("lab", {"back": "glass"}, "no option 'back'; it takes size_m, detail"),
        ("atrium", {"size_m": (3, 3, 3)}, "at least 10.0 x 8.0 x 3.5"),
        ("atrium", {"size_m": (12, 9)}, "2 numbers"),
        ("squash_court", {"back": "brick"}, "choose solid or glass"),
        ("squash_court", {"detail": "messy"}, "choose shell, furnished"),
    ],
)
def test_what_a_room_refuses(name, options, words):
    with pytest.raises(SceneError, match=words):
        rooms.room(name, **options)


def test_free_space_has_no_surfaces():
    assert len(rooms.room("empty")) == len(rooms.room("void")) == 0
    assert rooms.room("void").provenance["room"] == "void"


def test_rooms_are_the_same_every_time_and_differ_by_seed():
    first, again, other = (rooms.atrium(seed=s) for s in (0, 0, 1))
    for a, b in zip(first, again, strict=True):
        assert np.array_equal(a.mesh.vertices, b.mesh.vertices)
        assert np.array_equal(visual(a.mesh).uv, visual(b.mesh).uv)
    pictures = [np.asarray(visual(s.surfaces[0].mesh).material.baseColorTexture) for s in (first, again, other)]
    assert np.array_equal(pictures[0], pictures[1])
    assert not np.array_equal(pictures[0], pictures[2])
