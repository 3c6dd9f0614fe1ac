"""Dr.Jit joins groups of tubes of any size by the same kernels, shares the cores, and replays its programs with equal results."""

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


def tubes(count: int, start: int):
    """Return tubes whose arrays hold start, start + 1, ..."""
    import mitsuba as mi

    from radartwin.simulation.curved.flight import Tubes

    numbers = np.arange(start, start + count)
    real, whole = mi.Float(numbers), mi.UInt32(numbers)
    vector = mi.Vector3f(real, real + 1, real + 2)
    met = (whole, real, real, real)
    return Tubes(
        whole, whole, vector, vector, vector, vector, vector, vector, real, whole, vector, vector, [met, met],
        whole, mi.Float64(numbers), mi.Float64(numbers),
    )  # fmt: skip


def test_other_numbers_of_tubes_need_no_new_kernels():
    import drjit as dr

    from radartwin.simulation.curved.flight import Tubes

    def compiled_kernels(first: int, second: int) -> int:
        parts = [tubes(first, 0), tubes(second, first)]
        for part in parts:
            dr.eval(part)
        dr.kernel_history_clear()
        dr.eval(Tubes.joined(parts))
        return sum(not kernel["cache_hit"] for kernel in dr.kernel_history() if "cache_hit" in kernel)

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        compiled_kernels(50, 70)
        assert compiled_kernels(51, 83) == 0


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
def test_replays_equal_new_recordings(monkeypatch, material):
    """The calls differ in radius, distance, number of poses and number of tubes. All metal spheres share some recordings."""
    from radartwin.simulation.curved import tracer

    vertical = False, False, False
    replayed = tracer._SINGLE_BOUNCE[vertical]
    different = []

    def both(setting, index, pieces):
        lanes, seen = replayed(setting, index, pieces)
        expected = tracer.Setting.single_bounce(setting, index, pieces)
        hit = np.array(seen)  # rays that miss the mesh have undefined values
        different.append(not np.array_equal(hit, np.array(expected[1])) or compared(lanes, expected[0], hit))
        return lanes, seen

    def compared(found, expected, hit):
        if isinstance(found, list | tuple):
            return any(compared(a, b, hit) for a, b in zip(found, expected, strict=True))
        return not np.array_equal(np.array(found)[..., hit], np.array(expected)[..., hit])

    monkeypatch.setitem(tracer._SINGLE_BOUNCE, vertical, both)
    for radius, distance, poses, rays in CALLS:
        scene = rt.Scene([rt.Surface(objects.sphere(radius), material, "ball")])
        sensor = np.array([trajectory.pose([-distance, 0.01 * k, 0.02]) for k in range(poses)])
        rt.simulate(scene, rt.Radar.iwr1843(), sensor, rays=rays)
    assert len(different) >= len(CALLS)
    assert not any(different)


def test_a_replay_has_the_polarisation_of_its_call() -> None:
    """A sphere returns no cross-polarised echo, also if a call with the same polarisation at both ends came before."""
    ball = objects.sphere(0.03)
    one, cross, other, back = (
        rt.rcs(ball, [1, 0, 0], polarization=pair, distance=1.0, rays_per_wavelength2=1.0) for pair in ("VV", "VH", "HH", "HV")
    )
    assert max(cross, back) < 1e-9 * one
    assert other == pytest.approx(one, rel=1e-3)
