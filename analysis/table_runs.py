"""Record in the folder `tables` which run each table is from (index.json), which runs ended with an error (failures.json), and one SHA-256
hash of the files of each table and of everything that they depend on (stamps.json).
"""

import functools
import hashlib
import json
import re
from collections.abc import Iterable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import radartwin
from analysis.report.origin import mlflow_pages, read_json
from analysis.tables import FORMATS
from experiments.speed.machine import machine
from radartwin.config.compose import conf_dir
from radartwin.errors import InputError
from radartwin.io import files, secret, untrusted_json
from radartwin.plotting.style import SUFFIXES
from radartwin.runs.checkout import commit

Entries = dict[str, dict[str, Any]]
INDEX, FAILURES, STAMPS, LOCK = "index.json", "failures.json", "stamps.json", "index.lock"
FORMS = {INDEX: {"run_key": str, "profile": str, "figures": list}, FAILURES: {"run_key": str, "profile": str, "error": str}}
ERROR_LENGTH = 500
_FIGURE = re.compile(r"[^./\\\x00-\x1f][^/\\\x00-\x1f]*")  # matches the name of a file in the figures folder, but no path


def lock(output: Path) -> AbstractContextManager[None]:
    """Return the file lock of a process that reads or writes the index, the failures or the report, which other processes may use."""
    return files.lock(output / "tables" / LOCK)


def read(output: Path, name: str) -> Entries:
    """Read a file as {table name: entry}, empty if it is absent. Raises InputError if the file is damaged."""
    path = output / "tables" / name
    if not path.is_file():
        return {}
    try:
        entries = untrusted_json.read(path)
        for entry in entries.values():
            if {key: type(value) for key, value in entry.items()} != FORMS[name]:
                raise ValueError("an entry is not of the expected form")
            if not all(isinstance(figure, str) and _FIGURE.fullmatch(figure) for figure in entry.get("figures", ())):
                raise ValueError("a figure's name is not that of a file")
    except (ValueError, AttributeError, TypeError) as error:
        raise InputError(f"{path} is damaged ({str(error).splitlines()[0]}); delete it and run radartwin tables again") from error
    return entries


def add_table(output: Path, table: str, run_key: str, profile: str, figures: list[str]) -> None:
    """Add a table to the index after its files are written, and remove the table's entry from the failures."""
    with lock(output):
        entries, failures, stamps = read(output, INDEX), read(output, FAILURES), _stamps(output)
        entries[table] = {"run_key": run_key, "profile": profile, "figures": figures}
        stamps[table] = _stamp(output, table, entries[table])
        _write(output, INDEX, entries)
        _write(output, STAMPS, stamps)
        if failures.pop(table, None):
            _write(output, FAILURES, failures)


def add_failure(output: Path, table: str, run_key: str, profile: str, error: Exception) -> None:
    """Add a failed run of a table to the failures. The entry holds type and message of the run's error as one line without secrets."""
    message = " ".join(secret.hidden(f"{type(error).__name__}: {error}").split())[:ERROR_LENGTH]
    with lock(output):
        _write(output, FAILURES, read(output, FAILURES) | {table: {"run_key": run_key, "profile": profile, "error": message}})


def add_report(output: Path) -> None:
    """Store the hash (stamp) of a report that has just been written. The caller must hold the lock of the folder."""
    _write(output, STAMPS, _stamps(output) | {"report": _report_stamp(output)})


def unchanged(output: Path, table: str, profile: str) -> bool:
    """Return whether code, configuration, machine, table files and MLflow run are the same as when the table was written."""
    entry = read(output, INDEX).get(table)
    if entry is None or entry["profile"] != profile or table in read(output, FAILURES) or entry["run_key"] not in mlflow_pages(output)[0]:
        return False
    return _stamps(output).get(table, "") == _stamp(output, table, entry) != ""


def report_unchanged(output: Path) -> bool:
    """Return whether the report is up to date: code, machine, tables, MLflow runs and report files are as when the report was written."""
    return _stamps(output).get("report", "") == _report_stamp(output)


def _stamps(output: Path) -> dict[str, str]:
    """Read {table name: stamp}. An absent or damaged file gives {}, so that all tables are written again."""
    return read_json(output / "tables" / STAMPS)


def _stamp(output: Path, table: str, entry: dict[str, Any]) -> str:
    """Return one SHA-256 of the code, configuration, machine, the table's index entry and the table's files; "" if a file is missing."""
    paths = [output / "tables" / f"{table}.{suffix}" for suffix in FORMATS]
    paths += [output / "figures" / f"{figure}{suffix}" for figure in entry["figures"] for suffix in SUFFIXES]
    paths += (output / "figures").glob(f"{table}_page.html")
    return _digest(entry, paths) if all(path.is_file() for path in paths) else ""


def _report_stamp(output: Path) -> str:
    content = [read(output, INDEX), read(output, FAILURES), mlflow_pages(output), commit()]
    return _digest(content, sorted(path for path in (output / "report").rglob("*") if path.is_file()))


def _digest(content: Any, paths: Iterable[Path]) -> str:
    """Return one SHA-256 of the code, the configuration, the machine, `content`, and the names and contents of the files `paths`."""
    digests = [(path.name, hashlib.sha256(path.read_bytes()).hexdigest()) for path in paths]
    return hashlib.sha256(json.dumps([sources(), machine(), content, digests], sort_keys=True).encode()).hexdigest()


@functools.cache
def sources() -> str:
    """Return the SHA-256 of the source code and configuration files that decide the content of tables and report."""
    study = Path(__file__).resolve().parents[1]
    total = hashlib.sha256()
    for folder in (conf_dir(), Path(radartwin.__file__).parent, study / "experiments", study / "analysis"):
        for path in sorted(folder.rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                total.update(f"{path.relative_to(folder)} {hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
    return total.hexdigest()


def _write(output: Path, name: str, content: dict[str, Any]) -> None:
    files.write_atomically(output / "tables" / name, json.dumps(content, indent=1) + "\n")
