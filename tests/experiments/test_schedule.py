"""Recordings along the same track stay with one worker, only one worker scans a room, and parts have every recording once."""

import itertools
from pathlib import Path

import pytest

from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import ROVER, planned
from experiments.campaign.part import part
from experiments.campaign.schedule import SECONDS, RecordingTask, Schedule
from radartwin.config.compose import compose
from radartwin.io.progress import Progress
from radartwin.store.products import Store

CONFIG = compose(["profile=quick"])


@pytest.fixture
def tasks() -> list[RecordingTask]:
    return [
        RecordingTask(CONFIG, Path("cache"), domain, case)
        for domain in ("measured", "twin")
        for case in planned(CONFIG.profile.campaign, domain == "measured")
    ]


def _track(task: RecordingTask) -> tuple[str, str, str]:
    return task.domain, task.case.room, task.case.motion if task.case.motion in ROVER else "bench"


def test_tracks_of_shipped_rooms_come_by_their_time(tasks: list[RecordingTask]) -> None:
    schedule = Schedule(tasks)
    expected = schedule.remaining()
    given = [task for worker in range(len(schedule.tracks)) if (task := schedule.next_task(worker))]
    times = []
    for first in given:
        once, further = SECONDS[first.domain, _track(first)[2]]
        times.append(once + further * (sum(_track(task) == _track(first) for task in tasks) - 1))
    assert times == sorted(times, reverse=True), "no worker waits for a scan"
    assert expected == pytest.approx(sum(times))
    while any([schedule.next_task(worker) for worker in range(len(given))]):
        pass
    assert schedule.remaining() == 0


def test_every_recording_is_made_once_and_a_worker_stays_on_its_track(tasks: list[RecordingTask]) -> None:
    schedule, given = Schedule(tasks), {0: [], 1: []}
    workers = list(given)
    while workers:
        for worker in list(workers):
            task = schedule.next_task(worker)
            if task is None:
                workers.remove(worker)
            else:
                given[worker].append(task)
    names = sorted((task.domain, task.case.name) for assigned in given.values() for task in assigned)
    assert names == sorted((task.domain, task.case.name) for task in tasks)
    for assigned in given.values():
        followed = [_track(task) for task in assigned]
        assert len(set(followed)) == len(list(itertools.groupby(followed)))


def test_no_second_worker_sets_up_a_track_for_a_few_recordings(tasks: list[RecordingTask]) -> None:
    short = [task for task in tasks if task.domain == "twin" and _track(task)[2] == "bench"][:3]
    schedule = Schedule(short)
    assert schedule.next_task(0)
    assert schedule.next_task(1) is None
    assert len([task for _ in short if (task := schedule.next_task(0))]) == 2


def test_recordings_that_differ_in_the_target_alone_share_a_set_up(tmp_path: Path) -> None:
    def set_up(*overrides: str, domain: str = "measured") -> str:
        campaign = Campaign(compose(["profile=quick", *overrides]), Store(tmp_path), Progress(quiet=True))
        (task,) = campaign.missing([(domain, campaign.cases(domain, motion="turntable")[0])]).values()
        return task.setup

    usual = set_up()
    same = [f"measured.gap.{gap}=0" for gap in ("contents", "placement", "person")]
    assert {set_up(change) for change in (*same, "profile.campaign.turns=3")} == {usual}
    others = [set_up(f"measured.gap.{gap}=0") for gap in ("materials", "clutter", "hardware")] + [set_up("seed=1"), set_up(domain="twin")]
    assert len({usual, *others}) == 6


@pytest.mark.parametrize("parts", [1, 7, 100])
def test_parts_have_every_recording_once(tmp_path: Path, parts: int) -> None:
    plan = Campaign(compose(["experiment=campaign_part"]), Store(tmp_path), Progress(quiet=True)).plan()
    by_part = [part(plan, number, parts) for number in range(parts)]
    assert [recording for recordings in by_part for recording in recordings] == plan
    assert max(map(len, by_part)) - min(map(len, by_part)) <= 1
