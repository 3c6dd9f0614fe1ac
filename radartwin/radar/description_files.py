"""Read the text files that describe radars, recordings and recording sets, and return their content as plain Python values.

A radar file is a mmWave SDK .cfg, a mmWave Studio .mmwave.json, or a .yaml or .json with the fields of `radartwin.radar.chirp.Radar`.
"""

from __future__ import annotations

import csv
import io
import json
import re
from pathlib import Path
from typing import Any

from radartwin.errors import MissingError, RecordingError
from radartwin.io import untrusted_json, untrusted_yaml
from radartwin.io.git_lfs import refuse_pointer
from radartwin.radar.ti_files import Description, describe, parse_cfg, parse_studio
from radartwin.radar.word_order import Layout


def read_description(path: Path, board: str | None = None) -> Description:
    """Read a radar file. The suffix of the file name determines the format.

    Args:
        path: path of the radar file.
        board: name of the board, for a .cfg or a .mmwave.json; None takes the board from the file (radartwin.radar.ti_files).
    Raises:
        RecordingError: the file is malformed or unsupported, or its radar does not send equal chirps with one transmitter at a time (time
            division).
    """
    match path.suffix.lower():
        case ".cfg":
            source: str | dict[str, Any] = read_text(path, comment="%")
        case ".json":
            source = read_json(path)
        case ".yaml" | ".yml":
            source = with_numbers(read_yaml(path, "radar fields"))
        case suffix:
            raise RecordingError(f"{path}: suffix {suffix!r} is unknown; give a .cfg, .mmwave.json, .yaml or .json")
    try:
        if isinstance(source, str):
            return describe(path.stem, parse_cfg(source), board)
        if "mmWaveDevices" in source:
            return describe(path.stem.removesuffix(".mmwave"), parse_studio(source), board)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error
    if "configUsed" in source and "capturedFiles" in source:
        config = re.split(r"[/\\]", str(source["configUsed"]))[-1]
        raise RecordingError(f"{path}: it is the setup file of a capture and names no waveform; give {config}, which it names, as radar")
    if board is not None:
        raise RecordingError(f"{path}: it gives the antenna positions, so that board {board} cannot apply; leave out --board")
    fields = source.get("radar", source)
    real = isinstance(fields, dict) and fields.get("real_sampling") is True
    return Description(fields, Layout(real=real))


def present(path: Path, remedy: str = "check the path") -> Path:
    """Return the path of a file. Raise MissingError with a remedy if it is absent, and RecordingError if it is a Git LFS pointer."""
    if not path.is_file():
        raise MissingError(f"{path}: no such file; {remedy}")
    refuse_pointer(path)
    return path


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON file that holds an object. Raise RecordingError, with the line of a syntax error, if the file is malformed."""
    present(path)
    try:
        values = untrusted_json.read(path)
    except json.JSONDecodeError as error:
        raise RecordingError(f"{path}: line {error.lineno}: {error.msg}; write valid JSON") from error
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: not a text file; give a JSON file") from error
    except (ValueError, RecursionError) as error:  # a number of thousands of digits, or thousands of brackets
        raise RecordingError(f"{path}: unreadable value ({error})") from error
    if not isinstance(values, dict):
        raise RecordingError(f"{path}: expected a JSON object, not {type(values).__name__}; write one object in braces")
    return values


def read_yaml(path: Path, content: str) -> dict[str, Any]:
    """Read a YAML file that holds a mapping. Raise RecordingError, with the line of a syntax error, if the file is malformed.

    Error messages describe the mapping by `content`, for example "radar fields".
    """
    import yaml

    text = read_text(path)
    try:
        values = untrusted_yaml.load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        line = f"line {mark.line + 1}: " if (mark := getattr(error, "problem_mark", None)) else ""
        raise RecordingError(f"{path}: {line}{getattr(error, 'problem', None) or str(error).splitlines()[0]}; write valid YAML") from error
    if not isinstance(values, dict):
        raise RecordingError(f"{path}: expected a mapping of {content}, not {type(values).__name__}; write KEY: VALUE lines")
    return values


def read_csv(path: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Read a CSV file whose first line names the columns. Return these names, and number and cells of each further line that is not blank.

    Raises:
        RecordingError: the file is not CSV in UTF-8, or a column occurs twice.
    """
    reader = csv.reader(io.StringIO(read_text(path), newline=""), strict=True)
    try:
        lines = [(reader.line_num, [cell.strip() for cell in cells]) for cells in reader if any(cell.strip() for cell in cells)]
    except csv.Error as error:
        raise RecordingError(f"{path}: line {reader.line_num}: {error}; write valid CSV") from error
    header = lines[0][1] if lines else []
    if twice := [name for name in header if header.count(name) > 1]:
        raise RecordingError(f"{path}: line {lines[0][0]}: column {twice[0] or 'without a name'} occurs twice; name each once")
    return header, lines[1:]


def read_text(path: Path, comment: str | None = None) -> str:
    """Read a UTF-8 text file. Raise RecordingError if the file is not readable text.

    Text after the sign `comment` in a line may have any encoding.
    """
    present(path)
    try:
        text = path.read_text(encoding="utf-8-sig", errors="strict" if comment is None else "replace")
        for number, line in enumerate(text.splitlines() if comment is not None else (), start=1):
            if "\ufffd" in line.split(comment, 1)[0]:
                raise RecordingError(f"{path}: line {number}: not readable text; write the commands as ASCII")
        return text
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path}: not a readable text file ({type(error).__name__}); write it as UTF-8") from error


def with_numbers(value: Any) -> Any:
    """Convert text such as 77e9 to a number, because YAML 1.1 reads an exponent without a sign as text."""
    if isinstance(value, dict):
        return {key: with_numbers(item) for key, item in value.items()}
    if isinstance(value, list):
        return [with_numbers(item) for item in value]
    if isinstance(value, str) and re.fullmatch(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+", value):
        return float(value)
    return value
