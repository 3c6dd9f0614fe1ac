"""Exact Shapley values: divide the value of a coalition (set of players) among its players.

Symbols: N -> players, S -> coalition, v(S) -> value, phi_i -> share of player i.

The share of a player is its mean gain over all orders in which the players can join the coalition:

    phi_i = sum over S without i of |S|! (|N| - |S| - 1)! / |N|! (v(S + i) - v(S)).

The shares sum to v(N) - v({}). They are linear in v, so that one value per recording gives one share per recording, and they have no
sampling error. Ref: L. S. Shapley, A Value for n-Person Games, 1953.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from math import factorial

import numpy as np
from numpy.typing import NDArray

Coalition = frozenset[str]
Game = Mapping[Coalition, NDArray[np.float64]]


def coalitions(players: Sequence[str]) -> Iterator[Coalition]:
    """Yield all 2^n coalitions (sets) of n players; small coalitions come first."""
    return (frozenset(members) for size in range(len(players) + 1) for members in combinations(players, size))


def shares(players: Sequence[str], value: Game) -> dict[str, NDArray[np.float64]]:
    """Return {player: Shapley share}; `value` maps every coalition to an array, and each share is an array of the same shape.

    >>> glove = {s: np.array(float("left" in s and len(s) > 1)) for s in coalitions(["left", "right", "other right"])}
    >>> {player: round(float(share), 3) for player, share in shares(["left", "right", "other right"], glove).items()}
    {'left': 0.667, 'right': 0.167, 'other right': 0.167}
    """
    count = len(players)
    by_player = {}
    for player in players:
        others = [other for other in players if other != player]
        parts = []
        for before in coalitions(others):
            weight = factorial(len(before)) * factorial(count - len(before) - 1) / factorial(count)
            parts.append(weight * (value[before | {player}] - value[before]))
        by_player[player] = np.sum(parts, axis=0)
    return by_player


def alone(value: Game, player: Coalition) -> NDArray[np.float64]:
    """Return the value of the coalition of these players alone, minus the value of the empty coalition."""
    return value[player] - value[frozenset()]


def left_out(value: Game, player: Coalition, all_players: Coalition) -> NDArray[np.float64]:
    """Return the decrease of the value if these players leave the coalition of all players."""
    return value[all_players] - value[all_players - player]
