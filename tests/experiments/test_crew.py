"""Who makes which recordings: tracks stay whole, and a room is scanned by one process while others do something else."""

import itertools
from collections import defaultdict
from typing import Any

import pytest

from experiments.campaigns import crew
from experiments.campaigns.cases import planned
from radartwin.compose import compose


class _Hand:
    """The parent's end of a process: what it was given."""

    def __init__(self):
        self.given = []

    def send(self, piece):
        self.given.append(piece)


def _hand() -> Any:
    return _Hand()


@pytest.fixture
def left() -> Any:
    found = defaultdict(list)
    config = compose(["profile=quick"]).profile.campaign
    for domain in ("measured", "twin"):
        for case in planned(config, domain == "measured"):
            found[crew._track(domain, case)].append((domain, case))
    return found


def _rooms(piece):
    return {(domain, case.room) for domain, case in piece}


def test_scanned_rooms_come_first_one_for_each_process(left):
    one, other = _hand(), _hand()
    hands: Any = {one: (None, None), other: (None, None)}
    crew._give(one, hands, left)
    crew._give(other, hands, left)
    assert _rooms(one.given[0]) | _rooms(other.given[0]) == {("twin", "lab"), ("twin", "squash_court")}
    third = _hand()
    hands[third] = (None, None)
    crew._give(third, hands, left)
    assert {domain for domain, _ in _rooms(third.given[0])} == {"measured"}  # rather than wait for a scan


def test_all_is_given_once_and_a_track_stays_where_it_is(left):
    wanted = sorted(str(one) for some in left.values() for one in some)
    hand, other = _hand(), _hand()
    hands: Any = {hand: (None, None), other: (None, None)}
    ended = []
    while hands:
        for one in list(hands):
            hands[one] = (_Process(ended), hands[one][1])
            crew._give(one, hands, left)
    given = [piece for one in (hand, other) for piece in one.given if piece]
    assert sorted(str(one) for piece in given for one in piece) == wanted
    assert len(ended) == 2
    for one in (hand, other):
        tracks = [crew._track(*piece[0]) for piece in one.given if piece]
        assert len(set(tracks)) == len(list(itertools.groupby(tracks)))


class _Process:
    def __init__(self, ended):
        self._ended = ended

    def join(self):
        self._ended.append(self)
