"""Sionna runs in a process of its own. RadarTwin starts this process again if it dies, and keeps its output apart from its own output."""

from __future__ import annotations

import os
import signal

import pytest

from radartwin.errors import BackendError
from radartwin.simulation import variant
from radartwin.simulation.backends import sionna


def test_the_process_starts_again_after_it_died(capfd: pytest.CaptureFixture[str]) -> None:
    pid = sionna.ask(os.getpid)
    assert pid != os.getpid()
    assert sionna.ask(os.getpid) == pid
    assert sionna.process_ids() == [pid]
    sionna.ask(os.system, "echo on the standard output")
    os.kill(pid, signal.SIGKILL)
    with pytest.raises(BackendError, match="simulator sionna: its process died"):
        sionna.ask(os.getpid)
    assert sionna.ask(os.getpid) != pid
    assert capfd.readouterr().out == ""


def test_a_request_that_the_process_refuses_does_not_end_it() -> None:
    pid = sionna.ask(os.getpid)
    with pytest.raises(BackendError, match="simulator sionna: simulator variant 'nonsense' is not one of"):
        sionna.ask(variant.activate, "nonsense")
    assert sionna.ask(os.getpid) == pid
    sionna.close()
    assert sionna.process_ids() == []
