"""`radartwin tables` and `radartwin report`: run what is missing, then write tables, figures and the report."""

from __future__ import annotations

import importlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path

from analysis import registry, report
from analysis import tables as writers
from radartwin import files, plotting
from radartwin.compose import compose, path_override
from radartwin.errors import ConfigError, InputError, MissingError
from radartwin.experiment import Result
from radartwin.progress import Progress
from radartwin.run import run_experiment, run_key, summary
from radartwin.store import Counts

INDEX = "index.json"  # in the tables folder: which run each written table came from
_ENTRY = {"run_key": str, "profile": str, "figures": list}  # what it holds of each


def tables(profile: str, only: list[str] | None, output: Path) -> int:
    """Compute or read back each table, write it in every format with its figures, then the report."""
    progress, counts = Progress(), Counts()
    chosen = registry.select(only, profile)
    _index(output)  # an unreadable one stops before the work, not after it
    for part in ("tables", "figures", "report"):
        files.sweep(files.make_folder(output / part))
    for table in chosen:
        progress.say(f"--- {table.name} ({profile})")
        overrides = [f"experiment={table.name}", f"profile={profile}", path_override("output", output)]
        result, counted = run_experiment(compose(overrides), overrides, progress)
        counts += counted
        write(table, result, profile, output)
        print(summary(result))
    page = write_report(output, fresh=[table.name for table in chosen])
    totals = f"simulated {counts.simulated}, reused {counts.reused}, scored {counts.scored}"
    print(f"tables: {len(chosen)} written, {totals}; report: {page}")
    return 0


def report_verb(output: Path) -> int:
    """The report again, from the tables already written."""
    print(write_report(output))
    return 0


def write(table: registry.Table, result: Result, profile: str, output: Path) -> None:
    """One table with its figures, and its line in the index."""
    writers.write(table, result.rows, output / "tables")
    for name, figure in result.figures.items():
        plotting.save(figure, output / "figures" / name)
    if table.page:
        files.write_atomically(output / "figures" / f"{table.name}_page.html", importlib.import_module(table.page).page(result.rows))
    index = _index(output)
    index[table.name] = {"run_key": result.run_key, "profile": profile, "figures": sorted(result.figures)}
    files.write_atomically(output / "tables" / INDEX, json.dumps(index, indent=1) + "\n")


def write_report(output: Path, fresh: Sequence[str] = (), current: Callable[[str, str, Path], str] | None = None) -> Path:
    """The report of every table: what the output folder holds, and a line for what it does not, or not any more.

    A table whose run is of an earlier source or configuration is named with the command that renews it, and its old figures stay out.

    Args:
        fresh: tables that were just written. current: (name, profile, output) -> the key its run has now.
    Raises:
        MissingError: the folder holds no table at all.
    """
    index = _index(output)
    if not any(table.name in index for table in registry.TABLES):
        raise MissingError(f"{output / 'tables'}: there are no tables to report; run radartwin tables first")
    sections, states = [], {report.MISSING: [], report.STALE: []}
    for table in registry.TABLES:
        entry = index.get(table.name)
        if entry is None:
            state = report.MISSING
        elif table.name in fresh or entry["run_key"] == (current or _current)(table.name, entry["profile"], output):
            figures = [output / "figures" / name for name in entry["figures"]]
            sections.append(report.Section(table, _html(output, table.name), figures, entry["run_key"], entry["profile"]))
            continue
        else:
            state = report.STALE
        states[state].append(table.name)
        sections.append(report.Section(table, "", [], "", entry["profile"] if entry else "quick", state))
    for state, names in states.items():
        if names:
            print(f"{state}: {', '.join(names)}")
    return report.write(sections, output)


def _current(name: str, profile: str, output: Path) -> str:
    try:
        return run_key(compose([f"experiment={name}", f"profile={profile}", path_override("output", output)]))
    except ConfigError:  # a profile or option that is no more
        return ""


def _index(output: Path) -> dict[str, dict]:
    path = output / "tables" / INDEX
    if not path.is_file():
        return {}
    try:
        index = json.loads(path.read_text(encoding="utf-8"))
        if not all({key: type(value) for key, value in entry.items()} == _ENTRY for entry in index.values()):
            raise ValueError("an entry is not of the expected form")
    except (ValueError, AttributeError, RecursionError) as error:
        raise InputError(f"{path} is damaged ({str(error).splitlines()[0]}); delete it and run radartwin tables again") from error
    return index


def _html(output: Path, name: str) -> str:
    path = output / "tables" / f"{name}.html"
    try:
        return path.read_text(encoding="utf-8")
    except (FileNotFoundError, UnicodeDecodeError) as error:
        raise MissingError(f"{path} is missing or damaged; run radartwin tables --only {name} again") from error
