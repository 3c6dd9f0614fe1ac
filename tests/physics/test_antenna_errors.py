"""Antennas that deviate from the nominal pattern. The oracle for the ripples is a sum over the displaced copies of every antenna."""

from dataclasses import replace

import numpy as np
import pytest

import radartwin as rt
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import InputError
from radartwin.radar.antenna import PEAK_GAIN_DBI, element_gain
from radartwin.radar.antenna_errors import AntennaErrors
from radartwin.scene import objects
from radartwin.simulation.paths import Paths
from radartwin.simulation.signal.synthesis import synthesize

ERRORS = AntennaErrors()
NOMINAL = replace(rt.Radar.iwr1843(), num_chirps=1)
RADAR = replace(NOMINAL, antenna_errors=ERRORS)
ISOTROPIC = replace(NOMINAL, element="isotropic")
WAVELENGTH = SPEED_OF_LIGHT / NOMINAL.center_frequency_hz


def directions(count, seed=0):
    rng = np.random.default_rng(seed)
    out = rng.normal(size=(count, 3))
    return out / np.linalg.norm(out, axis=1, keepdims=True)


def ripples(ways, errors=ERRORS):
    """Return the factors (N, T + R) of all antennas in the directions `ways` (N, 3), as a sum over the displaced copies."""
    points, weights = errors.ripples("iwr1843", NOMINAL.num_tx + NOMINAL.num_rx, WAVELENGTH)
    out = np.tile(weights[:, 0], (len(ways), 1))
    for k, antenna in enumerate(points):
        for j, point in enumerate(antenna):
            out[:, k] += weights[k, 1 + j] * np.exp(-2j * np.pi / WAVELENGTH * (ways @ point))
    return out


def envelope(ways):
    """Return the amplitude gain: the nominal pattern or the floor, which falls with the cosine behind the board."""
    level = np.where(ways[:, 0] > 0, -18.0, -18.0 - 7.0 * np.abs(ways[:, 0]))
    return np.maximum(element_gain("iwr1843", ways), 10 ** ((PEAK_GAIN_DBI + level) / 20))


def channels(out, back):
    """Return the factors (N, T, R) of the channels for paths that leave in the directions `out` and return from `back`."""
    tx = NOMINAL.num_tx
    factor = ripples(out)[:, :tx, None] * ripples(back)[:, None, tx:]
    return (envelope(out) * envelope(back))[:, None, None] * factor


def test_strength_zero_is_the_nominal_radar():
    assert ERRORS.scaled(0) is None
    same = replace(NOMINAL, antenna_errors=ERRORS.scaled(0))
    assert same == NOMINAL
    assert "antenna_errors" not in NOMINAL.to_dict()
    assert NOMINAL.pattern == "iwr1843"
    assert not NOMINAL.sees_behind
    ways = directions(1000)
    assert NOMINAL.gain(ways).tobytes() == element_gain("iwr1843", ways).tobytes()
    assert rt.Radar.from_dict(RADAR.to_dict()) == RADAR
    assert RADAR.pattern != replace(RADAR, antenna_errors=ERRORS.scaled(2)).pattern


@pytest.mark.parametrize(
    ("values", "word"), [({"side_lobe_db": 1.0}, "side_lobe_db"), ({"ripple_db": np.nan}, "ripple_db"), ({"board": -1}, "board")]
)
def test_impossible_antenna_errors_are_refused(values, word):
    with pytest.raises(InputError, match=word):
        AntennaErrors(**values)


@pytest.mark.parametrize("strength", [0.5, 2.0])
def test_strength_scales_amplitudes(strength):
    scaled = ERRORS.scaled(strength)
    assert scaled is not None
    decibels = 20 * np.log10(strength)
    behind = 20 * np.log10(scaled.gain("iwr1843", [-1.0, 0.0, 0.0]))
    aside = 20 * np.log10(scaled.gain("iwr1843", [0.0, 1.0, 0.0]))
    assert behind == pytest.approx(PEAK_GAIN_DBI - 25 + decibels)
    assert aside == pytest.approx(PEAK_GAIN_DBI - 18 + decibels)
    copies = np.abs(scaled.ripples("iwr1843", 1, WAVELENGTH)[1][0])
    assert (copies[1:] ** 2).sum() / copies[0] ** 2 == pytest.approx(0.01 * strength**2)
    assert np.mean(scaled.gain("iwr1843", directions(100_000)) ** 2) < 1  # less power than the input


def test_envelope_is_the_nominal_main_lobe_and_a_continuous_floor():
    ways = directions(10_000)
    np.testing.assert_allclose(RADAR.gain(3 * ways), envelope(ways), rtol=1e-12)
    around = np.radians(np.arange(0, 180, 0.01))
    cut = RADAR.gain(np.stack([np.cos(around), np.sin(around), 0 * around], axis=1))
    assert np.abs(np.diff(20 * np.log10(cut))).max() < 0.05  # at most 5 dB per degree, where the nominal pattern reaches the floor


def test_ripples_have_the_mean_power_of_the_envelope_and_no_mean_phase():
    ways = directions(200_000, seed=3)
    power = envelope(ways) ** 2
    factor = ripples(ways)
    total = 10 * np.log10((power[:, None] * np.abs(factor) ** 2).sum(axis=0) / power.sum())
    assert np.abs(total).max() < 0.02  # the error of this Monte Carlo mean; the requirement is 0.1 dB
    mean = (power[:, None] * factor).sum(axis=0) / power.sum()
    assert np.abs(20 * np.log10(np.abs(mean))).max() < 0.1
    assert np.abs(np.degrees(np.angle(mean))).max() < 0.2


def test_ripples_differ_between_antennas_and_boards():
    ways = directions(20_000)
    ways = ways[(ways[:, 0] > 0.7) & (np.abs(ways[:, 2]) < 0.3)]
    boards = np.concatenate([ripples(ways), ripples(ways, replace(ERRORS, board=1))], axis=1)
    decibels, degrees = 20 * np.log10(np.abs(boards)), np.degrees(np.angle(boards))
    assert 0.4 < decibels.std(axis=0).min() < decibels.std(axis=0).max() < 1.0
    assert 2.5 < degrees.std(axis=0).min() < degrees.std(axis=0).max() < 6.5
    correlation = np.abs(np.corrcoef(decibels.T) - np.eye(boards.shape[1]))
    assert correlation.max() < 0.5


def bistatic(count, mirrored=False, given=False):
    """Return paths whose directions of departure and arrival differ, each at a pose of its own."""
    out, back = directions(count, 1), directions(count, 2)
    rng = np.random.default_rng(3)
    length, none = rng.uniform(0.5, 5, (2, count)), np.zeros(count)
    mirror = np.tile(np.diag([-1.0, 1.0, 1.0]), (count, 1, 1)) if mirrored else None
    gain = rng.normal(size=(count, 8)) + 1j if given else None
    amplitude, middle = np.ones((count, 1), complex), np.array([NOMINAL.center_frequency_hz])
    return Paths(count, np.arange(count), np.ones(count, int), amplitude, middle, length[0], length[1], out, back, none, mirror, gain)


@pytest.mark.usefixtures("spreading")
@pytest.mark.parametrize(("mirrored", "given"), [(False, False), (True, False), (False, True)])
def test_transmitters_use_the_departure_and_receivers_the_arrival(mirrored, given):
    paths = bistatic(30, mirrored, given)
    isotropic = synthesize(paths, ISOTROPIC)[:, 0]
    found = synthesize(paths, RADAR)[:, 0]
    ratio = (found * isotropic.conj()).sum(axis=-1) / (np.abs(isotropic) ** 2).sum(axis=-1)
    np.testing.assert_allclose(ratio, channels(paths.departure, paths.arrival), rtol=1e-4)


def test_a_wall_behind_the_radar_appears_at_the_level_of_the_back_lobe():
    """A metal wall at the distance d has the amplitude G lambda/(8 pi d), where G is the power gain straight behind the board."""
    wall = objects.plate(3.0, 3.0).apply_translation([-1.2, 0.0, 0.0])
    scene = rt.Scene([rt.Surface(wall, "metal", "wall", role="room")])
    pose = np.eye(4)[None]
    assert not rt.simulate(scene, NOMINAL, pose).iq.any()
    smooth = replace(NOMINAL, antenna_errors=replace(ERRORS, ripple_db=-300.0))
    iq = rt.simulate(scene, smooth, pose).iq[0, 0]
    expected = 10 ** ((PEAK_GAIN_DBI - 25) / 10) * WAVELENGTH / (8 * np.pi * 1.2)
    assert np.sqrt((np.abs(iq) ** 2).mean()) == pytest.approx(expected, rel=0.02)  # the wall's edges add 1 %
    rippled = rt.simulate(scene, RADAR, pose).iq[0, 0]
    ratio = (rippled * iq.conj()).sum(axis=-1) / (np.abs(iq) ** 2).sum(axis=-1)
    back = np.array([[-1.0, 0.0, 0.0]])
    np.testing.assert_allclose(ratio, channels(back, back)[0] / envelope(back) ** 2, rtol=0.02)
