"""Compare pictures of a revolution with closed forms, and check the changes to which a picture must be invariant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from echoes import BIN_M, RADAR, echoes

from radartwin.features.processed import Processed, process
from radartwin.features.range_time import COLUMNS, ROWS, SHAPE, flattened, picture, sector_weights
from radartwin.features.signature import signature

FRAMES = 48
AXIS_M = 24 * BIN_M
TURN_HZ = RADAR.frame_rate_hz / FRAMES


def angle(frames: int = FRAMES, period: int = FRAMES) -> np.ndarray:
    return 2 * np.pi * np.arange(frames) / period


def turning(frames: int = FRAMES) -> Processed:
    """Return a recording of a strong echo whose power changes with the angle, and of a weak echo that moves in range."""

    def amplitude(t: np.ndarray) -> np.ndarray:
        theta = 2 * np.pi * TURN_HZ * t
        return 1e-3 * np.sqrt(1 + 0.8 * np.cos(theta) + 0.1 * np.sin(3 * theta))

    def range_m(t: np.ndarray) -> np.ndarray:
        return AXIS_M + 3 * BIN_M + 1e-3 * np.cos(2 * np.pi * TURN_HZ * t)

    return process(echoes(frames, [(amplitude, AXIS_M), (3e-4, range_m)]))


def shifted(processed: Processed, frames: int) -> Processed:
    return replace(processed, channels=np.roll(processed.channels, -frames, axis=0), power=np.roll(processed.power, -frames, axis=0))


def test_a_constant_point_echo_has_the_main_lobe_of_the_hann_window_at_all_times():
    """An echo in the centre of a range bin has -6 dB in the neighbouring bins, because a Hann window's spectrum is 1/4, 1/2, 1/4."""
    cells = picture(process(echoes(FRAMES, [(1e-3, AXIS_M)])), angle(), AXIS_M)
    assert (cells.shape, cells.dtype) == (SHAPE, np.float32)
    names, values = flattened(cells)
    assert np.array_equal(values.reshape(SHAPE), cells)
    assert names[ROWS * COLUMNS + COLUMNS + 1] == f"doppler 1 bin {1 - COLUMNS // 2:+d}"
    expected = np.zeros(COLUMNS)
    expected[COLUMNS // 2 - 1 : COLUMNS // 2 + 2] = 1 - 6.02 / 40, 1, 1 - 6.02 / 40
    near = slice(COLUMNS // 2 - 1, COLUMNS // 2 + 2)
    assert cells[0][:, near] == pytest.approx(np.tile(expected[near], (ROWS, 1)), abs=0.01)
    assert cells[1][ROWS // 2, near] == pytest.approx(expected[near], abs=0.01)
    assert np.delete(cells[1], ROWS // 2, axis=0).max() == pytest.approx(0, abs=1e-6)


def test_a_modulated_point_echo_has_the_level_of_its_power_and_two_sidebands():
    """An amplitude 1 + 0.5 cos(3 theta) has the Doppler lines 1, 1/4 and 1/4 in amplitude, so -12 dB at three cycles per revolution."""
    amplitude = lambda t: 1e-3 * (1 + 0.5 * np.cos(3 * 2 * np.pi * TURN_HZ * t))  # noqa: E731
    cells = picture(process(echoes(FRAMES, [(amplitude, AXIS_M)])), angle(), AXIS_M, rows=FRAMES)
    power_db = 20 * np.log10((1 + 0.5 * np.cos(3 * angle())) / 1.5)
    assert cells[0][:, COLUMNS // 2] == pytest.approx(1 + power_db / 40, abs=2e-3)
    lines = cells[1][:, COLUMNS // 2]
    assert lines[FRAMES // 2 + np.array([-3, 0, 3])] == pytest.approx([1 - 12.04 / 40, 1, 1 - 12.04 / 40], abs=2e-3)


def test_a_later_start_rolls_channel_0_and_keeps_channel_1():
    processed, rows = turning(), 5
    first, second = picture(processed, angle(), AXIS_M), picture(shifted(processed, rows * FRAMES // ROWS), angle(), AXIS_M)
    assert second[0] == pytest.approx(np.roll(first[0], -rows, axis=0), abs=1e-5)
    assert second[1] == pytest.approx(first[1], abs=1e-4)
    assert np.abs(second[0] - first[0]).max() > 0.05
    assert picture(turning(2 * FRAMES), angle(2 * FRAMES), AXIS_M) == pytest.approx(first, abs=5e-3), "two equal revolutions"


def test_channel_1_holds_the_lowest_doppler_frequencies_of_the_signature():
    processed = turning()
    expected = signature(processed, angle(), AXIS_M)
    cells = picture(processed, angle(), AXIS_M, rows=24, columns=5)
    centre = int(np.abs(processed.range_m[np.abs(processed.range_m - AXIS_M) <= 0.5] - AXIS_M).argmin())
    assert cells[1] == pytest.approx(expected[12:36, centre - 2 : centre + 3], abs=1e-5)


def test_a_short_revolution_has_no_energy_at_high_doppler_frequencies():
    processed = turning(12)
    cells = picture(processed, angle(12, 12), AXIS_M)
    assert cells[1][:6].max() == cells[1][18:].max() == 0
    assert cells[1][6:18].max() == pytest.approx(1)
    assert cells[0].max() == pytest.approx(1)


def test_a_flash_between_two_rows_is_visible():
    """Every frame has the same total weight over all rows, so that a flash of one frame adds the same energy wherever it occurs."""
    weights = sector_weights(250, 24)
    assert weights.sum(axis=1) == pytest.approx(np.ones(24))
    assert weights.sum(axis=0) == pytest.approx(np.full(250, 24 / 250), rel=0.02)


def test_columns_before_the_first_range_bin_are_zero():
    cells = picture(process(echoes(FRAMES, [(1e-3, 8 * BIN_M)])), angle(), 8 * BIN_M)
    assert cells[0][:, : COLUMNS // 2 - 8].max() == 0
    assert cells[0][:, COLUMNS // 2].min() == pytest.approx(1, abs=1e-3)
