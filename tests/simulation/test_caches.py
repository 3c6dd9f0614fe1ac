"""Traced paths come back unchanged from their cache, whose key has all that determines them, and equal meshes share a geometry."""

import dataclasses

import numpy as np
import pytest

import radartwin as rt
from radartwin.scene import objects
from radartwin.scene.trajectories import trajectory
from radartwin.simulation import geometry
from radartwin.simulation.paths import Paths, from_arrays, to_arrays, traced_once
from radartwin.store import array_cache
from radartwin.store.recent import Recent


def paths(count=50, seed=0, poses=3):
    rng = np.random.default_rng(seed)
    unit = rng.normal(size=(2, count, 3))
    amplitude = rng.normal(size=(count, 2)) + 1j * rng.normal(size=(count, 2))
    pose, lengths = np.sort(rng.integers(0, poses, count)), rng.uniform(1, 5, (2, count))
    rest = (lengths[0], lengths[1], unit[0], unit[1], rng.normal(size=count))
    return Paths(poses, pose, np.ones(count, int), amplitude, np.array([77e9, 80e9]), *rest)


IMAGES = dataclasses.replace(paths(25, 1, poses=1), mirror=np.random.default_rng(0).normal(size=(25, 3, 3)))


@pytest.mark.parametrize("parts", [[paths(), IMAGES], [paths(0, poses=1)], []], ids=["two parts", "no paths", "no parts"])
def test_paths_come_back_from_the_folder(tmp_path, parts):
    for _ in range(2):
        with array_cache.in_folder(tmp_path):
            found = traced_once({"rays": 1}, {"poses": np.eye(4)}, lambda: parts)
        assert len(found) == len(parts)
        for one, other in zip(found, parts, strict=True):
            assert isinstance(one.poses, int)
            for field in dataclasses.fields(Paths):
                a, b = getattr(one, field.name), getattr(other, field.name)
                assert np.array_equal(a, b)
                assert np.asarray(a).dtype == np.asarray(b).dtype
    assert len(list(tmp_path.iterdir())) == 1


def test_arrays_of_different_lengths_are_refused():
    arrays = to_arrays([paths()])
    with pytest.raises(ValueError, match="arrival"):
        from_arrays(arrays | {"0.arrival": arrays["0.arrival"][:-1]})


def test_every_setting_and_array_changes_the_key(tmp_path):
    traced = []
    grid = np.arange(6.0)
    choices = [({"a": 1}, {"x": grid}), ({"a": 2}, {"x": grid}), ({"a": 1}, {"y": grid}), ({"a": 1}, {"x": grid[::-1]})]
    with array_cache.in_folder(tmp_path):
        for spec, named in [*choices, *choices]:
            traced_once(spec, named, lambda: traced.append(1) or [paths(3)])
    assert len(traced) == len(choices)


def test_equal_meshes_share_a_geometry_and_its_subsets():
    built = geometry.build([objects.sphere(0.05), objects.plate(0.1, 0.1)])
    again = geometry.build([objects.sphere(0.05), objects.plate(0.1, 0.1)])
    assert again is built
    assert geometry.subset(again, again.surface == 0) is geometry.subset(built, built.surface == 0)
    assert geometry.subset(built, built.surface == 1) is not geometry.subset(built, built.surface == 0)
    assert geometry.build([objects.sphere(0.05)]) is not built


def test_a_mesh_changed_in_place_is_prepared_again():
    mesh = objects.plate(0.1, 0.1)
    scene, pose = rt.Scene([rt.Surface(mesh, "metal", "plate")]), trajectory.pose([-1.0, 0.0, 0.0])[None]
    small = rt.simulate(scene, rt.Radar.iwr1843(), pose).iq
    mesh.apply_scale(1.5)
    large = rt.simulate(scene, rt.Radar.iwr1843(), pose).iq
    fresh = rt.Scene([rt.Surface(objects.plate(0.15, 0.15), "metal", "plate")])
    np.testing.assert_allclose(large, rt.simulate(fresh, rt.Radar.iwr1843(), pose).iq, rtol=0, atol=1e-5 * np.abs(large).max())
    assert np.abs(large).max() > 1.2 * np.abs(small).max()


def test_values_are_dropped_at_the_limit_the_least_recently_used_first():
    recent, made = Recent[int](limit=5), []
    for key in (1, 2, 1, 3, 2, 9, 9):  # 1 and 2 fit together; 3 drops 2; 2 drops 1; 9 is too large
        recent.get(key, key, lambda key=key: made.append(key) or key)
    assert made == [1, 2, 3, 2, 9, 9]
    assert len(recent) == 2
