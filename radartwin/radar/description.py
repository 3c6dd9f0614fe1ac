"""Radar descriptions from files, by suffix: TI's two formats, and the fields of Radar as .yaml or .json."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from radartwin.errors import InputError, RecordingError
from radartwin.io import untrusted_yaml
from radartwin.radar.boards import BOARDS
from radartwin.radar.chirp import Radar
from radartwin.radar.ti_files import radar_from_cfg, radar_from_studio


def read_radar(path: str | Path, board: str | None = None) -> Radar:
    """Read a radar description by its suffix.

    Args:
        board: antenna layout for TI files, one of boards.BOARDS. None takes the IWR6843ISK below 70 GHz, otherwise the
            xWR1843BOOST, or the xWR1642BOOST where only TX1 and TX2 are enabled.
    Raises:
        RecordingError: malformed, or a mode other than time-division chirps of one profile.
    """
    path = Path(path)
    if board is not None and board not in BOARDS:
        raise InputError(f"board {board!r} is unknown; use one of {', '.join(BOARDS)}")
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path}: it cannot be read as a text file; give a radar file") from error
    try:
        if path.suffix == ".cfg":
            return radar_from_cfg(text, path.stem, board)
        if path.suffix not in (".json", ".yaml", ".yml"):
            raise RecordingError(f"suffix {path.suffix!r} is none of .cfg, .mmwave.json, .yaml and .json")
        values = _parse_mapping(path, text)
        if "mmWaveDevices" in values:
            return radar_from_studio(values, path.stem.removesuffix(".mmwave"), board)
        return Radar.from_dict(values.get("radar", values))
    except InputError as error:
        raise RecordingError(f"{path}: {error}") from error


def _parse_mapping(path: Path, text: str) -> dict[str, Any]:
    import yaml

    try:
        values = json.loads(text) if path.suffix == ".json" else _with_numbers(untrusted_yaml.load(text))
    except json.JSONDecodeError as error:
        raise RecordingError(f"line {error.lineno}: {error.msg}; it is not valid JSON") from error
    except RecursionError as error:
        raise RecordingError("it is nested too deeply; a mapping of radar fields is expected") from error
    except ValueError as error:  # a whole number of thousands of digits
        raise RecordingError(f"it holds a value that cannot be read ({str(error).splitlines()[0]})") from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f"line {mark.line + 1}: " if mark is not None else ""
        raise RecordingError(f"{line}{getattr(error, 'problem', None) or 'malformed YAML'}") from error
    if not isinstance(values, dict) or not isinstance(values.get("radar", values), dict):
        raise RecordingError("a mapping of radar fields is expected")
    return values


def _with_numbers(value: Any) -> Any:
    """YAML 1.1 reads 77e9 as text; take text that spells a number as the number."""
    if isinstance(value, dict):
        return {key: _with_numbers(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_with_numbers(item) for item in value]
    if isinstance(value, str) and re.fullmatch(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+", value):
        return float(value)
    return value
