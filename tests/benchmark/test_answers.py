"""The frozen answers of the benchmark: their checksums, their agreement with formulas, and the score of known signals."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.special import fresnel

from experiments.validation.oracles import fullwave, furnished, sections_2d
from radartwin.benchmark import frozen_problems, leaderboard
from radartwin.benchmark.frozen_problems import FOLDER, INDEX, Problem
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import InputError, MissingError

MOST_BYTES = 5 << 20


def frequencies(problem: Problem) -> np.ndarray:
    radar = problem.radar
    return radar.start_frequency_hz + radar.slope_hz_per_s * np.arange(radar.num_samples) / radar.sample_rate_hz


def scenario(problem: str, name: str) -> tuple[Problem, frozen_problems.Scenario]:
    of_problem = frozen_problems.problem(problem)
    return of_problem, next(case for case in of_problem.scenarios if case.name == name)


def test_six_problems_have_their_checksums_and_are_small() -> None:
    problems = frozen_problems.problems()  # reads every file and checks its SHA-256
    assert [problem.name for problem in problems] == [
        "canonical",
        "near",
        "empty_room",
        "object_in_room",
        "furnished_drive",
        "fullwave_rooms",
    ]
    assert [len(problem.scenarios) for problem in problems] == [4, 1, 1, 1, 3, 39]
    assert sum(path.stat().st_size for path in FOLDER.iterdir()) < MOST_BYTES
    for problem in problems:
        for case in problem.scenarios:
            assert case.answer.shape[1] == problem.radar.num_samples
            assert case.frames >= case.scored
            assert np.isfinite(case.answer).all()


@pytest.mark.parametrize("byte", [100, -100])
def test_a_changed_file_is_refused_by_its_checksum(byte: int, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(FOLDER, tmp_path / "frozen"))
    content = bytearray((folder / "near.npz").read_bytes())
    content[byte] ^= 1
    (folder / "near.npz").write_bytes(content)
    with pytest.raises(InputError, match=r"near\.npz has the SHA-256 checksum .*install radartwin again"):
        frozen_problems.problem("near", folder)
    (folder / "near.npz").unlink()
    with pytest.raises(MissingError, match=r"near\.npz: no such file, but answers\.json"):
        frozen_problems.problem("near", folder)


def test_another_format_and_an_unknown_problem_are_refused(tmp_path: Path) -> None:
    (tmp_path / INDEX).write_text('{"format": "else"}')
    with pytest.raises(InputError, match="'format' must be"):
        frozen_problems.index(tmp_path)
    with pytest.raises(InputError, match="'far' is not known; choose one of canonical, near"):
        frozen_problems.problem("far")


def test_plate_that_faces_the_radar_matches_the_fresnel_aperture() -> None:
    """The level is lambda/(8 pi d) times a paraxial factor [C + jS](u) / (0.5 + 0.5j) a side, with an error of (side/distance)^2/4."""
    problem, plate = scenario("canonical", "plate")
    wavelength = SPEED_OF_LIGHT / frequencies(problem)
    u = 0.05 * np.sqrt(4 / wavelength)  # the two-way phase k y^2/d equals pi u^2/2 with u = y sqrt(4/(lambda d)), d = 1 m
    sine, cosine = fresnel(u)
    factor = np.abs(cosine + 1j * sine) / np.sqrt(0.5)
    assert np.abs(plate.answer[0]) == pytest.approx(wavelength / (8 * np.pi) * factor**2, rel=0.01)


def test_sphere_has_the_level_of_geometric_optics() -> None:
    """A sphere of 17 wavelengths in diameter is within 2 % of geometric optics: a mirrored point source at the depth 1/(1/d + 2/a)."""
    problem, sphere = scenario("canonical", "sphere")
    near, radius = 1.0 - 0.033, 0.033
    depth = 1 / (1 / near + 2 / radius)
    wavelength = SPEED_OF_LIGHT / frequencies(problem)
    level = wavelength / (4 * np.pi * near) * depth / (depth + near)
    assert np.abs(sphere.answer[0]) == pytest.approx(level, rel=0.02)


def test_strongest_single_reflections_of_the_room_are_in_the_answer() -> None:
    """The floor's image has the level lambda/(8 pi h) times the Fresnel coefficient of concrete, plus side lobes of other images."""
    problem, office = scenario("empty_room", "office")
    height = float(office.sensor[0, 2, 3])
    f = frequencies(problem)
    window = np.hanning(len(f))
    heard = np.abs((office.answer[0] * np.exp(-4j * np.pi * f / SPEED_OF_LIGHT * height) * window).sum()) / window.sum()
    index = np.sqrt(5.24 - 1j * 0.0462 * 78.7**0.7822 * 17.98 / 78.7)  # ITU-R P.2040, concrete at 78.7 GHz
    reflection = abs((1 - index) / (1 + index))
    assert heard == pytest.approx(SPEED_OF_LIGHT / f.mean() / (8 * np.pi * height) * reflection, rel=0.1)


@pytest.mark.parametrize("room", ["wall_01", "free_30"])
def test_full_wave_answers_are_the_stored_fields(room: str) -> None:
    _, case = scenario("fullwave_rooms", room)
    assert case.answer[0] == pytest.approx(fullwave.to_points(*fullwave.field(furnished.ROOMS, room)), rel=1e-5)


def test_physical_optics_of_a_wide_strip_is_the_mirror_image() -> None:
    """A strip of 8 m at 1 m is a mirror up to its edge waves: the field is minus that of the line source at twice the distance."""
    wave = 2 * np.pi * 77e9 / SPEED_OF_LIGHT
    image = -0.25j * np.sqrt(2 / (np.pi * wave * 2)) * np.exp(1j * (2 * wave - np.pi / 4))  # far form of the Hankel function, k r = 3227
    assert sections_2d.optics(sections_2d.strip(8.0, 1.0, 0.0), 77e9) == pytest.approx(image, rel=5e-3)


@pytest.mark.slow
def test_known_error_of_physical_optics_is_that_of_the_sections() -> None:
    """The stated errors were computed over 11 frames and four frequencies; two frames give the same within a factor of two."""
    errors = {name: sections_2d.error([shapes[0], shapes[-1]]) for name, shapes in sections_2d.cases().items()}
    stated = {"plate": 0.021, "trihedral": 0.144, "trihedral 15 cm": frozen_problems.problem("near").known_error}
    for name, error in errors.items():
        assert stated[name] / 2 < error < 2 * stated[name], name


@pytest.mark.parametrize("name", frozen_problems.names())
def test_scores_of_known_signals(name: str) -> None:
    """The answer itself has no error. Half of it is 6.02 dB low, with a signal error of a half. No signal has a signal error of one."""
    problem = frozen_problems.problem(name)
    signals = {case.name: case.answer for case in problem.scenarios}
    exact = leaderboard.score(problem, signals)
    assert (exact.signal, exact.profile_db) == (0, 0)
    half = leaderboard.score(problem, {key: value / 2 for key, value in signals.items()})
    assert half.signal == pytest.approx(0.5, abs=1e-6)
    assert half.profile_db <= 6.03, "the floor of 40 dB can only lower it"
    assert half.free_db < 0.05
    assert half.offset_db == pytest.approx(-6.02, abs=0.01)
    assert leaderboard.score(problem, {key: 0 * value for key, value in signals.items()}).signal == 1


def test_waves_outside_the_gate_do_not_count() -> None:
    """The full-wave answers are valid up to 1.25 m, so an added echo at 2.1 m changes no score by more than its Hann side lobes."""
    problem = frozen_problems.problem("furnished_drive")
    echo = np.exp(4j * np.pi * frequencies(problem) / SPEED_OF_LIGHT * 2.1)
    signals = {case.name: case.answer + echo * np.abs(case.answer).max() for case in problem.scenarios}
    assert leaderboard.score(problem, signals).signal < 0.02
