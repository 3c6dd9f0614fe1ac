"""The testbed's radar beside what is published of real ones, within bounds that say why they are so wide."""

import dataclasses

import numpy as np
import pytest

from radartwin.features.processed import process
from radartwin.features.profile import beyond_target_share
from radartwin.radar.chirp import Radar
from radartwin.radar.hardware import Hardware
from radartwin.radar.recording import Recording
from radartwin.scene import objects, rooms
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories import trajectory
from radartwin.simulation.simulate import simulate
from radartwin.testbed import fixtures, testbed
from radartwin.testbed.testbed import Gaps

RADAR = Radar.iwr1843()
REFLECTOR = Scene([Surface(objects.trihedral(0.1), "metal", "reflector", role="object")])
HANN = np.hanning(256)


def facing(distance_m):
    pose = trajectory.pose([distance_m, 0.0, 0.0], np.diag([-1.0, -1.0, 1.0]))
    return {"reflector": pose[None]}


@pytest.fixture(scope="module", params=[0.5, 1.0, 2.0, 4.0])
def recording(request):
    clean = simulate(REFLECTOR, Hardware().front_end(RADAR), np.eye(4)[None], motion=facing(request.param))
    return request.param, testbed.received(Recording(clean.iq, RADAR), Hardware(), 0)


def radar_equation_db(distance_m):
    """Signal over noise of a 10 cm trihedral, 12 dBm, 10.5 dBi twice, noise figure 15 dB, 16 chirps of 256 samples added coherently.

    SNR = Pt G^2 lambda^2 sigma T / ((4 pi)^3 R^4 k T0 F), sigma = 4 pi a^4/(3 lambda^2): The fundamentals of millimeter wave radar sensors
    (TI SPYY005), whose sensing estimator is the same formula.
    """
    wavelength = 299_792_458 / 78.72e9
    cross_section = 4 * np.pi * 0.1**4 / (3 * wavelength**2)
    decibels = 12 - 30 + 2 * 10.5 + 20 * np.log10(wavelength) + 10 * np.log10(cross_section * 16 * 256 / 5.21e6)
    return decibels - 30 * np.log10(4 * np.pi) - 40 * np.log10(distance_m) - 10 * np.log10(1.380649e-23 * 290) - 15


def test_a_trihedral_has_the_signal_to_noise_of_the_published_link_budget(recording):
    """Below the equation: 5.2 dB are the lines', 1.8 dB the window's, the filter takes 0.2 to 6.6 dB from 4 to 0.5 m, and a 10 cm
    reflector is in its near field up to 5 m. Real boards are 13 dB (TI of IWR6843, E2E 1357020), 20 dB (AWR2944, E2E 1528475) and 25 dB
    (IWR1443BOOST in a chamber, E2E 1436795) below it in the far field. At 2 and 4 m, where the near field takes least, ours must be
    between the equation and the worst of them; nearer, no better than the equation."""
    distance, received = recording
    power = (np.abs(np.fft.fft(received.iq * HANN, axis=-1).mean(axis=1)) ** 2).mean(axis=(0, 1, 2))
    ratio = 10 * np.log10(power[5:].max() / np.median(power[150:240]))
    assert ratio < radar_equation_db(distance)
    if distance >= 2:
        assert ratio > radar_equation_db(distance) - 25
        assert ratio == pytest.approx(radar_equation_db(distance) - 9, abs=3)


def test_a_trihedral_on_the_bench_does_not_saturate_and_fills_a_fair_part_of_the_adc(recording):
    """A real 77 GHz board behind a corner reflector uses 4 % of the range (AWR1243BOOST, E2E 703739: 1396 of 32768, farther away): ours
    stays between 1 % and half."""
    _, received = recording
    assert received.saturated == 0
    assert 0.01 < np.abs(received.iq).max() / received.scale / 32767 < 0.5


def test_the_noise_of_a_sample_is_that_of_real_captures():
    """7.3 counts at 2.5 Msps in the 77 GHz capture, and in the 60 GHz one at 4 Msps and a noise figure 3 dB lower; by the square root of
    the rate, within 3 dB. And -174 dBm/Hz + 15 dB over 5.21 MHz, -91.8 dBm received, exactly."""
    silence = Recording(np.zeros((4, 16, 2, 4, 256), np.complex64), RADAR)
    hardware = dataclasses.replace(Hardware().scaled(0), full_scale_db=Hardware().full_scale_db)
    received = testbed.received(silence, hardware, 0)
    assert received.scale is not None
    level = np.sqrt((np.abs(received.iq) ** 2).mean())
    assert 20 * np.log10(level / received.scale / 7.3 / np.sqrt(5.21 / 2.5)) == pytest.approx(0, abs=3)
    assert 20 * np.log10(level) + 12 == pytest.approx(-91.8, abs=0.1)


@pytest.mark.slow
def test_most_energy_of_the_lab_at_2_m_arrives_from_beyond_the_target_at_most_aspects():
    """The paper has about 75 % beyond a reflector that turns once at 2 m, and does not say how its average weighs the few aspects at which
    the reflector flashes. In the median frame ours is above half. In the mean of the power the flashes decide and ours is a few percent:
    the paper's figure is missed there, which the environment table says; below a percent the room would be lost altogether."""
    bench = rooms.lab_bench()
    place = bench.target_position(2.0)
    top = place - [0, 0, 0.1 / np.sqrt(6) + rooms.GAP]
    scene = (
        rooms.lab(detail="cluttered")
        + REFLECTOR
        + rooms.support(top)
        + fixtures.radar_rig(bench.sensor_pose)
        + fixtures.target_rig(bench.sensor_pose, top)
    )
    radar = dataclasses.replace(RADAR, frame_rate_hz=24 / 25)
    motion = {"reflector": trajectory.turntable(place, 24, radar.frame_rate_hz)}
    true = testbed.truth(scene, Gaps(), 0, rooms.CLUTTER)
    there = testbed.actual(bench.sensor_pose, motion, radar.frame_rate_hz, Gaps(), 0)
    clean = simulate(true, Hardware().front_end(radar), there.sensor_poses, motion=there.motion)
    measured = testbed.received(Recording(clean.iq, radar), Hardware(), 0)
    assert measured.saturated == 0
    made = process(measured, doppler=False)
    power, axis = made.power.astype(float), made.range_m
    assert 0.5 < beyond_target_share(np.median(power, axis=0), axis, 2.0) < 0.99
    assert 0.01 < beyond_target_share(power.mean(axis=0), axis, 2.0) < 0.95
