"""What the testbed's radar reads off a bench, by the processing that all tables share, beside link budget and range law in closed form.

Bounds are wide where boards differ, and say why; levels are received over transmitted power.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import Case
from radartwin.config.compose import compose
from radartwin.features import envelope
from radartwin.features.processed import process
from radartwin.features.profile import beyond_target_share
from radartwin.io.progress import Progress
from radartwin.radar.chirp import Radar
from radartwin.radar.hardware import Hardware
from radartwin.radar.recording import Recording
from radartwin.scene import objects
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories import trajectory
from radartwin.store.products import Store
from radartwin.testbed import testbed
from radartwin.testbed.testbed import OFF

RADAR = Radar.iwr1843()
C = 299_792_458.0
WAVELENGTH = C / (77e9 + 70e12 * 256 / 5.21e6 / 2)  # in the middle of the sweep
ELEMENT_DBI = 10.5  # of the IWR1843BOOST's patch rows
DISTANCES_M = (0.5, 1.0, 1.5, 2.0)  # of the turntable campaign
BALL_M = 0.015


def db(power):
    return 10 * np.log10(power)


def equation_db(cross_section_m2, distance_m):
    """Received over transmitted power on boresight: G^2 lambda^2 sigma / ((4 pi)^3 R^4)."""
    return 2 * ELEMENT_DBI + db(WAVELENGTH**2 * cross_section_m2 / ((4 * np.pi) ** 3 * distance_m**4))


def filter_db(distance_m):
    """Two first-order high-pass stages, 175 and 350 kHz, at an echo's beat."""
    beat = 70e12 * 2 * distance_m / C
    return -db((1 + (175e3 / beat) ** 2) * (1 + (350e3 / beat) ** 2))


def measured(mesh, distance_m, frames=1):
    """A recording of a metal thing in free space that faces the radar, processed, by the testbed with its hardware."""
    scene = Scene([Surface(mesh, "metal", "thing", role="object")])
    motion = {"thing": trajectory.pose([distance_m, 0.0, 0.0], np.diag([-1.0, -1.0, 1.0]))[None]}
    clean = testbed.clean(scene, RADAR, np.eye(4)[None], motion, dataclasses.replace(OFF, hardware=1.0, solver=1.0))
    same = Recording(np.repeat(clean.iq, frames, axis=0), RADAR)
    return process(testbed.received(same, Hardware(), seed=3), doppler=False)


@pytest.fixture(scope="module")
def reflector():
    return measured(objects.trihedral(0.1), 2.0, frames=10)


def test_the_floor_of_a_range_profile_is_thermal_noise(reflector):
    """-174 dBm/Hz and a noise figure of 15 dB over 5.21 MHz, from 12 dBm; a Hann window spreads a bin over 1.5, 256 samples and 16 chirps
    add coherently. Q is amplified by 1 dB more than I, half a decibel in power; what phase noise the reflector's own echo spreads over all
    ranges (-64 dB of it, -93 dBc/Hz) is no more than as much again: from 0.5 dB below to 2 dB above."""
    thermal = -174 + 15 + db(5.21e6) - 12 + db(1.5 / 256 / 16)
    far = reflector.range_m > 3.0
    assert thermal - 0.5 < db(reflector.power[:, far].mean()) < thermal + 2
    assert thermal - 0.5 < db(reflector.noise_floor[far].mean()) < thermal + 2


def test_a_trihedral_at_2_m_reads_what_its_link_budget_leaves(reflector):
    """sigma = 4 pi a^4 / (3 lambda^2), 14 m^2. Its lines take 5.2 dB, the filter 0.7 dB at 2 m and its near field 0.6 dB (physics: 10 cm
    at 2 m); a bin that is not on the peak up to 1.4 dB, boards 0.6 dB a channel. Real boards measure up to 25 dB less than the equation
    (IWR1443BOOST, TI E2E 1436795), none more."""
    expected = equation_db(4 * np.pi * 0.1**4 / (3 * WAVELENGTH**2), 2.0)
    peak = db(reflector.power[0, np.abs(reflector.range_m - 2.0) < 0.2].max())
    assert expected - 25 < peak < expected
    assert peak == pytest.approx(expected - 5.2 + filter_db(2.0) - 0.6, abs=2)
    ratio = peak - db(np.median(reflector.power[:, reflector.range_m > 3.0]))
    assert 50 < ratio < 80


def test_leakage_lies_at_zero_range_and_does_not_outshine_the_bench(reflector):
    """Transmitter to receiver on boards of the family: -30 to -55 dB (TI E2E 674013 has -45), and two high-pass stages take 36 to 50 dB at
    the 10 to 30 kHz of a few centimetres: -66 to -105 dB, beside the -64 dB of the reflector at 2 m. And it is seen: real captures have it
    13 and 15 dB above the noise of a sample, which is 34 dB more above that of a coherent bin."""
    near = reflector.power[0, reflector.range_m <= 0.2].max()
    behind = reflector.power[0, (reflector.range_m > 0.3) & (reflector.range_m < 1.5)].max()
    target = reflector.power[0, np.abs(reflector.range_m - 2.0) < 0.2].max()
    assert -40 < db(near / target) < 5
    assert near > 10 * behind  # no echo is in front of the reflector, so what is there is leakage
    assert 25 < db(near / np.median(reflector.power[:, reflector.range_m > 3.0])) < 65


def test_free_space_follows_the_fourth_power_of_range_at_the_campaigns_distances():
    """A ball of 15 mm: its flash is at R - a, and its power as 1/((R - a) R)^2, which is the fourth power of the geometric mean. The filter
    is taken out by its closed form; what is left is within 0.3 dB at each distance and 0.05 of the exponent."""
    levels = []
    for distance in DISTANCES_M:
        processed = measured(objects.sphere(BALL_M), distance)
        energy = envelope.target_energy(processed, distance - BALL_M)
        levels.append(db(energy.mean()) - filter_db(distance - BALL_M))
    where = 10 * np.log10(np.sqrt(np.array(DISTANCES_M) * (np.array(DISTANCES_M) - BALL_M)))
    slope, level = np.polyfit(where, levels, 1)
    assert slope == pytest.approx(-4, abs=0.05)
    np.testing.assert_allclose(levels, level - 4 * where, atol=0.3)
    # Of pi a^2, through lines of 5.2 dB; a Hann window holds 1.5 of a bin's power in all
    assert level == pytest.approx(equation_db(np.pi * BALL_M**2, 1.0) - 5.2 + db(1.5), abs=1.0)


@pytest.mark.slow
def test_the_lab_at_2_m_returns_more_from_beyond_the_target_than_the_target_in_most_frames(tmp_path):
    """The paper's average is about 0.75, without saying how it weighs the few aspects at which the reflector flashes. In the campaign's own
    recording the median over a turn's frames is above half (a wall of plasterboard at 4 to 5 m, furniture of metal, against a reflector
    that shows its back); the mean of the power is the flashes', and only a lower bound is sure: the room is there."""
    config = compose(["experiment=environment", f"output={tmp_path}"])
    small = dataclasses.replace(config.profile.campaign, frames_per_turn=16, turns=1)
    config = dataclasses.replace(config, profile=dataclasses.replace(config.profile, campaign=small))
    campaign = Campaign(config, Store(tmp_path / "cache"), Progress())
    _, processed = campaign.processed("measured", Case("corner_reflector", "lab", "turntable", 2.0))
    shares = [beyond_target_share(frame, processed.range_m, 2.0) for frame in processed.power.astype(float)]
    assert 0.5 < np.median(shares) < 0.99
    assert 0.01 < beyond_target_share(processed.power.mean(axis=0, dtype=float), processed.range_m, 2.0) < 0.95
