"""Used as a simulator, Sionna RT gives exact echoes of walls, warns about objects, and always runs in a process of its own."""

from __future__ import annotations

import sys
import warnings

import numpy as np
import pytest
import trimesh

import radartwin as rt
from experiments.validation.backend_crosscheck import RADAR, pose_in, reference
from experiments.validation.path_match import partners
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.materials import reflection
from radartwin.scene import objects, rooms
from radartwin.scene.rooms.parts import FINISHES
from radartwin.scene.trajectories import trajectory
from radartwin.simulation import poses
from radartwin.simulation.backends import sionna, sionna_scene
from radartwin.simulation.backends.backend import backend
from radartwin.simulation.backends.mitsuba import MitsubaBackend, TraceSettings
from radartwin.simulation.paths import Paths

WAVELENGTH = SPEED_OF_LIGHT / RADAR.center_frequency_hz
HERE = np.eye(4)[None]
FACING = np.diag([-1.0, -1.0, 1.0, 1.0])


def at(x: float, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    return trajectory.pose([x, y, z])


def mirror_db(distance_m: float) -> float:
    return 20 * np.log10(WAVELENGTH / (8 * np.pi * distance_m))


def told(scene: rt.Scene, **settings: object) -> tuple[list[Paths], list[str]]:
    """Return the paths that Sionna finds from the origin, and the warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        parts = backend("sionna", **settings).paths(scene, RADAR, HERE)
    return parts, [str(one.message) for one in caught]


def level_db(parts: list[Paths]) -> float:
    return float(20 * np.log10(np.abs(parts[0].amplitude[0]).mean()))


def test_sionna_and_the_tracer_use_separate_processes():
    """The test calls Sionna and our tracer alternately, because they need different Mitsuba variants. The test's own process never imports
    Sionna. The mean over the sweep is compared, because our tracer adds the echoes of the wall's edges.
    """
    wall = rt.Scene([rt.Surface(objects.plate(4, 4).apply_transform(at(3.0)), "metal", "wall", role="room")])
    first, own, again = (np.abs(rt.simulate(wall, RADAR, HERE, simulator=name).iq).mean() for name in ("sionna", "mitsuba", "sionna"))
    import mitsuba

    assert str(mitsuba.variant()).endswith("_rgb")
    assert not [name for name in sys.modules if name.partition(".")[0] == "sionna"]
    assert first == again
    assert 20 * np.log10(first / own) == pytest.approx(0, abs=0.1)


@pytest.mark.parametrize("finish", ["plaster wall", "board floor", "court floor", "wood panelling", "window", "metal", "concrete"])
def test_tables_interpolate_layered_walls(finish):
    material, roughness = FINISHES[finish].material, 1e-4
    te, tm, row, frequencies = sionna_scene.reflection_tables([(material, roughness)], RADAR)
    assert row.tolist() == [0]
    grid = np.linspace(0, 1, te.shape[1])
    cosine = np.linspace(0.005, 1, 7919)
    for table, exact in zip((te, tm), reflection(material, cosine[:, None], frequencies, roughness), strict=True):
        for q in range(len(frequencies)):
            read = np.interp(cosine, grid, np.real(table[0, :, q])) + 1j * np.interp(cosine, grid, np.imag(table[0, :, q]))
            assert np.abs(read - exact[:, q]).max() < 3e-3


def test_every_path_of_a_room_is_an_exact_image():
    """Complex amplitudes agree with image sources for layered walls, door and window, up to four bounces and a rotated antenna."""
    scene, pose = rooms.room("lab", detail="shell"), pose_in("lab", 0, 0)
    found, images = reference("Sionna, co-located", scene, pose).strong(40.0), reference("image sources", scene, pose)
    index = partners(found, images)
    assert len(index) >= 10
    assert (index >= 0).all()
    ratio = found.amplitude / images.amplitude[index]
    assert np.median(np.abs(ratio - 1)) < 5e-3
    assert np.abs(ratio - 1).max() < 0.05
    assert np.abs(found.length_m - images.length_m[index]).max() < 1e-5


@pytest.mark.filterwarnings("ignore:sionna:UserWarning")
def test_elements_see_the_same_images_as_with_the_tracer():
    """Sionna's mirror planes come from the facets of its paths, those of the tracer from panels."""
    scene, pose = rooms.room("lab", detail="shell"), pose_in("lab", 1, 0)
    (theirs,) = backend("sionna", max_bounces=2).paths(scene, RADAR, pose[None])
    mine = MitsubaBackend(TraceSettings(room="panels", diffuse=False, max_bounces=2)).paths(scene, RADAR, pose[None])[0]
    assert theirs.mirror is not None
    assert mine.mirror is not None
    seen = 0
    for i in range(len(theirs)):
        same = (np.abs(mine.length_m - theirs.length_m[i]) < 1e-6) & (np.abs(mine.arrival - theirs.arrival[i]).max(axis=1) < 1e-6)
        if same.any():
            seen += 1
            assert np.abs(mine.mirror[same] - theirs.mirror[i]).max(axis=(1, 2)).min() < 1e-9
    assert seen >= 6


@pytest.mark.filterwarnings("ignore:sionna:UserWarning")
def test_rates_match_length_differences():
    """The range rates of paths agree with differences of path lengths between frames, while sensor and plate both move and turn."""
    turn = [trimesh.transformations.rotation_matrix(np.radians(0.05 * f), [0.2, 0.3, 1]) for f in range(2)]
    sensor = np.array([at(0.001 * f, 0.0005 * f) @ turn[f] for f in range(2)])
    plate = np.array([at(2 + 0.002 * f, 0.05, 0.02 - 0.001 * f) @ turn[f] for f in range(2)])
    wall = rt.Surface(objects.plate(4, 4).apply_transform(at(5.0)), "concrete", "wall", role="room")
    floor = rt.Surface(objects.box((-1, -3, -1.01), (6, 3, -1.0)), "concrete", "floor", role="room")
    scene = rt.Scene([wall, floor, rt.Surface(objects.plate(0.6, 0.6), "metal", "plate")])
    (found,) = backend("sionna", max_bounces=2, separation_m=0.03).paths(scene, RADAR, sensor, {"plate": plate})
    before, after = found.frames(0, 1), found.frames(1, 2)
    checked = 0
    for i in range(len(before)):
        near = np.abs(after.length_m - before.length_m[i] - before.rate_mps[i] / RADAR.frame_rate_hz)
        same = near.argmin()
        if (after.bounces[same] == before.bounces[i]) and np.abs(after.arrival[same] - before.arrival[i]).max() < 0.01:
            checked += abs(before.rate_mps[i]) > 1e-3
            assert near[same] < 2e-5  # the limit is the second-order change of the path length within a frame
    assert checked >= 2  # the wall path changes by the sensor's motion, the plate path by both motions


def test_objects_without_mirror_point_are_reported():
    trihedral = rt.Scene([rt.Surface(objects.trihedral(0.1).apply_transform(at(2.0) @ FACING), "metal", "reflector")])
    for separation in (0.0, 0.02):
        parts, texts = told(trihedral, separation_m=separation)
        assert parts == []
        assert len(texts) == 1
        assert "no path over 'reflector'" in texts[0]
    parts, texts = told(rt.Scene([rt.Surface(objects.sphere(0.05).apply_transform(at(2.0)), "metal", "ball")]))
    assert (parts, "'ball'" in texts[0]) == ([], True)


def test_each_limit_is_reported_once():
    scene = rt.Scene([rt.Surface(objects.sphere(0.05).apply_transform(at(2.0)), "metal", "ball told once")])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")  # the default warning filter of Python outside of tests
        for _ in range(3):
            rt.simulate(scene, RADAR, HERE, simulator="sionna")
    assert ["'ball told once'" in str(one.message) for one in caught] == [True]


@pytest.mark.parametrize(("size_m", "excess_db"), [(0.02, 19.8), (0.05, 3.8), (0.2, None)])
def test_plate_of_any_size_returns_the_level_of_a_mirror(size_m, excess_db):
    parts, texts = told(rt.Scene([rt.Surface(objects.plate(size_m, size_m).apply_transform(at(2.0)), "metal", "small plate")]))
    assert level_db(parts) == pytest.approx(mirror_db(2.0), abs=0.1)
    if excess_db is None:
        assert texts == []
    else:
        (text,) = texts
        assert f"the echo of 'small plate' has the level of an infinite mirror, {excess_db} dB more than that of its area" in text
        assert excess_db == pytest.approx(20 * np.log10(RADAR.wavelength_m * 2.0 / (2 * size_m**2)), abs=0.1)


def test_roughness_weakens_the_mirror_reflection():
    rough, smooth = (
        rt.Scene([rt.Surface(objects.plate(4, 4).apply_transform(at(3.0)), "metal", "wall", roughness_m=r, role="room")])
        for r in (3e-4, 0.0)
    )
    lost = level_db(told(rough, max_bounces=1)[0]) - level_db(told(smooth)[0])
    assert lost == pytest.approx(-20 * np.log10(np.e) * 2 * (2 * np.pi / WAVELENGTH * 3e-4) ** 2, abs=0.05)


@pytest.mark.filterwarnings("ignore:sionna:UserWarning")
def test_moving_plate_hides_the_wall_behind_it():
    """When a plate slides in front of a wall, the path from the radar to the wall disappears."""
    wall = rt.Surface(objects.plate(4, 4).apply_transform(at(3.0)), "metal", "wall", role="room")
    plate = rt.Surface(objects.plate(0.5, 0.5), "metal", "plate")
    course = np.array([at(2.0, 1.0), at(2.0, 0.01)])
    (found,) = backend("sionna", max_bounces=1).paths(rt.Scene([wall, plate]), RADAR, poses.repeated(HERE, 2), {"plate": course})
    assert found.pose.tolist() == [0, 1]
    assert np.round(found.length_m / 2, 6).tolist() == [3.0, 2.0]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:sionna:UserWarning")
@pytest.mark.parametrize("room", ["lab", "atrium", "squash_court"])
def test_default_rays_find_the_paths_of_ten_times_as_many(room):
    scene, pose = rooms.room(room, detail="furnished"), pose_in(room, 0, 0)[None]
    few, many = (backend("sionna", rays=rays).paths(scene, RADAR, pose)[0] for rays in (None, 10 * sionna.RAYS))
    level = 20 * np.log10(np.abs(many.amplitude).mean(axis=1))
    for i in np.flatnonzero(level > level.max() - 40):
        assert (np.abs(few.length_m - many.length_m[i]) < 1e-6).any()
