"""Groups of ray tubes are joined by the same kernels for any numbers of tubes. Dr.Jit shares the cores."""

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
