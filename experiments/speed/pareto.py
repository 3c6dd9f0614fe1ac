"""Find the Pareto front of run time and error, and the distance of a method from the front."""

from collections.abc import Sequence

import numpy as np

Point = tuple[float, float]


def front(points: Sequence[Point]) -> list[bool]:
    """Return for each point whether it is on the Pareto front.

    A point is on the front if no other point is at least as good (as small) in both coordinates and better in one coordinate.

    >>> front([(1, 3), (2, 2), (2, 3), (3, 1)])
    [True, True, False, True]
    """
    return [not any(other[0] <= point[0] and other[1] <= point[1] and other != point for other in points) for point in points]


def shortfall(point: Point, others: Sequence[Point]) -> float:
    """Return the largest factor by which another point is better in both coordinates: 1 on the Pareto front, 1.1 if another is 10 % better.

    >>> shortfall((2.0, 2.0), [(1.0, 1.9), (4.0, 0.1)])
    1.0526315789473684
    """
    better = [min(point[0] / other[0], point[1] / max(other[1], 1e-12)) for other in others]
    return float(np.max([1.0, *better]))
