"""`radartwin tables` and `radartwin report`: run what is missing, then write tables, figures and the report."""

from __future__ import annotations

import json
import re
import traceback
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

from analysis import registry, report
from analysis import tables as writers
from radartwin.config.compose import compose, path_override
from radartwin.errors import ConfigError, InputError, MissingError, UserError
from radartwin.io import files, memory, secret, untrusted_json
from radartwin.io.progress import Progress
from radartwin.plotting import style
from radartwin.runs import workers
from radartwin.runs.experiment import Result, Table, declared
from radartwin.runs.run import run_experiment, run_key, summary
from radartwin.store.products import Counts

INDEX = "index.json"  # in the tables folder: which run each written table came from
FAILURES = "failures.json"  # beside it: which run of a table ended with an error, until one succeeds
LOCK = "index.lock"
_ENTRY = {"run_key": str, "profile": str, "figures": list}  # what the index holds of each
_FAILURE = {"run_key": str, "profile": str, "error": str}
_NAME = re.compile(r"[^./\\\x00-\x1f][^/\\\x00-\x1f]*")  # of a figure: a file in the figures folder, never a path


def tables(profile: str, only: list[str] | None, output: Path) -> int:
    """Compute or read back each table, write it in every format with its figures, then the report.

    A run that ends with an error costs its own table: the others are made, the report names it, and the exit status is 1. What the user
    can mend stops the work, as it would stop every table.
    """
    progress, counts = Progress(), Counts()
    registry.check(only or [])
    for name, form in ((INDEX, _ENTRY), (FAILURES, _FAILURE)):  # an unreadable one stops before the work, not after it
        _listed(output, name, form)
    for part in ("tables", "figures", "report"):
        files.sweep(files.make_folder(output / part))
    files.drop_stale(output / "tables" / LOCK)
    made, failed = [], []
    with workers.kept():
        for name in only or registry.NAMES:
            overrides = [f"experiment={name}", f"profile={profile}", path_override("output", output)]
            config = compose(overrides)
            table = declared(config.experiment)
            if not only and profile in table.on_request:
                continue
            progress.say(f"--- {name} ({profile})")
            try:
                result, counted = run_experiment(config, overrides, progress)
            except (UserError, OSError):
                raise
            except Exception as error:
                traceback.print_exc()
                _fail(table.name, run_key(config), profile, error, output)
                failed.append(table.name)
                continue
            counts += counted
            write(table, result, profile, output)
            made.append(table.name)
            print(summary(result))
            del result
            memory.give_back()
    page = write_report(output, fresh=made)
    totals = f"simulated {counts.simulated}, reused {counts.reused}, scored {counts.scored}"
    print(f"tables: {len(made)} written, {totals}; report: {page}")
    return 1 if failed else 0


def report_verb(output: Path) -> int:
    """The report again, from the tables already written."""
    print(write_report(output))
    return 0


def write(table: Table, result: Result, profile: str, output: Path) -> None:
    """One table with its figures, and its line in the index."""
    writers.write(table, result.rows, output / "tables")
    for name, figure in result.figures.items():
        style.save(figure, output / "figures" / name)
    if table.chart:
        files.write_atomically(output / "figures" / f"{table.name}_page.html", table.chart(result.rows))
    with _alone(output):
        index = _listed(output, INDEX, _ENTRY)
        index[table.name] = {"run_key": result.run_key, "profile": profile, "figures": sorted(result.figures)}
        _list(output, INDEX, index)
        failures = _listed(output, FAILURES, _FAILURE)
        if failures.pop(table.name, None):
            _list(output, FAILURES, failures)


def _fail(name: str, key: str, profile: str, error: Exception, output: Path) -> None:
    """A line of FAILURES: the error in one line, with its kind."""
    told = " ".join(secret.hidden(f"{type(error).__name__}: {error}").split())[:500]
    with _alone(output):
        failures = _listed(output, FAILURES, _FAILURE) | {name: {"run_key": key, "profile": profile, "error": told}}
        _list(output, FAILURES, failures)


def write_report(output: Path, fresh: Sequence[str] = (), current: Callable[[str, str, Path], str] | None = None) -> Path:
    """The report of every table: what the output folder holds, and a line for what it does not, or not any more.

    A table whose run failed, or is of an earlier source or configuration, is named with the command that makes it; old figures stay out.

    Args:
        fresh: tables that were just written. current: (name, profile, output) -> the key its run has now.
    Raises:
        MissingError: the folder holds no table at all.
    """
    known = (_listed(output, INDEX, _ENTRY), _listed(output, FAILURES, _FAILURE))
    if not any(name in entries for name in registry.NAMES for entries in known):
        raise MissingError(f"{output / 'tables'}: there are no tables to report; run radartwin tables first")
    with _alone(output):
        return _write_report(output, fresh, current or _current)


def _write_report(output: Path, fresh: Sequence[str], current: Callable[[str, str, Path], str]) -> Path:
    index, failures = _listed(output, INDEX, _ENTRY), _listed(output, FAILURES, _FAILURE)

    def now(name: str, entry: dict) -> bool:
        return name in fresh or entry["run_key"] == current(name, entry["profile"], output)

    sections = []
    for name in registry.NAMES:
        table, entry, failure = registry.table(name), index.get(name), failures.get(name)
        if entry and now(name, entry):
            section = report.Section(table, output, entry["profile"], entry["run_key"], entry["figures"])
        elif failure and now(name, failure):
            section = report.Section(table, output, failure["profile"], absent=report.FAILED, error=failure["error"])
        else:
            known = entry or failure
            profile, state = (known["profile"], report.STALE) if known else ("quick", report.MISSING)
            section = report.Section(table, output, profile, absent=state)
        sections.append(section)
    for state in (report.MISSING, report.STALE, report.FAILED):
        if names := [section.table.name for section in sections if section.absent == state]:
            print(f"{state}: {', '.join(names)}")
    return report.write(sections, output)


def _current(name: str, profile: str, output: Path) -> str:
    try:
        return run_key(compose([f"experiment={name}", f"profile={profile}", path_override("output", output)]))
    except ConfigError:  # a profile or option that is no more
        return ""


def _alone(output: Path) -> AbstractContextManager[None]:
    """While index, failures or report are read and written again: another `radartwin tables` may run on this output."""
    return files.lock(output / "tables" / LOCK)


def _list(output: Path, name: str, entries: dict[str, dict]) -> None:
    files.write_atomically(output / "tables" / name, json.dumps(entries, indent=1) + "\n")


def _listed(output: Path, name: str, form: dict[str, type]) -> dict[str, dict]:
    """What INDEX or FAILURES holds, by table."""
    path = output / "tables" / name
    if not path.is_file():
        return {}
    try:
        entries = untrusted_json.read(path)
        if not all({key: type(value) for key, value in entry.items()} == form for entry in entries.values()):
            raise ValueError("an entry is not of the expected form")
        if not all(isinstance(one, str) and _NAME.fullmatch(one) for entry in entries.values() for one in entry.get("figures", ())):
            raise ValueError("a figure's name is not that of a file")
    except (ValueError, AttributeError, TypeError) as error:
        raise InputError(f"{path} is damaged ({str(error).splitlines()[0]}); delete it and run radartwin tables again") from error
    return entries
