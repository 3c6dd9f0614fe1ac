"""Estimate the time offset between the starts of two recordings, from signals with known offsets."""

from __future__ import annotations

import numpy as np
import pytest

from radartwin.features.align import overlap, start_offset


def drive(times: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the gate energy of a drive with a short bright reflection: the target crosses 0.15 m at 0.2 m/s around t = 2.5 s."""
    signal = np.exp(-(((times - 2.5) / 0.5) ** 2)) + 0.3 * np.exp(-(((times - 3.4) / 0.1) ** 2))
    noise = 10 ** (-30 / 20) * (rng.normal(size=len(times)) + 1j * rng.normal(size=len(times))) / np.sqrt(2)
    return np.abs(np.sqrt(signal) + noise) ** 2


@pytest.mark.parametrize("late", [-12, 0, 1, 9])
def test_late_start_is_found_from_the_energy(late: int) -> None:
    rng = np.random.default_rng(abs(late))
    times = np.arange(50) / 10
    assert start_offset(drive(times, rng), 7e3 * drive(times - late / 10, rng), max_frames=20) == late


def test_recordings_of_different_length_are_aligned() -> None:
    rng = np.random.default_rng(1)
    long, short = drive(np.arange(80) / 10 - 1.7, rng), drive(np.arange(50) / 10, rng)
    assert (start_offset(short, long, 30), start_offset(long, short, 30)) == (17, -17)
    ramp = np.exp(np.linspace(0, 3, 40))  # correlates perfectly with itself at every offset, of which the smallest is taken
    assert start_offset(ramp, ramp, 20) == 0


def test_overlap_returns_the_common_frames() -> None:
    power = np.random.default_rng(0).normal(size=(30, 4))
    for late in (-6, 0, 6):
        other = power[6 - late : 24 - late]  # starts `late` frames earlier, so the same events are `late` frames later in it
        first, second = overlap(power[6:24], other, late)
        np.testing.assert_array_equal(first, second)
        assert len(first) == 18 - abs(late)
