"""Several processes that make recordings: who takes what, and what is said when one of them is lost."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

import pytest

from experiments.campaigns import crew
from experiments.campaigns.campaign import Campaign
from experiments.campaigns.cases import Case
from radartwin.compose import compose
from radartwin.errors import BackendError, ConfigError, InputError
from radartwin.progress import Progress
from radartwin.store import Store


class Post:
    """The parent's end of a pipe, and a process that has ended."""

    def __init__(self) -> None:
        self.sent: list = []

    def send(self, piece) -> None:
        self.sent.append(piece)

    def join(self) -> None:
        pass


def drives(room: str, count: int) -> list[crew.Wanted]:
    return [("measured", Case("mug", room, "depth", 1.0, number)) for number in range(count)]


def test_few_recordings_and_one_job_stay_in_this_process():
    assert crew.hands(0, crew.LEAST - 1) == 1
    assert crew.hands(1, 100) == 1
    assert crew.hands(3, 100) == 3
    assert crew.hands(16, 6) == 3


def test_each_keeps_to_its_track_then_takes_over():
    left = defaultdict(list, {"atrium": drives("atrium", 30), "court": drives("squash_court", 10)})
    first, second = Post(), Post()
    staff: dict = {first: (first, ""), second: (second, "")}
    for one in (first, second, second, first, second):
        crew._give(one, staff, left)  # type: ignore[arg-type]
    rooms = [[piece[0][1].room if piece else None for piece in one.sent] for one in (first, second)]
    assert rooms == [["atrium", "atrium"], ["squash_court", "atrium", None]]
    assert second not in staff  # sent home
    assert sum(len(piece) for one in (first, second) for piece in one.sent if piece) == 40


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    """Turns of two cans in free space, a second each."""
    overrides = [
        "measured.gap.solver=0", "measured.gap.clutter=0", "materials=void", f"output={tmp_path_factory.mktemp('crew')}",
        "profile.campaign.turntable_objects=[can_211_400,can_211_300]", "profile.campaign.turntable_distances_m=[1.0,1.5]",
        "profile.campaign.frames_per_turn=4", "profile.campaign.turns=1",
    ]  # fmt: skip
    return compose(overrides)


def test_processes_make_the_same_bytes_as_one(config, tmp_path):
    wanted = [("void", case) for case in Campaign(config, Store(tmp_path / "none"), Progress(quiet=True)).cases("void", motion="turntable")]
    assert len(wanted) == 4
    found = []
    for jobs in (1, 2):
        chosen = replace(config, jobs=jobs, output=str(tmp_path / str(jobs)))
        campaign = Campaign(chosen, Store(tmp_path / str(jobs) / "cache"), Progress(quiet=True))
        campaign.prepare(wanted)
        assert all(campaign.holds(*one) for one in wanted) == (jobs == 2)  # one process makes each when it is asked for
        found.append([sorted(path.read_bytes() for path in campaign.process(*one).path.glob("*.npz")) for one in wanted])
    assert found[0] == found[1]


def test_a_refusal_reaches_the_parent(config, tmp_path):
    """A domain that there is not is refused in the child as it would be here."""
    with pytest.raises(InputError, match="no domain 'vold'"):
        crew.make(replace(config, output=str(tmp_path)), [("vold", Case("can_211_400", "lab", "turntable", 1.0))], 1, lambda: None)


def test_a_process_that_is_killed_is_named(config, tmp_path, monkeypatch):
    chosen = replace(config, output=str(tmp_path))
    real = crew._give

    def give_and_kill(to, staff, left):
        real(to, staff, left)
        if to in staff:
            staff[to][0].kill()

    monkeypatch.setattr(crew, "_give", give_and_kill)
    with pytest.raises(BackendError, match="jobs=1 needs least memory"):
        crew.make(chosen, [("void", Case("can_211_400", "lab", "turntable", 1.0))], 1, lambda: None)


def test_jobs_below_zero_are_refused():
    with pytest.raises(ConfigError, match="jobs=-1"):
        compose(["jobs=-1"])
