"""Tests of the environment table and of its operating points on synthetic recordings with known results."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from fake_campaign import FakeCampaign, config, draw_all, find

from experiments.campaign import frame
from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import Case
from experiments.claims import RowList
from experiments.turntable import environment, operating_points
from experiments.turntable.operating_points import LEGS_M, Point
from radartwin.errors import ConfigError
from radartwin.features.log import Nominal
from radartwin.io.progress import Progress
from radartwin.runs.experiment import Result, check_rows
from radartwin.scene.objects.catalogue import OTHER_LEGS_M, entry, with_other_reflectors
from radartwin.store.products import Store

COUNT = "operating points with the paper's figures"


class Marked(FakeCampaign):
    """A synthetic campaign whose target is exactly at the distance of its case."""

    def log(self, case: Case, domain: str = "measured") -> Nominal:
        log = super().log(case, domain)
        return Nominal(log.frame_rate_hz, np.full(len(log.distance_m), case.distance_m), log.angle_rad)


quiet = partial(frame.read, progress=Progress(quiet=True))


def scored() -> Result:
    chosen, campaign = config("environment"), Marked(distances=(0.5, 1.0, 1.5, 2.0))
    points = operating_points.read(chosen, {True: quiet(campaign, operating_points.wanted(chosen))})
    return environment.with_points(chosen, environment.score(chosen, environment.read(chosen, campaign, quiet)), points)


@pytest.fixture(scope="module")
def table() -> Result:
    return scored()


def test_the_labelled_room_is_the_default_and_plasterboard_is_a_second_set_of_rows(table: Result) -> None:
    check_rows("environment", table.rows)
    for distance in (0.5, 1.0, 1.5, 2.0):
        for scale in ("amplitude", "db"):
            labelled, uniform, void = (
                find(table, metric="profile correlation", distance_m=distance, scale=scale, case=case)["value"]
                for case in ("room (vlm)", "room (uniform)", "void")
            )
            assert labelled > max(uniform, void)  # the synthetic room of plasterboard has its echoes in reverse order
            gain = find(table, metric="gain in correlation", distance_m=distance, scale=scale, case="room (vlm) - void")
            assert gain["value"] == pytest.approx(labelled - void)
            assert not gain["claim"]
            assert (
                find(table, metric=environment.GAIN, distance_m=distance, scale=scale, case="room (vlm) - void")["verdict"] == "supported"
            )
            assert not find(table, metric=environment.GAIN, distance_m=distance, scale=scale, case="room (uniform) - void")["claim"]
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
        chosen = config("environment", f"materials={source}", "experiment.distances_m=[1.0]")
        result = environment.score(chosen, environment.read(chosen, Marked(distances=(1.0,)), quiet))
        assert {row["case"] for row in result.rows if row["metric"] == "profile correlation"} == labels
        assert not [row for row in result.rows if row["metric"] == COUNT]


def test_the_ratio_of_target_to_room_follows_the_leg(table: Result) -> None:
    """The echo of the reflector grows with the fourth power of its leg, and the synthetic room has the same echo at every leg."""
    for statistic in ("mean", "median"):
        rows = [
            find(table, metric="energy share beyond the target", case=f"measured, leg {100 * leg:g} cm, with lobes, {statistic} of frames")
            for leg in LEGS_M["quick"]
        ]
        ratio = np.array([row["target_to_room_db"] for row in rows])
        assert np.diff(ratio) == pytest.approx(40 * np.diff(np.log10(LEGS_M["quick"])), abs=1.5)
        assert (np.diff([row["value"] for row in rows]) < 0).all()
    count = find(table, metric=COUNT)
    assert count["items"] == 4 * 2 * 2  # legs, mean and median, scales


def test_the_paper_profile_compares_eight_legs_and_antennas_with_and_without_lobes(tmp_path) -> None:
    paper = config("environment", "profile=paper")
    assert LEGS_M["paper"] == pytest.approx(np.arange(5, 13) / 100)
    assert operating_points.compared_lobes(paper) == (True, False)
    assert operating_points.without_lobes(paper).measured.gap.antenna == 0
    fake = quiet(Marked(distances=(0.5, 1.0, 1.5, 2.0), frames=14), operating_points.wanted(paper))
    points = operating_points.read(paper, {True: fake, False: fake})
    assert len(points) == 8 * 2 * 2 * 2
    store = Store(tmp_path)
    tasks = environment.recordings(paper, store, Progress(quiet=True)).values()
    bare = [task for task in tasks if task.config.measured.gap.antenna == 0]
    assert len(bare) == 8 * operating_points.DRAWS  # simulations do not depend on the measuring antennas
    quick = environment.recordings(config("environment"), store, Progress(quiet=True)).values()
    planned = set(Campaign(config("environment"), store, Progress(quiet=True)).cases("measured"))
    assert sum(task.domain == "measured" and task.case not in planned for task in quick) == 3 * operating_points.DRAWS


def point(share: float, void: float, room: float, leg_m: float = 0.05) -> Point:
    values = {"share": np.full(2, share), "void": np.full(2, void), "room": np.full(2, room)}
    return Point(leg_m, True, "mean", "amplitude", -4.0, values, ["a" * 32, "b" * 32])


def test_a_point_is_accepted_if_all_three_figures_are_inside_their_limits() -> None:
    exact, near = point(0.75, -0.24, 0.42), point(0.70, 0.05, 0.30)
    assert exact.departure == pytest.approx(0.0)
    assert near.accepted
    assert not any(
        one.accepted for one in (point(0.6, -0.24, 0.42), point(0.9, -0.24, 0.42), point(0.75, 0.2, 0.42), point(0.75, -0.24, 0.8))
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
    assert row["case"].startswith(f"{text}: leg 5 cm, with lobes, mean of frames, amplitude")


def test_the_operating_point_is_a_second_column(monkeypatch) -> None:
    best = point(0.75, -0.24, 0.42)
    monkeypatch.setattr(operating_points, "best", lambda points: best)
    result = scored()
    filled = {(row["metric"], row["case"]): row for row in result.rows if row.get("at_operating_point") is not None}
    expected = {"measured (testbed)": 0.75, "void": -0.24, "room (vlm)": 0.42}
    assert {case: row["at_operating_point"] for (_, case), row in filled.items()} == pytest.approx(expected)
    assert all(row["distance_m"] == 2.0 and row["scale"] in ("amplitude", "power") for row in filled.values())
    assert all(row["value"] != row["at_operating_point"] for row in filled.values())


def test_recorded_measurements_have_no_operating_points() -> None:
    elsewhere = config("environment", "experiment.distances_m=[1.0]")
    assert operating_points.compared_lobes(elsewhere) == ()
    assert operating_points.compared_lobes(config("environment", "measured.gap.antenna=0", "profile=paper")) == (False,)
    with pytest.raises(ConfigError, match="not read by experiment=environment"):
        environment.check(config("environment", "scene=atrium"))


def test_reflectors_of_other_sizes_scale_with_their_leg() -> None:
    known, usual = with_other_reflectors(), entry("corner_reflector")
    for leg in OTHER_LEGS_M:
        one = known[f"corner_reflector_{100 * leg:g}cm"]
        assert np.array(one.size_m) == pytest.approx(np.array(usual.size_m) * leg / 0.1, abs=2e-4)
        assert one.aim_m == pytest.approx(usual.aim_m * leg / 0.1)
        (mesh, usual_mesh) = (of.surfaces()[0].mesh for of in (one, usual))
        assert mesh.vertices == pytest.approx(usual_mesh.vertices * leg / 0.1)
