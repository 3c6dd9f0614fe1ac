"""Warn about a scan that is too large for a room, and name the unit that would give a plausible size."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence

LARGE_M, HIGH_M = 15.0, 7.0  # a squash court is 9.75 m long and 5.64 m high, the atrium 12 m; the radar's range is unambiguous to 11 m
OBJECT_M = 1.0  # a smaller mesh is an object, as in radartwin/scene/objects/meshes.py
ROOM_M, ROOM_HIGH_M = (1.5, LARGE_M), (1.8, HIGH_M)


class ScanWarning(UserWarning):
    """Something about a scan is unusual, but the scan can be read."""


def check_size(extents_m: Sequence[float], source: str, option: str, units_m: Mapping[str, float]) -> None:
    """Warn about a scan that is too large for a room.

    Args:
        extents_m: length, width and height (z up).
        source: name of the scan in the warning.
        option: the command-line option that sets the unit.
        units_m: values of that option, in metres relative to the unit that was used.
    Warns:
        ScanWarning: the scan is too large. The warning states its size, and the units with which it would have the size of a room.
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
