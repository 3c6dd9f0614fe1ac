"""Read the antennas of a user's own array from a table, a CSV file with a header line.

A row describes one antenna. The order of the transmitters in the table is their firing order.

| column | meaning |
|---|---|
| antenna | tx or rx |
| x_m, y_m, z_m | position of the phase centre in metres, in the sensor frame (x forward, y left, z up); a column that is left out is 0 |
| x_half_wavelength, ... | the same in half wavelengths at design_frequency_hz, in place of metres |
| design_frequency_hz | frequency in Hz that sets the half wavelength; required for positions in half wavelengths, and equal in all rows |
| gain_db | power gain of the antenna in addition to its pattern, in dB; 0 if left out |
| pattern | name of the antenna pattern (radartwin.radar.antenna), equal in all rows; the radar's own pattern if left out |
"""

from __future__ import annotations

import math
import re
import reprlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import RecordingError
from radartwin.radar.antenna import ELEMENTS
from radartwin.radar.description_files import read_csv
from radartwin.radar.field_checks import check_distinct

MAX_SPAN_M = 2.0  # largest plausible size of an array along an axis, in metres; positions of a larger array are in another unit
MAX_GAIN_DB = 100.0  # no antenna has a larger gain or loss
_COMMON = ("design_frequency_hz", "pattern")  # columns whose value is the same in all rows
_COLUMNS = ("antenna", *_COMMON, "gain_db")
_POSITION = re.compile("[xyz]_(m|half_wavelength)")


def read_array(path: str | Path) -> dict[str, Any]:
    """Read an array table and return the fields of `Radar` that the table determines.

    Returns:
        tx_positions_m and rx_positions_m, each a tuple of (x, y, z) in metres; tx_gains_db and rx_gains_db, if an antenna has a gain;
        element, if the table names a pattern.
    Raises:
        MissingError: the file does not exist.
        RecordingError: the table is malformed, or its antennas form no array. The message names the file and the row.
    """
    path = Path(path)
    rows = _rows(path)
    if not rows:
        raise RecordingError(f"{path}: the table has no antenna; write one row for each transmitter and receiver")
    unit, common = _unit(path, rows), {}
    for name in _COMMON:
        values = {row[name] for row in rows if name in row}
        if len(values) > 1:
            listed = " and ".join(sorted(map(reprlib.repr, values)))
            raise RecordingError(f"{path}: {name} has the values {listed}; give one {name} for the whole array")
        if values:
            common[name] = values.pop()
    metres = 1.0
    if unit != "m":
        frequency_hz = _number(str(path), common, "design_frequency_hz", 0.0)
        if not 1e9 <= frequency_hz <= 1e12:
            raise RecordingError(f"{path}: half wavelengths need design_frequency_hz from 1e9 to 1e12 Hz, not {frequency_hz:g}")
        metres = SPEED_OF_LIGHT / frequency_hz / 2
    antennas: dict[Any, list[tuple[tuple[float, ...], float]]] = {"tx": [], "rx": []}
    for number, row in enumerate(rows, start=1):
        place, kind = f"{path}, antenna {number}", row.get("antenna")
        if kind not in antennas:
            raise RecordingError(f"{place}: antenna must be tx or rx, not {reprlib.repr(kind)}")
        position = tuple(metres * _number(place, row, f"{axis}_{unit}", 0.0) for axis in "xyz")
        if abs(gain_db := _number(place, row, "gain_db", 0.0)) > MAX_GAIN_DB:
            raise RecordingError(f"{place}: gain_db must be from -{MAX_GAIN_DB:g} to {MAX_GAIN_DB:g} dB, not {gain_db:g}")
        antennas[kind].append((position, gain_db))
    _check_array(path, antennas)
    fields: dict[str, Any] = {f"{kind}_positions_m": tuple(position for position, _ in antennas[kind]) for kind in antennas}
    if any(gain for of_kind in antennas.values() for _, gain in of_kind):
        fields |= {f"{kind}_gains_db": tuple(gain for _, gain in antennas[kind]) for kind in antennas}
    if "pattern" in common:
        if common["pattern"] not in ELEMENTS:
            raise RecordingError(f"{path}: pattern {reprlib.repr(common['pattern'])} is unknown; use one of {', '.join(ELEMENTS)}")
        fields["element"] = common["pattern"]
    return fields


def _rows(path: Path) -> list[dict[str, str]]:
    """Return the rows of the table without empty cells."""
    if path.suffix != ".csv":
        raise RecordingError(f"{path}: suffix {path.suffix!r} is unknown; give an array table as .csv")
    header, lines = read_csv(path)
    for number, cells in lines:
        if len(cells) != len(header):
            raise RecordingError(f"{path}: line {number} has more or fewer cells than the header line; write one cell for each column")
    return [{name: cell for name, cell in zip(header, cells, strict=True) if cell} for _, cells in lines]


def _unit(path: Path, rows: list[dict[str, str]]) -> str:
    """Return the unit of the positions. Raise RecordingError for an unknown column, an unknown unit, or positions in two units."""
    positions = sorted({name for row in rows for name in row} - set(_COLUMNS))
    if unknown := [name for name in positions if not _POSITION.fullmatch(name)]:
        raise RecordingError(f"{path}: unknown column {unknown[0]!r}; known columns: {', '.join(_COLUMNS)}, x_m, x_half_wavelength")
    if len(units := {name[2:] for name in positions}) != 1:
        raise RecordingError(f"{path}: positions must be in one unit; name the columns x_m, y_m, z_m or x_half_wavelength, ...")
    return units.pop()


def _number(place: str, row: Mapping[str, str], name: str, default: float) -> float:
    value = row.get(name, default)
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise RecordingError(f"{place}: {name} must be a finite number, not {reprlib.repr(value)}")
    return number


def _check_array(path: Path, antennas: Mapping[str, list[tuple[tuple[float, ...], float]]]) -> None:
    """Raise RecordingError unless the antennas form an array of at least two virtual elements and of a plausible size."""
    for kind, name in (("tx", "transmitter"), ("rx", "receiver")):
        if not antennas[kind]:
            raise RecordingError(f"{path}: the table has no {name}; an array needs at least one {name}")
        check_distinct([position for position, _ in antennas[kind]], f"{path}: {kind}", RecordingError)
    if all(len(of_kind) == 1 for of_kind in antennas.values()):
        raise RecordingError(f"{path}: one transmitter and one receiver are no array; give two antennas of at least one kind")
    for axis, name in enumerate("xyz"):
        along = [position[axis] for of_kind in antennas.values() for position, _ in of_kind]
        if max(along) - min(along) > MAX_SPAN_M:
            span = f"the antennas span {max(along) - min(along):g} m along {name}"
            raise RecordingError(f"{path}: {span}; are these half wavelengths? Name the column {name}_half_wavelength")
