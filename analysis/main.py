"""`radartwin tables` and `radartwin report`: run what is missing, then write tables, figures and the report."""

from __future__ import annotations

import json
from pathlib import Path

from analysis import registry, report
from analysis import tables as writers
from radartwin import files, plotting
from radartwin.compose import compose, path_override
from radartwin.errors import InputError, MissingError
from radartwin.experiment import Result
from radartwin.progress import Progress
from radartwin.run import run_experiment, summary
from radartwin.store import Counts

INDEX = "index.json"  # in the tables folder: which run each written table came from
_ENTRY = {"run_key": str, "profile": str, "figures": list}  # what it holds of each


def tables(profile: str, only: list[str] | None, output: Path) -> int:
    """Compute or read back each table, write it in every format with its figures, then the report."""
    progress, counts = Progress(), Counts()
    chosen = registry.select(only)
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
    page = write_report(output)
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
    index = _index(output)
    index[table.name] = {"run_key": result.run_key, "profile": profile, "figures": sorted(result.figures)}
    files.write_atomically(output / "tables" / INDEX, json.dumps(index, indent=1) + "\n")


def write_report(output: Path) -> Path:
    """The report of every table the output folder holds. Raises MissingError if it holds none."""
    index = _index(output)
    written = [table for table in registry.TABLES if table.name in index]
    if not written:
        raise MissingError(f"{output / 'tables'}: there are no tables to report; run radartwin tables first")
    sections = [
        report.Section(
            table=table,
            html=_html(output, table.name),
            figures=[output / "figures" / name for name in index[table.name]["figures"]],
            run_key=index[table.name]["run_key"],
            profile=index[table.name]["profile"],
        )
        for table in written
    ]
    return report.write(sections, output)


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
