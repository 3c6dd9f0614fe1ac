"""Two groups of ray tubes are joined in order, with the same kernels for any numbers of tubes. Dr.Jit shares the cores."""

import numpy as np
import pytest

from radartwin import compiled
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


def arrays(value):
    """Return all arrays of tubes as NumPy arrays."""
    if isinstance(value, list | tuple):
        return [array for one in value for array in arrays(one)]
    return [] if value is None else [np.array(value)]


def test_joined_groups_are_the_groups_one_after_the_other():
    from radartwin.simulation.curved.flight import Tubes

    together, parts = Tubes.joined([tubes(5, 0), tubes(3, 5)]), tubes(8, 0)
    for found, expected in zip(arrays(list(vars(together).values())), arrays(list(vars(parts).values())), strict=True):
        np.testing.assert_array_equal(found, expected)
    assert together.face is None


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
