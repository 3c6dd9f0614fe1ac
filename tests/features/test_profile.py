"""The energy in the target gate, the share of energy outside of it, and the correlation of range profiles of known signals."""

from __future__ import annotations

import numpy as np
import pytest

from radartwin.features.profile import beyond_target_share, gate_energies, multipath_share, profile_correlation

AXIS = np.arange(200) * 0.05  # 0 to 9.95 m


def spikes(**energy_by_bin: float) -> np.ndarray:
    power = np.zeros(len(AXIS))
    for name, energy in energy_by_bin.items():
        power[int(name[1:])] = energy
    return power


def test_shares_are_the_energy_outside_the_gate_and_behind_it() -> None:
    # The target is in bin 40 (2.0 m), 43 is the last bin of the gate, and 5 (0.25 m) and 111 (5.55 m) are outside the range window.
    power = spikes(b40=4.0, b43=1.0, b44=2.0, b20=3.0, b5=100.0, b111=100.0)
    assert multipath_share(power, AXIS, 2.0) == pytest.approx(5 / 10)
    assert beyond_target_share(power, AXIS, 2.0) == pytest.approx(2 / 10)


def test_moving_gate_contains_the_energy_of_a_moving_target() -> None:
    target = np.linspace(3.0, 1.0, 21)
    power = np.stack([spikes(**{f"b{round(r / 0.05)}": 1.0, "b100": 0.25}) for r in target])
    inside, total = gate_energies(power, AXIS, target)
    np.testing.assert_allclose(inside, 1.0)
    np.testing.assert_allclose(total, 1.25)
    assert multipath_share(power, AXIS, target) == pytest.approx(0.2)
    assert multipath_share(power, AXIS, 3.0) > 0.8  # a gate at a fixed range misses the target


def test_correlation_is_one_with_itself_scaled_and_minus_one_with_its_mirror() -> None:
    axis = np.linspace(0, 6, 200)
    power = 1 + np.exp(-((axis - 2) ** 2))
    assert profile_correlation(power, 5 * power, axis) == pytest.approx(1)
    assert profile_correlation(power, 5 * power, axis, "db") == pytest.approx(1)
    assert profile_correlation(power, (3 - np.sqrt(power)) ** 2, axis) == pytest.approx(-1)
