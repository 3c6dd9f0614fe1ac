"""Compare Shapley shares with an additive game, and with the mean of the marginal contributions over all orders of the players."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from experiments.gaps.shapley import alone, coalitions, left_out, shares

PLAYERS = ("a", "b", "c", "d")


def test_in_an_additive_game_all_measures_equal_the_own_value() -> None:
    own: dict[str, float] = {"a": 3.0, "b": -1.0, "c": 0.0, "d": 0.25}
    played = {some: np.array(7.0 + sum(own[one] for one in some)) for some in coalitions(PLAYERS)}
    for player, share in shares(PLAYERS, played).items():
        one = frozenset((player,))
        assert share == pytest.approx(own[player])
        assert alone(played, one) == pytest.approx(own[player])
        assert left_out(played, one, frozenset(PLAYERS)) == pytest.approx(own[player])


def test_shares_are_the_mean_over_all_orders_and_sum_to_the_total() -> None:
    """The game has three players with random values per recording, and a player without influence, whose share must be zero."""
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
