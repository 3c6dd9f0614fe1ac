"""Tests of the linear-rail table on echoes of known motion, with and without a strong echo of the room."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from echoes import RADAR, echoes
from fake_campaign import config, draw_all, find, frame_of

from experiments.campaign.cases import RAIL, Case, Motion
from experiments.turntable import linear_rail
from radartwin.features.log import Nominal
from radartwin.features.processed import Processed, process
from radartwin.runs.experiment import Result

FRAMES = 31
SPEED_MPS = 0.2


def range_m(motion: str, time: np.ndarray) -> np.ndarray:
    moved = SPEED_MPS * time
    return 1 + moved if motion == "radial" else np.hypot(1 + moved / np.sqrt(2), moved / np.sqrt(2))


class Rail:
    """Recordings along a rail. The measured target is 2 cm farther, and beside a constant echo of amplitude `clutter` at 1.3 m."""

    def __init__(self, clutter: float, motions: Sequence[Motion] = ("radial", "diagonal")) -> None:
        self.clutter, self.motions = clutter, motions

    def cases(self, domain: str, **conditions: Any) -> list[Case]:
        repetitions = range(3 if domain == "measured" else 1)
        return [Case("corner_reflector", "lab", m, 1.0, r) for m in self.motions if m == conditions["motion"] for r in repetitions]

    def log(self, case: Case, domain: str = "measured") -> Nominal:
        return Nominal(RADAR.frame_rate_hz, range_m(case.motion, np.arange(FRAMES) / RADAR.frame_rate_hz), None)

    def prepare(self, wanted) -> None: ...

    def processed(self, domain: str, case: Case) -> tuple[str, Processed]:
        clutter = [(self.clutter, 1.3)] if domain == "measured" else []
        offset = 0.02 if domain == "measured" else 0.0
        reflector = (lambda t: 1e-3 / range_m(case.motion, t) ** 2, lambda t: range_m(case.motion, t) + offset)
        moving = echoes(FRAMES, [reflector, *clutter], 1e-5, case.repetition)
        return f"{domain}{case.motion}{case.repetition}", process(moving, doppler=False)


def table(clutter: float) -> Result:
    return linear_rail.score(config("linear_rail"), frame_of(Rail(clutter), *RAIL))


def test_both_trackers_match_the_rail_without_clutter() -> None:
    result = table(clutter=0.0)
    for tracker in linear_rail.TRACKERS:
        for of in ("measured", "simulated"):
            excursion = {"metric": "excursion (m)", "of": of, "tracker": tracker}
            assert find(result, motion="radial", **excursion)["value"] == pytest.approx(0.6, abs=2e-3)
            assert find(result, motion="diagonal", **excursion)["value"] == pytest.approx(0.4861, abs=2e-3)
            row = find(result, metric="excursion less the rail's (m)", motion="radial", of=of, tracker=tracker)
            assert row["verdict"] == ("supported" if tracker == "continuous" else "")
        shape = find(result, metric="shape correlation", motion="radial", of="both", tracker=tracker)
        assert shape["value"] > 0.999
        assert shape["verdict"] == ("supported" if tracker == "continuous" else "")
        assert shape["n"] == 4
    assert result.metrics["excursion_radial_measured"] == pytest.approx(0.6, abs=2e-3)
    assert draw_all(result) == {"linear_rail"}


def test_a_constant_room_echo_shortens_the_excursion_of_the_brightest_bin() -> None:
    result = table(clutter=8e-4)
    short = find(result, metric="excursion less the rail's (m)", motion="diagonal", of="measured", tracker="brightest")
    assert short["high"] < -0.1
    twin = find(result, metric="excursion less the rail's (m)", motion="radial", of="simulated", tracker="brightest")
    assert abs(twin["value"]) < linear_rail.WITHIN_M


def test_a_simulation_that_reads_too_far_does_not_shorten_the_measured_diagonal() -> None:
    class Long(Rail):
        def processed(self, domain: str, case: Case) -> tuple[str, Processed]:
            if domain == "measured":
                return super().processed(domain, case)
            moving = echoes(FRAMES, [(1e-3, lambda t: 1 + 0.7 * t / t.max())], 1e-5, 0)
            return f"{domain}{case.motion}", process(moving, doppler=False)

    result = linear_rail.score(config("linear_rail"), frame_of(Long(0.0), *RAIL))
    diagonal = {"motion": "diagonal", "tracker": "continuous"}
    twin = find(result, metric="measured less simulated excursion (m)", **diagonal)
    assert twin["high"] < -linear_rail.SHORTER_M
    assert twin["claim"] == ""
    assert find(result, metric="excursion less the rail's (m)", of="measured", **diagonal)["verdict"] == "not testable here"
    assert find(result, metric="excursion less the rail's (m)", of="simulated", **diagonal)["claim"] == ""
