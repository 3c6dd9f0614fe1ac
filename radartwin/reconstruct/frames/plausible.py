"""Sizes that are odd for a scan: said, with the unit in which they would not be."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence

LARGE_M, HIGH_M = 15.0, 7.0  # a squash court is 9.75 m long and 5.64 m high, the atrium 12 m; the radar itself folds at 11 m
OBJECT_M = 1.0  # what is smaller is no room, as in radartwin/scene/objects/meshes.py
ROOM_M, ROOM_HIGH_M = (1.5, LARGE_M), (1.8, HIGH_M)


class ScanWarning(UserWarning):
    """What is odd about a scan that can be read all the same."""


def check_size(extents_m: Sequence[float], source: str, option: str, units_m: Mapping[str, float]) -> None:
    """Warn of a scan too large for a room.

    Args:
        extents_m: length, width, height (z up).
        option: by which the user says the unit; units_m: its values, and metres per unit relative to the one taken.
    Warns:
        ScanWarning: with the size, and the units in which it would be a room's.
    """
    x, y, z = extents_m
    if max(x, y) <= LARGE_M and z <= HIGH_M:
        return
    fits = [
        f"{option} {name} would make it {x * unit:.1f} x {y * unit:.1f} x {z * unit:.1f} m"
        for name, unit in units_m.items()
        if ROOM_M[0] <= max(x, y) * unit <= ROOM_M[1] and ROOM_HIGH_M[0] <= z * unit <= ROOM_HIGH_M[1]
    ]
    text = f"{source} is {x:.1f} x {y:.1f} x {z:.1f} m, large for a room; check {option}"
    warnings.warn("; ".join([text, *fits]), ScanWarning, stacklevel=3)
