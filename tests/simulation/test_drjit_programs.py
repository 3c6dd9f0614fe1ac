"""Dr.Jit shares the cores, and replays its programs with equal results."""

import numpy as np
import pytest

import radartwin as rt
from radartwin import compiled
from radartwin.scene import objects
from radartwin.scene.trajectories import trajectory
from radartwin.simulation import variant


@pytest.fixture(scope="module", autouse=True)
def active():
    variant.activate()


def test_threads_follow_the_share_of_the_cores(monkeypatch):
    import drjit as dr

    for cores in (1, 2):
        monkeypatch.setattr(variant, "cores", lambda cores=cores: cores)
        variant.share_threads()
        assert dr.thread_count() == cores
    monkeypatch.setattr(variant, "cores", compiled.cores)
    variant.share_threads()


CALLS = ((0.05, 1.0, 1, None), (0.05, 1.2, 1, 3000), (0.03, 0.7, 1, None), (0.05, 1.1, 3, None), (0.05, 1.4, 5, 500))


@pytest.mark.parametrize("material", ["metal", "glass"])
def test_replays_equal_the_program(monkeypatch, material):
    """The calls differ in radius, distance, number of poses and number of tubes. All metal spheres share some recordings."""
    from radartwin.simulation.curved import tracer

    programs = tracer._SINGLE_BOUNCE.values()

    def signals():
        out = []
        for radius, distance, poses, rays in CALLS:
            scene = rt.Scene([rt.Surface(objects.sphere(radius), material, "ball")])
            sensor = np.array([trajectory.pose([-distance, 0.01 * k, 0.02]) for k in range(poses)])
            out.append(rt.simulate(scene, rt.Radar.iwr1843(), sensor, rays=rays).iq)
        return out, sum(program.n_recordings for program in programs)

    _, before = signals()
    replayed, after = signals()
    assert before == after
    for program in programs:
        monkeypatch.setattr(program, "enabled", False)
    for found, expected in zip(replayed, signals()[0], strict=True):
        np.testing.assert_array_equal(found, expected)


def test_a_replay_has_the_polarisation_of_its_call() -> None:
    """A sphere returns no cross-polarised echo, also if a call with the same polarisation at both ends came before."""
    ball = objects.sphere(0.03)
    one, cross, other, back = (
        rt.rcs(ball, [1, 0, 0], polarization=pair, distance=1.0, rays_per_wavelength2=1.0) for pair in ("VV", "VH", "HH", "HV")
    )
    assert max(cross, back) < 1e-9 * one
    assert other == pytest.approx(one, rel=1e-3)
