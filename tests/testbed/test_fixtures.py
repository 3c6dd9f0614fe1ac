"""The simulated laboratory equipment touches no surface, is marked as equipment, and is present only if the option `clutter` is on."""

import dataclasses

import numpy as np
import pytest
import trimesh
from no_gaps import OFF
from scipy.spatial import KDTree

import radartwin as rt
from radartwin.errors import SceneError
from radartwin.scene import rooms
from radartwin.testbed import fixtures, testbed

BENCH = rooms.lab_bench()
TOP = BENCH.target_position(2.0) - [0, 0, 0.05]


def points(surface):
    """Return about one point per square of 8 mm on the surface, and all corners of its mesh."""
    count = max(200, int(surface.mesh.area / 0.008**2))
    return np.vstack([trimesh.sample.sample_surface_even(surface.mesh, min(count, 40_000), seed=0)[0], surface.mesh.vertices])


def check_clear(scene, others=()):
    parts = list(scene)
    clouds = [points(s) for s in parts]
    for i, cloud in enumerate(clouds):
        box = np.array([cloud.min(axis=0), cloud.max(axis=0)])
        rest = [c for j, c in enumerate(clouds) if j != i] + [
            points(s) for s in others if (s.mesh.bounds[0] <= box[1] + 0.05).all() and (s.mesh.bounds[1] >= box[0] - 0.05).all()
        ]
        if rest:
            distance = KDTree(np.vstack(rest)).query(cloud)[0].min()
            assert distance > 0.0095, f"{parts[i].name}: {distance * 1000:.1f} mm"
        assert cloud[:, 2].min() > 0.0095


@pytest.mark.parametrize("distance_m", [0.5, 2.0])
def test_turntable_equipment_touches_no_surface(distance_m):
    top = BENCH.target_position(distance_m) - [0, 0, 0.05]
    rig = fixtures.radar_rig(BENCH.sensor_pose) + fixtures.target_rig(BENCH.sensor_pose, top)
    check_clear(rig, [*rooms.support(top), *(s for s in rooms.lab(detail="cluttered") if s.name != "floor")])
    assert all(s.kind == "object" and s.provenance["fixture"] for s in rig)


def test_rover_is_below_and_behind_its_radar_and_too_low_equipment_is_refused():
    body = fixtures.rover(0.4)
    check_clear([s.moved(trimesh.transformations.translation_matrix([0, 0, 0.4])) for s in body])
    assert set(body.names) == {fixtures.ROVER}
    for part in body:
        high = part.mesh.bounds[1]
        assert high[2] < 0 or high[0] < -0.01  # no equipment is in front of the radar at the height of the radar
    low = BENCH.sensor_pose.copy()
    low[2, 3] = 0.2
    for make in (lambda: fixtures.tripod(low), lambda: fixtures.rover(0.2), lambda: fixtures.turntable_drive(np.array([1, 0, 0.1]))):
        with pytest.raises(SceneError, match="give at least"):
            make()


def test_clutter_gap_adds_the_equipment():
    scene = rt.Scene(rooms.support(TOP)) + fixtures.radar_rig(BENCH.sensor_pose) + fixtures.target_rig(BENCH.sensor_pose, TOP)
    assert set(testbed.truth(scene, OFF, 0).names) == {"turntable", "stand"}
    whole = testbed.truth(scene, dataclasses.replace(OFF, clutter=1.0), 0)
    assert whole.names == scene.names
    half = [len(testbed.truth(scene, dataclasses.replace(OFF, clutter=0.5), s)) - 2 for s in range(200)]
    assert np.mean(half) == pytest.approx((len(scene) - 2) / 2, rel=0.1)
