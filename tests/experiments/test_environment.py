"""Tests of the environment table and of its operating points on synthetic recordings with known results."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
import pytest
from fake_campaign import FakeCampaign, config, draw_all, find

from experiments.campaign import frame
from experiments.campaign.campaign import Campaign
from experiments.campaign.columns import AVERAGES
from experiments.turntable import environment, operating_points
from experiments.turntable.operating_points import LEGS_M, Condition, Point
from experiments.verdicts import RowList
from radartwin.io.progress import Progress
from radartwin.runs.experiment import Result, check_rows
from radartwin.scene.objects.assortment import every_object
from radartwin.scene.objects.catalogue import OTHER_LEGS_M, entry

COUNT = "operating points with the paper's figures"


def sources(*distances: float) -> dict[str, Campaign]:
    """Return the campaign of each side of the table."""
    usual: Any = FakeCampaign(distances=distances, offset_m=0.0)
    return environment.sources(usual)


quiet = partial(frame.read, progress=Progress(quiet=True))


@pytest.fixture(scope="module")
def points() -> list[Point]:
    settings = config("environment")
    profiles = quiet(FakeCampaign(distances=(2.0,), offset_m=0.0), operating_points.wanted(settings))
    return operating_points.read(settings, dict.fromkeys(operating_points.conditions(settings), profiles))


@pytest.fixture(scope="module")
def bare() -> Result:
    """Return the table without operating points."""
    settings = config("environment")
    return environment.score(settings, environment.read(settings, sources(0.5, 1.0, 1.5, 2.0), quiet))


@pytest.fixture(scope="module")
def table(bare: Result, points: list[Point]) -> Result:
    return environment.with_points(config("environment"), replace(bare, rows=deepcopy(bare.rows)), points)


def test_the_labelled_room_is_the_default_and_plasterboard_is_a_second_set_of_rows(table: Result) -> None:
    check_rows("environment", table.rows)
    for distance in (0.5, 1.0, 1.5, 2.0):
        for scale in ("amplitude", "db"):
            at = {"distance_m": distance, "scale": scale}
            labelled, uniform, void = (
                find(table, metric="profile correlation", case=case, **at)["value"] for case in ("room (vlm)", "room (uniform)", "void")
            )
            assert labelled > max(uniform, void)  # the synthetic room of plasterboard has its echoes in reverse order
            gain = find(table, metric="gain in correlation", case="room (vlm) - void", **at)
            assert (gain["value"], gain["claim"]) == (pytest.approx(labelled - void), "")
            assert find(table, metric=environment.GAIN, case="room (vlm) - void", **at)["verdict"] == "supported"
            assert not find(table, metric=environment.GAIN, case="room (uniform) - void", **at)["claim"]
        alike = {case: [find(table, metric=metric, distance_m=distance, case=case)["value"] for metric in
                        ("similarity of range-azimuth maps (MS-SSIM)", "complex similarity")]
                 for case in ("room (vlm)", "room (uniform)", "void")}  # fmt: skip
        assert all(0 < value < one for value, one in zip(alike["void"], alike["room (vlm)"], strict=True))
        assert alike["room (uniform)"][1] < alike["room (vlm)"][1] <= 1
    less = find(table, metric="energy share beyond the target, simulated less measured")
    shares = [find(table, metric="energy share beyond the target", distance_m=2.0, case=case)["value"]
              for case in ("room (vlm)", "measured (testbed)")]  # fmt: skip
    assert less["value"] == pytest.approx(shares[0] - shares[1])
    assert less["claim"]
    assert draw_all(table) == {"environment_range_time", "environment_correlation", "environment_operating_points"}


def test_materials_void_and_uniform_leave_out_the_rows_that_they_repeat() -> None:
    for source, labels in (("void", {"void"}), ("uniform", {"void", "room (uniform)"})):
        settings = config("environment", f"materials={source}", "experiment.distances_m=[1.0]")
        result = environment.score(settings, environment.read(settings, sources(1.0), quiet))
        assert {row["case"] for row in result.rows if row["metric"] == "profile correlation"} == labels
        assert not [row for row in result.rows if row["metric"] == COUNT]


def test_the_ratio_of_target_to_room_follows_the_leg(table: Result, points: list[Point]) -> None:
    """The echo of the reflector grows with the fourth power of its leg, and the synthetic room has the same echo at every leg."""
    for average in AVERAGES:
        at_legs = [
            point
            for point in points
            if not point.condition.unscanned and (point.average, point.window, point.scale) == (average, "all ranges", "db")
        ]
        assert [point.leg_m for point in at_legs] == list(LEGS_M["quick"])
        assert np.diff([point.ratio_db for point in at_legs]) == pytest.approx(40 * np.diff(np.log10(LEGS_M["quick"])), abs=1.5)
        assert (np.diff([point.values["share"].mean() for point in at_legs]) < 0).all()
    assert find(table, metric=COUNT)["items"] == 2 * 4 * 4 * 2 * 2  # unscanned echoes, legs, averages, windows, scales
    rows = [row for row in table.rows if row["metric"] == "profile correlation" and "unscanned echoes" in row["case"]]
    assert len(rows) == 2 * operating_points.SHOWN  # without and with the room


def test_averages_of_a_flashing_echo_are_those_of_its_levels() -> None:
    power = np.array([[1.0], [1.0], [1e-4]])
    averages = {name: float(average(power)[0]) for name, average in AVERAGES.items()}
    assert averages == pytest.approx({"mean": 2.0001 / 3, "amplitude": (2.01 / 3) ** 2, "db": 10 ** (-4 / 3), "median": 1.0})


def test_a_window_leaves_out_the_bins_far_from_the_target() -> None:
    """The domains differ only at 4 m, so that their correlation is 1 within 1 m of the target, and smaller over all ranges."""
    range_m = np.arange(0.05, 6.0, 0.05)
    near, far = (np.exp(-0.5 * ((range_m - at) / 0.1) ** 2) + 1e-4 for at in (2.0, 4.0))
    profiles = pd.DataFrame({"domain": ["measured", "twin", "void"], "key": list("abc"), "range_m": [range_m] * 3})
    profiles["mean_power"] = [near + far, near, near]
    points = {
        window: operating_points._point(profiles, 0.1, Condition(True, 0.0), "mean", window, "amplitude").values["room"][0]
        for window in operating_points.WINDOWS_M
    }
    assert points["1 m around the target"] == pytest.approx(1.0, abs=1e-3)
    assert points["all ranges"] < 0.9


def point(share: float, void: float, room: float, leg_m: float = 0.05) -> Point:
    values = {"share": np.full(2, share), "void": np.full(2, void), "room": np.full(2, room)}
    return Point(leg_m, Condition(True, 2.0), "mean", "all ranges", "amplitude", -4.0, values, ["a" * 32, "b" * 32])


def test_a_point_is_accepted_if_all_three_figures_are_inside_their_limits() -> None:
    exact, near = point(0.75, -0.24, 0.42), point(0.70, 0.05, 0.30)
    assert exact.departure == pytest.approx(0.0)
    assert near.accepted
    assert not any(
        outside.accepted for outside in (point(0.6, -0.24, 0.42), point(0.9, -0.24, 0.42), point(0.75, 0.2, 0.42), point(0.75, -0.24, 0.8))
    )
    assert operating_points.best([near, exact, point(0.9, 0.5, 0.9)]) is exact
    assert operating_points.best([point(0.9, 0.5, 0.9)]) is None


@pytest.mark.parametrize(
    ("figures", "verdict", "text"), [((0.75, -0.2, 0.4), "supported", "best"), ((0.72, 0.40, 0.90), "contradicted", "none, nearest")]
)
def test_no_accepted_point_contradicts_the_claim(figures: tuple[float, float, float], verdict: str, text: str) -> None:
    rows = RowList(config("environment"))
    operating_points.add_rows(rows, [point(*figures), point(0.99, 0.99, 0.99, leg_m=0.06)])
    check_rows("environment", rows)
    row = rows[-1]
    assert (row["metric"], row["verdict"]) == (COUNT, verdict)
    assert row["case"].startswith(f"{text}: leg 5 cm, with lobes, unscanned echoes 2, mean of frames, all ranges, amplitude")


def test_the_operating_point_is_a_second_column(bare: Result, points: list[Point], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(operating_points, "best", lambda points: point(0.75, -0.24, 0.42))
    result = environment.with_points(config("environment"), replace(bare, rows=deepcopy(bare.rows)), points)
    filled = {(row["metric"], row["case"]): row for row in result.rows if row.get("at_operating_point") is not None}
    expected = {"measured (testbed)": 0.75, "void": -0.24, "room (vlm)": 0.42}
    assert {case: row["at_operating_point"] for (_, case), row in filled.items()} == pytest.approx(expected)
    assert all(row["distance_m"] == 2.0 and row["scale"] in ("amplitude", "power") for row in filled.values())
    assert all(row["value"] != row["at_operating_point"] for row in filled.values())


def test_reflectors_of_other_sizes_scale_with_their_leg() -> None:
    known, usual = every_object(), entry("corner_reflector")
    for leg in OTHER_LEGS_M:
        reflector = known[f"corner_reflector_{100 * leg:g}cm"]
        assert np.array(reflector.size_m) == pytest.approx(np.array(usual.size_m) * leg / 0.1, abs=2e-4)
        assert reflector.aim_m == pytest.approx(usual.aim_m * leg / 0.1)
        (mesh, usual_mesh) = (of.surfaces()[0].mesh for of in (reflector, usual))
        assert mesh.vertices == pytest.approx(usual_mesh.vertices * leg / 0.1)
