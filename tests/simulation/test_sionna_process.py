"""Sionna runs in a process of its own. RadarTwin starts this process again if it dies, and keeps its output apart from its own output."""

from __future__ import annotations

import os
import signal

import numpy as np
import pytest

from radartwin.errors import BackendError
from radartwin.simulation.backends import sionna_process

SLAB = {"variant": "auto", "cosine": np.ones(1), "permittivity": 2.0, "thickness_m": 0.01, "frequency_hz": 77e9}


def test_the_process_starts_again_after_it_died(capfd: pytest.CaptureFixture[str]) -> None:
    first = sionna_process.ask(SLAB)
    (pid,) = sionna_process.process_ids()
    assert pid != os.getpid()
    sionna_process.ask(SLAB)
    assert sionna_process.process_ids() == [pid]
    os.kill(pid, signal.SIGKILL)
    with pytest.raises(BackendError, match="simulator sionna: its process died"):
        sionna_process.ask(SLAB)
    assert np.array_equal(sionna_process.ask(SLAB)["te"], first["te"])
    assert sionna_process.process_ids() != [pid]
    assert capfd.readouterr().out == ""


def test_a_request_that_the_process_refuses_does_not_end_it() -> None:
    with pytest.raises(BackendError, match="simulator sionna: "):
        sionna_process.ask({**SLAB, "variant": "cuda" if not has_cuda() else "nonsense"})
    assert "te" in sionna_process.ask(SLAB)
    sionna_process.close()
    assert sionna_process.process_ids() == []


def has_cuda() -> bool:
    from radartwin.simulation import variant

    return variant.has_cuda()
