"""Tests of single differences between simulation and measurement: each changes its own feature, and without them both agree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments import cells
from experiments.campaign.cases import Case, Log
from experiments.gaps import case_set, gaps
from experiments.verdicts import Row
from radartwin.config.compose import compose
from radartwin.config.config import Config
from radartwin.config.study import GapConfig
from radartwin.errors import ConfigError
from radartwin.features.processed import MAX_RANGE_M, Processed
from radartwin.io.progress import Progress
from radartwin.radar.chirp import Radar
from radartwin.radar.processing import range_axis, velocity_axis
from radartwin.store.products import Store

RADAR = Radar.iwr1843()
FRAMES = 24
CONFIG = compose(["experiment=gaps", "output=/tmp/nowhere"])
ANGLE = 2 * np.pi * np.arange(FRAMES) / FRAMES


def rows_of(draws: Sequence[Mapping[Case, Mapping[str, float]]]) -> list[Row]:
    """Return the rows of the hardware gap from the changes of the features of each case in each draw."""
    at = {"gap": "hardware", "strength": 1.0, "key": ["key"]}
    frames = [pd.DataFrame([{**at, "draw": 0, "case": case, **moves} for case, moves in moves_of.items()]) for moves_of in draws]
    return cells.joined_rows([cell.row(CONFIG) for cell in gaps.cells(CONFIG, frame)] for frame in frames)


def reading(target: np.ndarray, room: complex = 1e-4, offset_m: float = 0.0, floor: float = 1e-16) -> case_set.Reading:
    """Return the features of a target with amplitudes (F,) at 1 m and an echo of the room at 3 m; each echo is one range bin wide."""
    axis = range_axis(RADAR, RADAR.num_samples)
    axis = axis[axis <= MAX_RANGE_M]
    channels = np.zeros((FRAMES, 8, len(axis)), np.complex64)
    channels[:, :, np.abs(axis - 1.0 - offset_m).argmin()] = target[:, None]
    channels[:, :, np.abs(axis - 3.0).argmin()] += room
    power = (np.abs(channels) ** 2).mean(axis=1).astype(np.float32) + np.float32(floor)
    processed = Processed(RADAR, axis, power, channels, None, velocity_axis(RADAR, RADAR.num_chirps), np.full(len(axis), floor, np.float32))
    places = np.tile(np.eye(4), (FRAMES, 1, 1))
    places[:, 0, 3] = 1.0
    return case_set.read("key", processed, Log(FRAMES / 25, np.eye(4)[None], places, ANGLE))


STEADY = np.full(FRAMES, 1e-3)


def test_each_change_moves_its_own_feature_by_the_expected_amount() -> None:
    base = reading(STEADY)
    twice = case_set.moved(reading(2 * STEADY), base)
    assert twice["target brightness (dB)"] == pytest.approx(6.02, abs=0.01)
    assert twice["target change (dB)"] == pytest.approx(0.0, abs=0.01)  # ratio of the amplitude change |2 - 1| to the amplitude 1
    assert twice["room level (dB)"] == pytest.approx(0.0, abs=0.01)
    assert twice["room change (dB)"] < -100
    louder = case_set.moved(reading(STEADY, room=1e-3), base)
    assert louder["room level (dB)"] == pytest.approx(20.0, abs=0.01)
    assert louder["target brightness (dB)"] == pytest.approx(0.0, abs=1e-3)
    assert louder["multipath share"] == pytest.approx(0.5 - 1 / 101, abs=1e-3)
    turned = case_set.moved(reading(STEADY * np.exp(1j)), base)
    assert turned["target change (dB)"] == pytest.approx(20 * np.log10(2 * np.sin(0.5)), abs=0.01)
    assert turned["target brightness (dB)"] == pytest.approx(0.0, abs=1e-3)
    away = case_set.moved(reading(STEADY, offset_m=RADAR.range_resolution_m), base)
    assert away["track rms (mm)"] == pytest.approx(1e3 * RADAR.range_resolution_m, rel=0.01)
    lobed = case_set.moved(reading(1e-3 * np.sqrt(1 + 0.5 * np.cos(2 * ANGLE))), base)
    assert lobed["angular harmonic ratio"] == pytest.approx(0.25**2, rel=0.01)
    same = case_set.moved(base, base)
    assert same["profile correlation"] == pytest.approx(1.0)
    assert same["target change (dB)"] == case_set.LOWEST_DB
    assert case_set.profile_difference_db(reading(2 * STEADY, room=2e-4, floor=4e-16), base) == pytest.approx(6.02, abs=0.01)


def test_a_single_gap_leaves_all_others_off() -> None:
    for gap in case_set.GAPS:
        strengths = asdict(case_set.alone(CONFIG, gap, 2.0).measured.gap)
        assert strengths.pop(gap) == 2.0
        assert set(strengths.values()) == {0.0}
    assert set(asdict(case_set.alone(CONFIG).measured.gap).values()) == {0.0}
    with pytest.raises(ConfigError, match="choose geometry"):
        case_set.alone(CONFIG, "weather")


BASE = reading(STEADY)
STILL = case_set.moved(BASE, BASE) | {"noise floor (dB)": -138.0, "level at zero range, risen by (dB)": 40.0}


def test_a_claim_is_judged_by_the_measured_change() -> None:
    """Line losses and IF filter reduce the level by 7.7 dB at 1 m, so that a change of 0 dB contradicts the claim."""
    for level, verdict in ((-7.7, "supported"), (0.0, "contradicted")):
        moved = STILL | {"target brightness (dB)": level}
        moves = {case: {name: value + 1e-3 * k for name, value in moved.items()} for k, case in enumerate(case_set.CASES)}
        rows = rows_of([moves])
        verdicts = {(row["cases"], row["metric"]): row["verdict"] for row in rows}
        assert verdicts["turntable, metal", "target brightness (dB)"] == verdict
        assert verdicts["turntable", "noise floor (dB)"] == "supported"
        assert verdicts["drive", "room change (dB)"] == ""  # the table makes no claim about this feature


def test_an_interval_contains_the_spread_between_draws() -> None:
    """The three objects of a draw change by the same value, so that all width of the interval comes from the draws."""
    levels = (-7.0, -8.0, -9.0)
    draws = [dict.fromkeys(case_set.CASES, STILL | {"target brightness (dB)": level}) for level in levels]
    for count, width in ((1, 0.0), (3, 1.0)):
        rows = rows_of(draws[:count])
        row = next(row for row in rows if (row["cases"], row["metric"]) == ("turntable, metal", "target brightness (dB)"))
        assert (row["draws"], row["value"]) == (count, pytest.approx(np.mean(levels[:count])))
        assert (row["high"] - row["low"] > width) == (count > 1)


def test_very_different_changes_of_three_objects_have_an_interval() -> None:
    """A widened interval of amplitudes could extend below zero, which has no decibels; that of decibels does not."""
    moves = [
        {case: STILL | {"target change (dB)": level} for case, level in zip(case_set.CASES, levels, strict=True)}
        for levels in ((-20.0, -60.0, -70.0, -30.0), (-22.0, -65.0, -75.0, -30.0))
    ]
    (row,) = (row for row in rows_of(moves) if row["metric"] == "target change (dB)" and row["cases"] == "turntable")
    assert np.isfinite([row["low"], row["high"]]).all()
    assert row["low"] < row["value"] < row["high"]


def test_draws_of_a_gap_differ(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each draw of a gap has its own scan or its own measured case. The case's draw chooses seeds and radar board."""
    asked: list[tuple[str, int, int]] = []

    def recorded(
        settings: Config, store: Store, progress: Progress, domain: str, case: Case, frames: int | None = None
    ) -> case_set.Reading:
        asked.append((domain, settings.seed, case.draw))
        return reading(STEADY * (1 + 1e-3 * len(asked)))

    monkeypatch.setattr(case_set, "recorded", recorded)
    monkeypatch.setattr(gaps, "GAPS", ("geometry", "antenna", "solver"))
    monkeypatch.setattr(gaps, "DRAWS", {"quick": 3})
    monkeypatch.setattr(gaps, "_figure", None)
    monkeypatch.setattr(gaps, "INTERPOLATED", {})
    result = gaps.run(replace(CONFIG, output=str(tmp_path)), Store(tmp_path), Progress())
    assert {recording for recording in asked if recording[0] == "twin"} == {("twin", seed, 0) for seed in (0, 1000, 2000)}
    assert {recording for recording in asked if recording[0] == "measured"} == {("measured", 0, draw) for draw in range(3)}
    assert {row["gap"]: row["draws"] for row in result.rows} == {"none": 1, "geometry": 3, "antenna": 3, "solver": 1}


def test_a_gap_without_a_source_is_refused() -> None:
    @dataclass
    class Extended(GapConfig):
        weather: float = 1.0

    with pytest.raises(ConfigError, match=r"measured\.gap\.weather has no source"):
        Extended()


def test_both_domains_agree_with_every_gap_off(tmp_path: Path) -> None:
    """The vertices of rooms are float32 numbers, so that the stored room of the twin is the true room."""
    off = case_set.alone(replace(CONFIG, output=str(tmp_path)))
    off = replace(off, profile=replace(off.profile, campaign=replace(off.profile.campaign, frames_per_turn=16)))
    case, progress = Case("drink_can_355", "lab", "turntable", 1.0), Progress()
    store = Store(tmp_path)
    measured = case_set.recorded(off, store, progress, "measured", case)
    twin = case_set.recorded(off, store, progress, "twin", case)
    for bins in (measured.target, ~measured.target):
        assert case_set.change_db(twin, measured, bins) < -80
    assert case_set.profile_difference_db(twin, measured) < 0.01
