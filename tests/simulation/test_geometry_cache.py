"""Geometries are shared by content: equal meshes share a geometry, and a changed mesh gets a new one."""

import numpy as np

import radartwin as rt
from radartwin.scene import objects
from radartwin.scene.trajectories import trajectory
from radartwin.simulation import geometry
from radartwin.store.recent import Recent

RADAR = rt.Radar.iwr1843()


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
    small = rt.simulate(scene, RADAR, pose).iq
    mesh.apply_scale(1.5)
    large = rt.simulate(scene, RADAR, pose).iq
    fresh = rt.Scene([rt.Surface(objects.plate(0.15, 0.15), "metal", "plate")])
    np.testing.assert_allclose(large, rt.simulate(fresh, RADAR, pose).iq, rtol=0, atol=1e-5 * np.abs(large).max())
    assert np.abs(large).max() > 1.2 * np.abs(small).max()


def test_values_are_dropped_at_the_limit_the_least_recently_used_first():
    recent, made = Recent[int](limit=5), []
    for key in (1, 2, 1, 3, 2, 9, 9):  # 1 and 2 fit together; 3 drops 2; 2 drops 1; 9 is too large
        recent.get(key, key, lambda key=key: made.append(key) or key)
    assert made == [1, 2, 3, 2, 9, 9]
    assert len(recent) == 2
