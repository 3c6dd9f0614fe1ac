"""Tests of the comparison of simulation speed and accuracy: reference signals, error measures, Pareto fronts, claims and charts."""

from __future__ import annotations

import json
from typing import Any

import miepython
import numpy as np
import pytest

from analysis.pages import choosing
from experiments.speed import measuring, methods, problems, speed_accuracy
from experiments.speed.methods import DEFAULT, OURS, POINTS, RFGENESIS, Method, tracer
from experiments.validation.oracles import fullwave, furnished_motions, traced
from experiments.validation.oracles.point_source import cylinder_echo, sphere_echo
from experiments.validation.oracles.targets import cylinder_rcs
from radartwin.benchmark import signal_error
from radartwin.config.compose import compose
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.runs.experiment import check_rows

FREQUENCY_HZ = 77e9
WAVELENGTH_M = SPEED_OF_LIGHT / FREQUENCY_HZ
K = 2 * np.pi / WAVELENGTH_M
RADAR = Radar.iwr1843()


def section(amplitude: complex, distance_m: float) -> float:
    """Return the radar cross-section in dBsm of a far target with this echo amplitude."""
    return float(10 * np.log10((4 * np.pi) ** 3 * distance_m**4 * abs(amplitude) ** 2 / WAVELENGTH_M**2))


@pytest.mark.parametrize("radius_m", [0.002, 0.011, 0.05])
def test_far_sphere_matches_mie_series(radius_m: float) -> None:
    _, _, back, _ = miepython.efficiencies_mx(1e4 - 1e4j, 2 * np.pi * radius_m / WAVELENGTH_M)
    assert section(sphere_echo(radius_m, 300.0, FREQUENCY_HZ)[0], 300.0) == pytest.approx(
        10 * np.log10(float(back) * np.pi * radius_m**2), abs=0.02
    )


@pytest.mark.parametrize(("radius_m", "gap_m"), [(0.5, 0.2), (0.2, 1.0)])
def test_near_sphere_matches_mirrored_point_source_with_phase(radius_m: float, gap_m: float) -> None:
    """By geometric optics, the sphere turns the wave by half a cycle, and the reflected wave has the radius 1/(1/d + 2/a)."""
    mirrored = 1 / (1 / gap_m + 2 / radius_m)
    expected = -WAVELENGTH_M / (4 * np.pi * gap_m) * mirrored / (mirrored + gap_m) * np.exp(2j * K * gap_m)
    assert sphere_echo(radius_m, radius_m + gap_m, FREQUENCY_HZ)[0] / expected == pytest.approx(1, abs=0.01)


def test_cylinder_matches_far_field_and_near_mirror_line() -> None:
    assert section(cylinder_echo(0.02, 0.04, 30.0, FREQUENCY_HZ)[0], 30.0) == pytest.approx(
        10 * np.log10(cylinder_rcs(0.02, 0.04)), abs=0.05
    )
    mirrored = 1 / (1 / 0.5 + 2 / 1.0)
    endless = -WAVELENGTH_M / (4 * np.pi * 0.5) * np.sqrt(mirrored / (mirrored + 0.5) / 2) * np.exp(2j * K * 0.5)
    assert cylinder_echo(1.0, 60.0, 1.5, FREQUENCY_HZ)[0] / endless == pytest.approx(1, abs=0.02)


def test_swept_echo_equals_echo_at_each_sample() -> None:
    frequencies = traced.frequencies(traced.MONOSTATIC)
    swept = problems.swept(lambda f: cylinder_echo(0.033, 0.12, 1.0, f), 1.0)[0, 0, 0]
    samples = [0, 17, 128, 255]
    assert swept[samples] == pytest.approx(cylinder_echo(0.033, 0.12, 1.0, frequencies[samples]), rel=1e-4)


def tone(range_m: float, amplitude: float = 1.0) -> np.ndarray:
    cycles = 2 * range_m * RADAR.slope_hz_per_s / SPEED_OF_LIGHT * np.arange(RADAR.num_samples) / RADAR.sample_rate_hz
    return np.tile(amplitude * np.exp(2j * np.pi * cycles), (1, RADAR.num_chirps, RADAR.num_tx, RADAR.num_rx, 1))


def test_signal_profile_and_gain_errors_are_separate() -> None:
    low, nothing = (signal_error.compare([(gain * tone(2.0), tone(2.0))], RADAR) for gain in (0.1, 0.0))
    assert (low.signal, low.offset_db) == pytest.approx((0.9, -20.0))
    assert 15 < low.profile_db < 20  # below 20 dB, because levels more than 40 dB below the peak are not compared
    assert (low.free_db, low.gain_db) == pytest.approx((0.0, 20.0), abs=0.01)
    assert nothing.signal == 1
    assert 20 < nothing.profile_db <= signal_error.DYNAMIC_DB
    turned = signal_error.compare([(1j * tone(2.0), tone(2.0))], RADAR)
    assert (turned.signal, turned.profile_db) == pytest.approx((np.sqrt(2), 0.0), abs=1e-9)
    elsewhere = signal_error.compare([(tone(3.0), tone(2.0))], RADAR)
    assert elsewhere.free_db > 10  # a free gain factor cannot correct an echo at a wrong range


def measured(family: str, setting: str, seconds: list[float], error: float, **changes: Any) -> dict[str, Any]:
    return {
        "problem": "near", "family": family, "setting": setting, "seconds_frame": float(np.median(seconds)), "seconds": seconds,
        "wall_s_frame": 2 * seconds[0], "setup_s": 0.0, "frames timed": 5, "memory_mib": None, "rays": 100.0, "signal_error": error,
        "profile_error_db": error, "offset_db": 0.0, "free_error_db": error, "exact": False, **changes,
    }  # fmt: skip


def rows_of(*others: dict[str, Any]) -> list[dict[str, Any]]:
    known = {"near": problems.near(2, 1)}
    rows = speed_accuracy.table([measured(OURS, DEFAULT, [1.0, 1.0, 2.0], 1.0), *others], {"processor": "a", "cores": "2 cores"}, known)
    check_rows("speed_accuracy", rows)
    return rows


def verdicts(rows: list[dict[str, Any]]) -> dict[str, str]:
    return {row["metric"]: row["verdict"] for row in rows if row["claim"]}


def test_default_fails_if_another_is_much_better_in_both() -> None:
    better, close = (measured(OURS, "finer", [s] * 3, e) for s, e in ((0.8, 0.8), (0.95, 0.95)))
    metric = "factor from the front, error of the range profile"
    assert verdicts(rows_of(better))[metric] == "misses"
    assert verdicts(rows_of(close))[metric] == "holds"
    assert verdicts(rows_of({**better, "exact": True}))[metric] == "holds"  # an exact reference stands beside the front
    marks = {row["setting"]: row["front"] for row in rows_of({**better, "exact": True}) if not row["claim"]}
    assert marks == {DEFAULT: True, "finer": False}


@pytest.mark.parametrize(
    ("seconds", "error", "free", "verdict"),
    [(1200.0, 3.0, 2.0, "holds"), (600.0, 3.0, 2.0, "misses"), (1200.0, 3.0, 0.5, "misses"), (1200.0, 0.5, 2.0, "misses")],
)
def test_speed_claim_needs_every_error_lower(seconds: float, error: float, free: float, verdict: str) -> None:
    """In this test of the speed claim, the default method took 2 s in its last timed repetition."""
    naive = measured(RFGENESIS, speed_accuracy.PUBLISHED, [seconds], error, free_error_db=free)
    assert verdicts(rows_of(naive))["its seconds a frame over those of the default"] == verdict


def test_ratios_compare_the_same_rounds() -> None:
    ratio = speed_accuracy.ratios_of([2.0, 8.0], [9.0, 1.0, 2.0])
    assert (ratio.low, ratio.value, ratio.high, ratio.n) == (2.0, 3.0, 4.0, 2)


def test_default_is_accurate_on_canonical_targets_and_peers_are_not() -> None:
    problem = problems.canonical(2, 1)

    def error(method: Method) -> signal_error.Errors:
        pairs = [(method.iq(part, 1, part.radar), problem.reference(part)) for part in problem.parts]
        return signal_error.compare(pairs, problem.parts[0].radar)

    mine = error(tracer(DEFAULT))
    assert mine.signal < 0.03
    assert mine.profile_db < 0.4
    for peer in (Method(POINTS, "table", "points"), Method(RFGENESIS, "shipped", "rfgenesis")):
        assert error(peer).free_db > 5


def test_exact_images_match_the_reference_of_the_bare_office() -> None:
    problem = problems.empty_room(1, 1)
    (part,) = problem.parts
    images = Method(methods.IMAGES, "all", "")
    errors = signal_error.compare([(images.iq(part, 1, part.radar), problem.reference(part))], part.radar)
    assert errors.signal < 0.02


@pytest.mark.parametrize("make", [problems.object_in_room, problems.furnished_drive])
def test_full_wave_references_have_the_frequencies_and_the_frames_of_the_motion(make: Any) -> None:
    """The stored scene of each frame is the scene of the test problem, moved into the sensor frame."""
    frequency, _ = fullwave.field(furnished_motions.FOLDER, furnished_motions.name("box", 0))
    assert traced.frequencies(problems.FULL_WAVE) == pytest.approx(frequency, rel=1e-8)
    problem = make(furnished_motions.FRAMES, furnished_motions.FRAMES)
    stored = json.loads((furnished_motions.FOLDER / "scenes.json").read_text())["scenes"]
    for part in problem.parts:
        reference = problem.reference(part)
        assert reference.shape == (furnished_motions.FRAMES, 1, 1, 1, part.radar.num_samples)
        for frame in range(furnished_motions.FRAMES):
            to_sensor = np.linalg.inv(part.sensor[frame if len(part.sensor) > 1 else 0])
            for surface in part.scene:
                world = part.motion[surface.name][frame] if surface.name in part.motion else np.eye(4)
                mesh = surface.mesh.copy().apply_transform(to_sensor @ world)
                ends = np.reshape(stored[furnished_motions.name(part.name, frame)][surface.name], (-1, 2))
                distance = np.linalg.norm(mesh.vertices[:, None, :2] - ends[None], axis=2)
                assert max(distance.min(axis=0).max(), distance.min(axis=1).max()) < 1e-6


def test_measuring_returns_time_and_rays_of_each_method() -> None:
    problem = problems.canonical(3, 1)  # flat targets need no rays, the sphere and the cylinder do
    published = Method(RFGENESIS, "as published", "rfgenesis", (("version", "shipped"), ("grid", 16)), published=True)
    rows = measuring.measure(problem, [tracer(DEFAULT), Method(POINTS, "table", "points"), published], 1, 0.01, 5.0, lambda line: None)
    assert [row["family"] for row in rows] == [OURS, POINTS, RFGENESIS]
    assert all(min(row["seconds"]) > 0 and row["wall_s_frame"] > 0 for row in rows)
    assert rows[0]["rays"] > 100
    assert rows[2]["rays"] == 256
    assert rows[0]["frames timed"] == 3


@pytest.mark.parametrize("problem", problems.problems(True), ids=lambda problem: problem.name)
def test_options_in_choosing_make_the_measured_setting(problem: problems.Problem) -> None:
    """The command-line options in docs/choosing.md select the simulator settings that were timed for this test problem."""
    for method in methods.of_problem(problem, True):
        if method.family == OURS:
            asked = compose(choosing.options(method.setting).split()).simulator
            assert asked.elements == method.elements
            assert {name: getattr(asked, name) for name, _ in method.settings} == dict(method.settings)
