"""Shapley shares against closed-form games and against the mean over all orders."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations

import numpy as np
import pytest

from experiments.gaps.shapley import Coalition, Game, alone, coalitions, left_out, shares
from radartwin.errors import InputError

PLAYERS = ("a", "b", "c", "d")


def game(value: Callable[[Coalition], float], players: tuple[str, ...] = PLAYERS) -> Game:
    return {some: np.array(value(some)) for some in coalitions(players)}


def test_every_coalition_is_listed_once() -> None:
    assert len(set(coalitions(PLAYERS))) == len(list(coalitions(PLAYERS))) == 2 ** len(PLAYERS)


def test_in_an_additive_game_all_measures_equal_the_own_value() -> None:
    own: dict[str, float] = {"a": 3.0, "b": -1.0, "c": 0.0, "d": 0.25}
    played = game(lambda some: 7.0 + sum(own[one] for one in some))
    for player, share in shares(PLAYERS, played).items():
        one = frozenset((player,))
        assert share == pytest.approx(own[player])
        assert alone(played, one) == pytest.approx(own[player])
        assert left_out(played, one, frozenset(PLAYERS)) == pytest.approx(own[player])


@pytest.mark.parametrize(("left", "right"), [(1, 2), (1, 3), (2, 2)])
def test_glove_game_matches_closed_form(left: int, right: int) -> None:
    """Value of pairs of gloves: one left glove against m right gloves has the share m / (m + 1); two against two have 1/2 each."""
    lefts, rights = [f"l{n}" for n in range(left)], [f"r{n}" for n in range(right)]
    players = (*lefts, *rights)
    played = game(lambda some: float(min(len(some & set(lefts)), len(some & set(rights)))), players)
    found = shares(players, played)
    expected = 0.5 if left == right else right / (right + 1)
    assert found["l0"] == pytest.approx(expected)
    assert found["r0"] == pytest.approx((min(left, right) - left * expected) / right)


def test_in_a_game_that_needs_all_players_shares_are_equal() -> None:
    all_players = frozenset(PLAYERS)
    played = game(lambda some: float(some == all_players))
    for player, share in shares(PLAYERS, played).items():
        assert share == pytest.approx(1 / len(PLAYERS))
        assert alone(played, frozenset((player,))) == 0
        assert left_out(played, frozenset((player,)), all_players) == 1


def test_shares_are_the_mean_over_all_orders_and_sum_to_the_total() -> None:
    """Three players with random values per recording, and a player without influence, whose share is zero."""
    rng = np.random.default_rng(0)
    drawn = {some: rng.standard_normal(5) for some in coalitions(PLAYERS[:3])}
    played = {some: drawn[some - {"d"}] for some in coalitions(PLAYERS)}
    found = shares(PLAYERS, played)
    orders = list(permutations(PLAYERS))
    for player in PLAYERS:
        before = [frozenset(order[: order.index(player)]) for order in orders]
        counted = np.mean([played[some | {player}] - played[some] for some in before], axis=0)
        np.testing.assert_allclose(found[player], counted, atol=1e-12)
    np.testing.assert_allclose(sum(found.values()), played[frozenset(PLAYERS)] - played[frozenset()], atol=1e-12)
    np.testing.assert_allclose(found["d"], 0, atol=1e-12)


def test_a_missing_value_is_named() -> None:
    played = dict(game(len))
    del played[frozenset("ab")]
    with pytest.raises(InputError, match="no value for a, b"):
        shares(PLAYERS, played)
