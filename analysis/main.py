"""The commands `radartwin tables` and `radartwin report`: run missing experiments, then write their tables, figures and the report."""

import importlib.util
import traceback
from collections import Counter
from collections.abc import Callable, Sequence
from operator import itemgetter
from pathlib import Path

from analysis import registry, report, table_runs
from analysis import tables as writers
from radartwin.config.compose import compose, path_override
from radartwin.config.config import Config
from radartwin.errors import ConfigError, MissingError, UserError
from radartwin.io import files, memory
from radartwin.io.progress import Progress
from radartwin.plotting import style
from radartwin.runs.experiment import Result, Table, declared
from radartwin.store import products
from radartwin.store.products import RUN, Counts

STUDY_PACKAGES = ("miepython", "plotly")  # packages of the extra `study` in pyproject.toml


def tables(profile: str, only: list[str] | None, output: Path) -> int:
    """Write each table in every format with its figures, unless nothing that it depends on has changed, then write the report.

    If an experiment ends with an error, the report names it, and the exit status is 1. A user error stops the command, because the same
    error would affect every table. Returns the exit status of the command.
    """
    registry.check(only or [])
    if absent := [name for name in STUDY_PACKAGES if importlib.util.find_spec(name) is None]:
        raise MissingError(f"radartwin tables needs {' and '.join(absent)}; run pip install -c constraints.txt -e '.[study]'")
    for name in table_runs.FORMS:  # a damaged file of the index stops the command here, before the first run
        table_runs.read(output, name)
    for part in ("tables", "figures", "report"):
        files.sweep(files.make_folder(output / part))
    files.drop_stale(output / "tables" / table_runs.LOCK)
    names = only or registry.of_profile(profile)
    kept = [name for name in names if table_runs.unchanged(output, name, profile)]
    made, counts = _run([name for name in names if name not in kept], profile, output)
    counts.stored |= {(RUN, name) for name in kept}
    unchanged = len(kept) == len(names) and table_runs.report_unchanged(output)
    page = report.path(output) if unchanged else write_report(output, fresh=kept + made)
    print(f"tables: {len(kept + made)} written, {counts}; report: {page}")
    return 0 if len(kept + made) == len(names) else 1


def _run(names: Sequence[str], profile: str, output: Path) -> tuple[list[str], Counts]:
    """Run the experiments and write their tables, those that measure run times last and alone. Returns the written tables, and counts."""
    made: list[str] = []
    progress = Progress()
    with products.counting() as counts:
        if not names:
            return made, counts
        from experiments import shared_simulations  # imports the numerical packages
        from radartwin.runs import workers

        overrides = {name: [f"experiment={name}", f"profile={profile}", path_override("output", output)] for name in names}
        configs = {name: compose(overrides[name]) for name in names}
        timed = [name for name, config in configs.items() if declared(config.experiment).timed]
        untimed = [name for name in names if name not in timed]

        def done(made_by: tuple[str, str | None]) -> None:
            name, summary = made_by
            if summary is not None:
                made.append(name)
                print(summary)

        with workers.reused():
            try:
                shared_simulations.simulate(list(configs.values()), progress)
            except (UserError, OSError):
                raise
            except Exception:  # each table that needs the failed simulation repeats it and fails
                traceback.print_exc()
            if (count := workers.worker_count(configs[names[0]].jobs, len(untimed))) > 1:
                left = iter(untimed)

                def next_call(_: int) -> tuple[Config, list[str], Path] | None:
                    return (configs[name], overrides[name], output) if (name := next(left, None)) else None

                workers.run(_made, next_call, done, count)
                untimed = []
            for name in (*untimed, *timed):
                progress.say(f"--- {name} ({profile})")
                done(_made(configs[name], overrides[name], output, progress))
    return made, counts


def _made(config: Config, overrides: Sequence[str], output: Path, progress: Progress | None = None) -> tuple[str, str | None]:
    """Run an experiment and write its table. Returns the name and a summary of the table, or the name and None after an error."""
    from radartwin.runs.run import run_experiment, run_key, summary

    table, profile = declared(config.experiment), config.profile.name
    try:
        result, counts = run_experiment(config, overrides, progress or Progress(quiet=True))
    except (UserError, OSError):
        raise
    except Exception as error:
        traceback.print_exc()
        table_runs.add_failure(output, table.name, run_key(config), profile, error)
        return table.name, None
    write(table, result, profile, output)
    said = summary(result)
    if counts.scored:
        del result
        memory.give_back()
    return table.name, said


def report_verb(output: Path) -> int:
    """Write the report again from the tables in the output folder, without running experiments. Returns the exit status."""
    print(write_report(output))
    return 0


def write(table: Table, result: Result, profile: str, output: Path) -> None:
    """Write one table and its figures to the output folder, and add the table to the index."""
    writers.write(table, result.rows, output / "tables")
    for name, figure in result.figures.items():
        style.save(figure, output / "figures" / name)
    if table.chart:
        files.write_atomically(output / "figures" / f"{table.name}_page.html", table.chart(result.rows))
    table_runs.add_table(output, table.name, result.run_key, profile, sorted(result.figures))


def write_report(output: Path, fresh: Sequence[str] = (), current: Callable[[str, str, Path], str] | None = None) -> Path:
    """Write the report of all tables in the output folder, and return its path. Raises MissingError if the folder has no table.

    A table that is missing, failed or out of date (`current`, a function of its name, profile and the folder, returns another run key) has
    the command that makes it instead of its figures. The tables `fresh` are up to date.
    """
    if not any(name in table_runs.read(output, part) for part in table_runs.FORMS for name in registry.NAMES):
        raise MissingError(f"{output / 'tables'}: there are no tables to report; run radartwin tables first")
    with table_runs.lock(output):
        entries, failures = table_runs.read(output, table_runs.INDEX), table_runs.read(output, table_runs.FAILURES)

        def is_current(name: str, entry: dict) -> bool:
            return name in fresh or entry["run_key"] == (current or _current)(name, entry["profile"], output)

        usual_profile = max(Counter(entry["profile"] for entry in entries.values()).items(), key=itemgetter(1), default=("quick", 0))[0]
        usual = registry.of_profile(usual_profile)
        sections = []
        for name in registry.NAMES:
            table, entry, failure = registry.table(name), entries.get(name), failures.get(name)
            if entry and is_current(name, entry):
                section = report.Section(table, output, entry["profile"], entry["run_key"], entry["figures"])
            elif failure and is_current(name, failure):
                section = report.Section(table, output, failure["profile"], absent=report.FAILED, error=failure["error"])
            else:
                known = entry or failure
                state = report.STALE if known else report.MISSING if name in usual else report.LEFT_OUT
                section = report.Section(table, output, known["profile"] if known else usual_profile, absent=state)
            sections.append(section)
        for state in (report.MISSING, report.STALE, report.FAILED):
            if names := [section.table.name for section in sections if section.absent == state]:
                print(f"{state}: {', '.join(names)}")
        page = report.write(sections, output)
        table_runs.add_report(output)
        return page


def _current(name: str, profile: str, output: Path) -> str:
    from radartwin.runs.run import run_key

    try:
        return run_key(compose([f"experiment={name}", f"profile={profile}", path_override("output", output)]))
    except ConfigError:  # the profile or an option does not exist any more
        return ""
