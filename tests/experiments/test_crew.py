"""Who makes which recordings: tracks stay whole, and a room is scanned by one process while others do something else."""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from experiments.campaign.cases import ROVER, planned
from experiments.campaign.crew import PIECE, Tracks, Wanted
from radartwin.config.compose import compose
from radartwin.config.materials import MaterialsConfig

CONFIG = compose(["profile=quick"])


@pytest.fixture
def wanted() -> list[Wanted]:
    return [
        Wanted(CONFIG, Path("cache"), domain, case)
        for domain in ("measured", "twin")
        for case in planned(CONFIG.profile.campaign, domain == "measured")
    ]


def _rooms(piece: Sequence[Wanted] | None) -> set[tuple[str, str]]:
    assert piece
    return {(one.domain, one.case.room) for one in piece}


def _track(one: Wanted) -> tuple[str, str, str]:
    return one.domain, one.case.room, one.case.motion if one.case.motion in ROVER else "bench"


def test_scanned_rooms_come_first_one_for_each_process(wanted: list[Wanted]) -> None:
    tracks = Tracks(wanted)
    assert _rooms(tracks.give("one")) | _rooms(tracks.give("other")) == {("twin", "lab"), ("twin", "squash_court")}
    assert {domain for domain, _ in _rooms(tracks.give("third"))} == {"measured"}  # rather than wait for a scan


def test_all_is_given_once_and_a_track_stays_where_it_is(wanted: list[Wanted]) -> None:
    tracks, given = Tracks(wanted), {"one": [], "other": []}
    hands = list(given)
    while hands:
        for hand in list(hands):
            piece = tracks.give(hand)
            if piece is None:
                hands.remove(hand)
            else:
                given[hand].append(piece)
    names = sorted((one.domain, one.case.name) for pieces in given.values() for piece in pieces for one in piece)
    assert names == sorted((one.domain, one.case.name) for one in wanted)
    for pieces in given.values():
        followed = [_track(piece[0]) for piece in pieces]
        assert all({_track(one) for one in piece} == {track} for piece, track in zip(pieces, followed, strict=True))
        assert len(set(followed)) == len(list(itertools.groupby(followed)))


def test_two_materials_of_a_room_are_two_tracks_unless_they_set_up_the_same(wanted: list[Wanted]) -> None:
    driven = [one for one in wanted if _track(one) == ("twin", "squash_court", "lateral")]
    other = replace(CONFIG, materials=MaterialsConfig("true"))
    assert other.materials != CONFIG.materials
    mixed = [replace(one, config=config) for one in driven for config in (CONFIG, other)]
    tracks = Tracks(mixed)
    assert len(tracks.left) == 2
    for hand, config in (("one", CONFIG), ("other", other)):
        piece = tracks.give(hand)
        assert piece == [replace(one, config=config) for one in driven]
    alike = [replace(one, setup="same") for one in mixed]
    together = Tracks(alike)
    assert together.give("one") == alike[:PIECE]
    assert len(together.left) == 1
