"""Compare every feature with its closed form on recordings of point echoes, and check the changes to which a feature must be invariant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from echoes import BIN_M, RADAR, echoes

from radartwin.features import doppler, envelope, extent, families, peak_track, window
from radartwin.features.log import Nominal as Log
from radartwin.features.processed import Processed, process
from radartwin.features.sets import SETS
from radartwin.features.signature import signature

AXIS_M = 24 * BIN_M  # range of the turntable's axis, on the centre of a range bin, about 1.05 m
FRAMES = 40
TURN_HZ = RADAR.frame_rate_hz / FRAMES  # one revolution in FRAMES frames


def turning(
    amplitude: Callable[[np.ndarray], np.ndarray], turns: float = 1.0, start: float = 0.0, at_m: float = AXIS_M, **noise
) -> Processed:
    """Return the recording of a point echo whose amplitude depends on the angle of the turntable."""
    frames = round(turns * FRAMES)
    return process(echoes(frames, [(lambda t: amplitude(2 * np.pi * TURN_HZ * t + start), at_m)], **noise))


def angle(turns: float = 1.0) -> np.ndarray:
    return 2 * np.pi * np.arange(round(turns * FRAMES)) / FRAMES


def at_rest(frames: int, distance_m: float, turns: float | None = None) -> Log:
    return Log(RADAR.frame_rate_hz, np.full(frames, distance_m), None if turns is None else angle(turns))


def lobes(theta: np.ndarray) -> np.ndarray:
    """Return an amplitude with the power 1 + 0.8 cos(2 theta) + 0.2 cos(5 theta): |P_2|/|P_0| = 0.4 and |P_5|/|P_0| = 0.1."""
    return 1e-3 * np.sqrt(1 + 0.8 * np.cos(2 * theta) + 0.2 * np.cos(5 * theta))


def ratio(processed: Processed, turns: float = 1.0, at_m: float = AXIS_M) -> float:
    return envelope.harmonic_ratio(envelope.revolution(envelope.target_energy(processed, at_m), angle(turns)))


def test_harmonics_of_a_modulated_echo_are_those_of_its_power() -> None:
    power = envelope.revolution(envelope.target_energy(turning(lobes), AXIS_M), angle())
    assert envelope.harmonics(power) == pytest.approx([0, 0.4, 0, 0, 0.1, 0], abs=1e-3)
    assert ratio(turning(lobes)) == pytest.approx(0.17, abs=1e-3)
    assert envelope.harmonic_ratio(power, 3, 12) == pytest.approx(0.01, abs=2e-4)


def test_constant_echo_has_no_harmonics_and_a_glint_has_all() -> None:
    assert ratio(turning(lambda theta: np.full_like(theta, 1e-3))) < 1e-9
    assert envelope.harmonic_ratio(np.eye(1, FRAMES)[0]) == pytest.approx(6.0)


def test_harmonic_ratio_does_not_depend_on_scale_start_angle_distance_and_turns() -> None:
    expected = ratio(turning(lobes))
    assert ratio(turning(lambda theta: 30 * lobes(theta))) == pytest.approx(expected, rel=1e-5)
    assert ratio(turning(lobes, start=1.234)) == pytest.approx(expected, abs=1e-3)
    assert ratio(turning(lobes, at_m=2 * AXIS_M), at_m=2 * AXIS_M) == pytest.approx(expected, rel=1e-3)
    assert ratio(turning(lobes, turns=2.6), 2.6) == pytest.approx(expected, rel=1e-3)


def test_noise_changes_neither_the_harmonic_ratio_nor_the_brightness() -> None:
    """Without the noise correction, noise with half of the target's energy would reduce the harmonic ratio by the factor (2/3)^2 = 0.44."""
    # the gate has 7 range bins, and the echo has the power of 1.5 bins
    sigma = 1e-3 * np.sqrt(0.5 / (7 * 1.5 / RADAR.num_samples / RADAR.num_chirps) * 1.5)
    assert ratio(turning(lobes, turns=3, noise=sigma), 3) == pytest.approx(0.17, rel=0.15)
    # the gate contains as much noise energy as target energy
    levels = [
        envelope.brightness_db(envelope.target_energy(process(echoes(60, [(1e-4, AXIS_M)], noise=noise)), AXIS_M), np.full(60, AXIS_M))
        for noise in (0.0, 2e-3)
    ]
    assert levels[1] == pytest.approx(levels[0], abs=0.4)


def test_revolution_interpolates_between_frames() -> None:
    theta = 2 * np.pi * np.arange(150) / 59.6  # two and a half revolutions of 59.6 frames each
    energy = 1 + 0.8 * np.cos(2 * theta + 0.3)
    power = envelope.revolution(energy, -theta)  # rotation in the opposite direction
    assert len(power) == 60
    assert envelope.harmonics(power)[1] == pytest.approx(0.4, rel=0.01)


def test_crest_factor_and_entropy_of_a_quarter_pulse() -> None:
    quarter = np.where(np.arange(FRAMES) < FRAMES // 4, 1.0, 0.0)
    for pulse in (quarter, 7 * np.roll(quarter, 9)):
        assert envelope.crest_factor(pulse) == pytest.approx(2.0)  # 1 / sqrt(1/4)
        assert envelope.entropy(pulse) == pytest.approx(np.log(FRAMES // 4) / np.log(FRAMES))


@pytest.mark.parametrize(
    ("frames", "start_m", "speed_mps", "scale", "error_m"),
    [(50, 1.5, 0.2, 1.0, 1e-3), (50, 1.5, 0.2, 1e-4, 1e-3), (20, 4.8, 2.0, 1.0, 0.02)],
)
def test_track_of_an_approach_is_exact_at_any_scale_and_speed(
    frames: int, start_m: float, speed_mps: float, scale: float, error_m: float
) -> None:
    along = start_m - speed_mps * np.arange(frames) / RADAR.frame_rate_hz
    tracked = peak_track.around(process(echoes(frames, [(scale, lambda t: start_m - speed_mps * t)])), along, RADAR.frame_rate_hz)
    assert tracked == pytest.approx(along, abs=error_m)
    assert peak_track.excursion(tracked) == pytest.approx(speed_mps * (frames - 1) / RADAR.frame_rate_hz, abs=2 * error_m)


def test_track_is_the_power_weighted_mean_of_two_echoes_in_one_gate() -> None:
    # The echoes are two bins apart, and their energies are 4 to 1.
    made = process(echoes(1, [(2e-3, AXIS_M), (1e-3, AXIS_M + 40 * BIN_M)]))
    near, far = made.power[0], np.roll(made.power[0], -38)
    mixed = replace(made, power=((near + far) * (made.range_m < 2))[None], noise=None)
    assert peak_track.track(mixed, 0.8, 1.3, RADAR.frame_rate_hz)[0] == pytest.approx(AXIS_M + 2 * BIN_M / 5, abs=1e-3)


def test_track_follows_a_fading_target_past_a_stronger_flash() -> None:
    frames = 40

    def fading(t: np.ndarray) -> np.ndarray:
        return np.where((t > 1.5) & (t < 1.8), 1e-4, 1e-3)

    def flash(t: np.ndarray) -> np.ndarray:
        return np.where((t > 1.55) & (t < 1.75), 3e-3, 0.0)

    made = process(echoes(frames, [(fading, lambda t: 1.2 + 0.1 * t), (flash, 1.65)], noise=1e-4))
    along = 1.2 + 0.1 * np.arange(frames) / RADAR.frame_rate_hz
    tracked = peak_track.track(made, 0.9, 1.9, RADAR.frame_rate_hz)
    assert np.abs(tracked - along).max() < 0.05
    assert np.abs(peak_track.brightest(made, 0.9, 1.9) - along).max() > 0.2  # the brightest bin of each frame jumps


def test_window_has_the_energy_of_echoes_at_their_distance_from_the_target() -> None:
    """An echo on a bin fills 1.5 bins' worth of power; the second is 10 dB lower, half a metre behind."""
    second = AXIS_M + 11 * BIN_M
    made = process(echoes(3, [(1e-3, AXIS_M), (1e-3 / np.sqrt(10), second)]))
    levels = window.window_db(made, np.full(3, AXIS_M))
    assert levels.shape == (3, window.BINS)
    linear = 10 ** (levels[0] / 10)
    assert linear.sum() == pytest.approx(1.5e-6 * 1.1, rel=0.01)
    about = np.abs(window.CENTRES_M - (second - AXIS_M)) < 0.15
    assert linear[about].sum() == pytest.approx(1.5e-7, rel=0.02)
    assert levels.min() == pytest.approx(10 * np.log10(1.65e-6) - window.FLOOR_DB, abs=0.1)
    moved = process(echoes(1, [(1e-2, 2 * AXIS_M), (1e-2 / np.sqrt(10), 2 * AXIS_M + 11 * BIN_M)]))
    assert window.window_db(moved, np.array([2 * AXIS_M]))[0] == pytest.approx(levels[0] + 20, abs=0.01)


def test_window_excludes_antenna_coupling_and_is_limited_by_noise() -> None:
    made = process(echoes(20, [(3e-3, 0.1), (1e-3, 14 * BIN_M)], noise=1e-3))
    levels = window.window_db(made, np.full(20, 14 * BIN_M))
    before = window.CENTRES_M + 14 * BIN_M < 0.3 - 0.1
    assert before.sum() >= 4
    assert np.ptp(levels[:, before]) == 0  # the same floor in every frame
    assert levels[:, before].max() < levels[:, ~before].min() + 1e-9


def test_brightness_does_not_depend_on_range_and_follows_the_scale() -> None:
    def read(scale: float, bins: int) -> float:
        at_m = bins * BIN_M
        made = process(echoes(4, [(scale / at_m**2, at_m)]))
        return envelope.brightness_db(envelope.target_energy(made, at_m), np.full(4, at_m))

    assert read(1e-3, 24) == pytest.approx(-60 + 10 * np.log10(1.5), abs=0.01)  # Hann spreads an echo over 1.5 bins of power
    assert read(1e-3, 48) == pytest.approx(read(1e-3, 24), abs=0.01)
    assert read(1e-2, 24) == pytest.approx(read(1e-3, 24) + 20, abs=0.01)


def test_extent_of_a_point_matches_the_array_factor() -> None:
    """The extent is the spread of |sin(4 psi) / (8 sin(psi / 2))|^2 with psi = pi sin(phi) f / f0, here without a beamformer."""
    phi = np.deg2rad(np.arange(-90.0, 91.0))
    spacing = np.diff(np.sort(RADAR.virtual_positions[:, 1]))[0]
    psi = 2 * np.pi * spacing * RADAR.center_frequency_hz / 299792458.0 * np.sin(phi)
    with np.errstate(invalid="ignore"):
        factor = np.where(np.abs(psi) < 1e-9, 1.0, (np.sin(4 * psi) / (8 * np.sin(psi / 2))) ** 2)
    expected = np.sqrt(np.sum(factor * phi**2) / factor.sum())
    made = process(echoes(2, [(1e-3, AXIS_M)]))
    assert extent.angular_extent(made, AXIS_M) == pytest.approx(expected, rel=0.01)
    assert expected == pytest.approx(0.25, abs=0.01)


def test_extent_of_two_points_adds_their_separation() -> None:
    point = extent.angular_extent(process(echoes(1, [(1e-3, AXIS_M)])), AXIS_M)[0]
    # In neighbouring bins their echoes add in power, each with its own beam.
    apart = 30.0
    pair = extent.angular_extent(process(echoes(1, [(1e-3, AXIS_M - 2 * BIN_M, apart), (1e-3, AXIS_M + 2 * BIN_M, -apart)])), AXIS_M)[0]
    assert pair == pytest.approx(np.hypot(point, np.deg2rad(apart)), rel=0.1)


def test_extent_does_not_depend_on_scale_range_and_noise() -> None:
    def read(scale: float, at_m: float, noise: float = 0.0) -> float:
        made = process(echoes(20, [(scale, at_m, 10.0), (0.7 * scale, at_m + BIN_M, -12.0)], noise=noise))
        return float(np.median(extent.angular_extent(made, at_m)))

    expected = read(1e-3, AXIS_M)
    assert read(1e-6, AXIS_M) == pytest.approx(expected, rel=1e-3)
    assert read(1e-3, 2 * AXIS_M) == pytest.approx(expected, rel=0.05)
    # without the noise correction, the result would be 0.57 rad instead of 0.37 rad
    assert read(1e-3, AXIS_M, noise=1.5e-2) == pytest.approx(expected, rel=0.1)


def test_radial_velocity_is_finer_than_a_doppler_bin() -> None:
    def back_and_forth(t: np.ndarray) -> np.ndarray:
        return 1.0 + 0.2 * np.where(t < 2, t, 4 - t)

    made = process(echoes(40, [(1e-3, back_and_forth)], noise=1e-4))
    time = np.arange(40) / RADAR.frame_rate_hz
    velocity = doppler.radial_velocity(made, back_and_forth(time))
    assert velocity[time < 1.95] == pytest.approx(0.2, abs=0.01)
    assert velocity[time > 2.0] == pytest.approx(-0.2, abs=0.01)
    tracked = peak_track.around(made, back_and_forth(time), RADAR.frame_rate_hz)
    difference = velocity - doppler.range_rate(tracked, RADAR.frame_rate_hz)
    assert np.sqrt(np.mean(difference**2)) < 0.06  # the straight line through nine frames smooths the turning point of the motion


def test_the_rate_of_a_drive_turns_at_the_target_and_has_no_turn_past_it() -> None:
    """The rate of a drive past the target changes slowly, so that the result is the line through nine frames at each middle frame."""
    there_and_back = 1.0 + 0.2 * np.abs(np.arange(49) - 24) / RADAR.frame_rate_hz
    assert doppler.range_rate(there_and_back, RADAR.frame_rate_hz) == pytest.approx(np.where(np.arange(49) < 24, -0.2, 0.2))
    time = np.arange(17) * 0.3
    away = np.hypot(0.5, 0.24 * (time - 2.4))
    middle = [np.polyfit(time[k - 4 : k + 5], away[k - 4 : k + 5], 1)[0] for k in range(4, 13)]
    assert doppler.range_rate(away, 1 / 0.3)[4:13] == pytest.approx(middle)


def test_signature_of_a_constant_speed_is_one_line() -> None:
    # 8 Doppler cells away from rest; it moves by 8 half wavelengths, 15 mm, in the revolution.
    step_m = 8 * 299792458.0 / RADAR.center_frequency_hz / 2 * TURN_HZ
    made = process(echoes(FRAMES, [(1e-3, lambda t: AXIS_M + step_m * t)]))
    level = signature(made, angle(), AXIS_M)
    near_m = made.range_m[np.abs(made.range_m - AXIS_M) <= 0.5]
    assert level.shape == (FRAMES, len(near_m))
    line, place = np.unravel_index(level.argmax(), level.shape)
    assert line == FRAMES // 2 + 8
    assert near_m[place] == pytest.approx(AXIS_M)
    assert (level.min(), level.max()) == (0, 1)


def test_signature_does_not_depend_on_start_angle_scale_and_distance() -> None:
    def orbit(theta: np.ndarray) -> np.ndarray:
        return 0.004 * np.cos(theta)

    def shown(start: float = 0.0, scale: float = 1.0, bins: int = 24, turns: int = 1) -> np.ndarray:
        at_m = bins * BIN_M

        def moving(t: np.ndarray) -> np.ndarray:
            return at_m + orbit(2 * np.pi * TURN_HZ * t + start)

        def pulsing(t: np.ndarray) -> np.ndarray:
            return scale * lobes(2 * np.pi * TURN_HZ * t + start)

        made = process(echoes(turns * FRAMES, [(pulsing, moving)]))
        return signature(made, angle(turns), at_m)

    first = shown()
    assert np.ptp(first) == 1
    for other in (shown(scale=100.0), shown(turns=2)):
        assert other == pytest.approx(first, abs=1e-3)
    assert shown(start=2 * np.pi * 17 / FRAMES) == pytest.approx(first, abs=0.02)  # the angle changes between the chirps of a frame
    assert shown(bins=48) == pytest.approx(first, abs=0.02)


def test_set_has_the_named_features_of_its_families_in_order() -> None:
    made, log = turning(lobes, noise=1e-4), at_rest(FRAMES, AXIS_M, 1.0)
    names, values = families.vector(made, log, "rotation")
    assert names == [
        "harmonic_ratio", *(f"harmonic_{m}" for m in range(1, 7)), "crest_factor", "entropy", "azimuth_extent_rad", "brightness_db",
    ]  # fmt: skip
    assert dict(zip(names, values, strict=True))["harmonic_ratio"] == pytest.approx(0.17, rel=0.02)
    shape, fewer = families.vector(made, log, "rotation", without=["brightness"])
    assert shape == names[:-1]
    assert np.array_equal(fewer, values[:-1])


@pytest.mark.parametrize("name", ["rotation", "depth", "lateral", "raw"])
def test_frame_features_have_one_row_per_frame(name: str) -> None:
    made, log = turning(lobes, noise=1e-4), at_rest(FRAMES, AXIS_M, 1.0)
    names, matrix = families.frames(made, log, name)
    whole, values = families.vector(made, log, name)
    assert matrix.shape == (FRAMES, len(names))
    assert np.isfinite(matrix).all()
    assert np.isfinite(values).all()
    assert len(values) == len(whole)
    for feature in ("harmonic_3", "crest_factor"):
        if feature in names:
            assert set(matrix[:, names.index(feature)]) == {values[whole.index(feature)]}


def test_depth_features_of_an_approach_match_its_geometry() -> None:
    frames = 40
    nominal = 1.5 - 0.2 * np.arange(frames, dtype=np.float64) / RADAR.frame_rate_hz
    front = 0.03  # distance in metres by which the front of the object is nearer than its axis
    made = process(echoes(frames, [(lambda t: 1e-3 / (1.5 - 0.2 * t - front) ** 2, lambda t: 1.5 - 0.2 * t - front), (3e-4, 4.0)]))
    names, values = families.vector(made, Log(RADAR.frame_rate_hz, nominal, None), "depth")
    feature = dict(zip(names, values, strict=True))
    assert feature["excursion_m"] == pytest.approx(0.78, abs=2e-3)
    assert feature["track_offset_m"] == pytest.approx(-front, abs=1e-3)
    assert feature["track_spread_m"] < 1e-3
    # The motion within a frame reduces the coherent sum of its chirps by 0.7 dB.
    phase = 2 * np.pi * 0.2 / RADAR.max_velocity_mps / 2
    lost = (np.sin(RADAR.num_chirps * phase / 2) / (RADAR.num_chirps * np.sin(phase / 2))) ** 2
    target = lost * np.mean(1e-6 / (nominal - front) ** 4)
    assert feature["multipath_share"] == pytest.approx(9e-8 / (9e-8 + target), rel=0.02)
    assert feature["brightness_db"] == pytest.approx(-60 + 10 * np.log10(1.5 * lost * np.mean((nominal / (nominal - front)) ** 4)), abs=0.1)


def test_target_below_the_noise_has_finite_features() -> None:
    made = process(echoes(FRAMES, [], noise=1e-3))
    quiet = replace(made, noise=(1.5 * made.noise_floor).astype(np.float32))
    for name in SETS:
        assert np.isfinite(families.vector(quiet, at_rest(FRAMES, AXIS_M, 1.0), name)[1]).all()
        assert np.isfinite(families.frames(quiet, at_rest(FRAMES, AXIS_M, 1.0), name)[1]).all()
