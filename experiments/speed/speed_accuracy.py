"""Speed against accuracy: run time and error of each simulation method on each test problem.

A method is on the Pareto front of a test problem if no other method is at least as fast and as accurate, and better in one of the two. The
claim about the default method holds if no other method is both faster and more accurate by more than the factor NEAR. Run times depend on
the machine and its load, so the timed methods alternate, and the table gives ratios of run times within one run. The last test problem,
the campaign's turntable recordings (`campaign_methods`), compares run time with feature error and recognition error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments import claims
from experiments.campaign.schedule import RecordingTask
from experiments.speed import campaign_methods, chart, chart_page, measuring
from experiments.speed.machine import machine
from experiments.speed.methods import DEFAULT, OURS, RFGENESIS, of_problem
from experiments.speed.pareto import front, shortfall
from experiments.speed.problems import Problem, problems
from radartwin.config.config import Config
from radartwin.io.progress import Progress
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store, save_json

TABLE = Table(
    name="speed_accuracy",
    title="Speed against accuracy",
    caption="Every simulation method that runs on this machine, on five problems. Columns: processor time and wall time per frame, "
    "memory above idle, rays per frame, and the errors of the signal and of the range profile within 40 dB of its peak. Processor "
    "time counts all threads, without kernel compilation. If the radar is at rest, the set-up time is divided among the frames of "
    "the recording. The methods take turns for n rounds. A value is a method's time divided by the default's time: the median "
    "and the range over the rounds. Methods that know the exact answer of one problem are listed but are not on the Pareto front. "
    "For RF-Genesis as published, one of the 128 sums per frame is timed and its time multiplied by 128. On a sixth problem, "
    "the campaign, each method simulates the twin's turntable recordings of all objects, and n counts recordings. The feature error "
    "is in standard deviations of the measured features. The recognition error is the share of measured revolutions whose symmetry "
    "class a linear classifier, trained on the simulation, gets wrong. All times belong to the machine in the row.",
    chart=chart_page.page,
    timed=True,
)

NEAR = 1.1
FASTER = 500.0
ERRORS = {"signal_error": "error of the signal", "profile_error_db": "error of the range profile"}
PUBLISHED = "as published"
MEASURED = (  # columns that are empty in the rows of the campaign
    "wall_s_frame", "setup_s", "frames timed", "memory_mib", "rays", "signal_error", "profile_error_db", "offset_db", "free_error_db",
)  # fmt: skip
UNSCORED = dict.fromkeys(("feature_error", "recognition_error", "front of features", "front of recognition"))  # for the campaign only
SOURCES = ("experiments.speed.measuring", "experiments.speed.problems", "experiments.speed.methods")
# `rounds`, `budget_s` and `slow_s` of `measuring.measure`
QUICK, PAPER = (2, 0.2, 1.0), (2, 2.0, 8.0)


def identity() -> dict[str, Any]:
    """Return additions to the run key: the description of the machine, because run times depend on the machine."""
    return {"machine": machine()}


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Measure the test problems whose results for this machine are not stored yet, and mark the methods on the Pareto fronts."""
    full = config.profile.name != "quick"
    measured, keys = [], []
    for problem in progress.over(problems(full), "problems"):
        spec = {"problem": problem.name, "full": full, **identity()}
        product = store.fetch("timing", spec, SOURCES, partial(_measure, problem, full, progress))
        measured += product.read_json("rows")
        keys.append(product.key)
    on_campaign = campaign_methods.measure(config, store, progress, full)
    keys += [key for one in on_campaign for key in one["keys"]]
    rows = table(measured, machine(), {problem.name: problem for problem in problems(full)})
    rows += campaign_rows(on_campaign, machine(), config.measured.provider)
    metrics = {
        f"{row['problem']} {row['metric']}".replace(",", ""): float(row["value"])
        for row in rows
        if row["claim"] and row["value"] is not None
    }
    figures = {
        "speed_accuracy": lambda: chart.chart(rows, "profile_error_db"),
        "speed_accuracy_signal": lambda: chart.chart(rows, "signal_error"),
        "speed_accuracy_campaign": lambda: chart.campaign(rows),
    }
    return Result(TABLE.name, rows, figures, metrics, keys)


def recordings(config: Config, store: Store, progress: Progress) -> dict[str, RecordingTask]:
    return campaign_methods.recordings(config, store, progress, config.profile.name != "quick")


def _measure(problem: Problem, full: bool, progress: Progress, folder: Path) -> None:
    rounds, budget_s, slow_s = PAPER if full else QUICK
    save_json(folder, "rows", measuring.measure(problem, of_problem(problem, full), rounds, budget_s, slow_s, progress.say))


def table(measured: Sequence[Mapping[str, Any]], machine: Mapping[str, str], known: Mapping[str, Problem]) -> list[dict[str, Any]]:
    """Return the rows of the table: each method's run time relative to the default on each test problem, then the claims."""
    rows: list[dict[str, Any]] = []
    for name in dict.fromkeys(one["problem"] for one in measured):
        mine = [one for one in measured if one["problem"] == name]
        default = next(one for one in mine if (one["family"], one["setting"]) == (OURS, DEFAULT))
        fronts = {error: _on_front(mine, error) for error in ERRORS}
        for number, one in enumerate(mine):
            ratios = ratios_of(one["seconds"], default["seconds"])
            rows.append({
                **_case(one, machine, known[name]), "exact": one["exact"],
                "front": fronts["profile_error_db"][number], "front of the signal": fronts["signal_error"][number], **UNSCORED,
                "claim": "", "run_keys": "", "metric": "seconds a frame over those of the default", "paper": None, "value": ratios[1],
                "low": ratios[0], "high": ratios[2], "n": len(one["seconds"]), "domain": known[name].truth, "verdict": "",
            })  # fmt: skip
        rows += _claims(mine, default, machine, known[name])
    return rows


def _case(one: Mapping[str, Any], machine: Mapping[str, str], problem: Problem) -> dict[str, Any]:
    kept = {name: value for name, value in one.items() if name not in ("seconds", "exact")}
    seconds = {"least_s_frame": min(one["seconds"]), "most_s_frame": max(one["seconds"])}
    return kept | seconds | {"title": problem.title, "machine": "; ".join(machine.values())}


def campaign_rows(methods: Sequence[Mapping[str, Any]], machine: Mapping[str, str], domain: str) -> list[dict[str, Any]]:
    """Return rows for the campaign's recordings: each method's relative run time and two errors, then the claims about faster methods."""
    default = methods[0]
    rows: list[dict[str, Any]] = []

    def add(
        one: Mapping[str, Any], metric: str, value: tuple[float, float, float], n: int, claim: str = "", holds: bool | None = None
    ) -> None:
        rows.append({
            **dict.fromkeys(MEASURED), **{name: one[name] for name in ("problem", "family", "setting", "seconds_frame", "exact")},
            "least_s_frame": min(one["seconds"]), "most_s_frame": max(one["seconds"]), "title": campaign_methods.TITLE,
            "machine": "; ".join(machine.values()), "front": None, "front of the signal": None,
            "feature_error": one["feature_error"], "recognition_error": one["recognition_error"],
            "front of features": one in by_features,
            "front of recognition": one in by_recognition, "claim": claim, "run_keys": claims.told(one["keys"]), "metric": metric,
            "paper": None, "value": value[1], "low": value[0], "high": value[2], "n": n, "domain": domain,
            "verdict": claims.limit_kept(holds),
        })  # fmt: skip

    scores = {"features": lambda one: one["feature_error"], "recognition": lambda one: one["recognition_error"]}
    places = {name: [(one["seconds_frame"], score(one)) for one in methods] for name, score in scores.items()}
    by_features, by_recognition = ([one for one, on in zip(methods, front(places[name]), strict=True) if on] for name in scores)
    for one in methods:
        ratios = ratios_of(one["seconds"], default["seconds"])
        add(one, "seconds a frame over those of the default", ratios, len(one["seconds"]))
    for name, score in scores.items():
        worse = {
            "features": default["spread of feature_error"],
            "recognition": _share_error(default["recognition_error"], default["answers"]),
        }
        as_good = [one for one in methods if score(one) <= score(default) + worse[name]]  # within one standard error
        far = default["seconds_frame"] / min(one["seconds_frame"] for one in as_good)
        claim = f"no other that is as good in {name}, within a standard error, is more than {100 * (NEAR - 1):.0f} % faster"
        add(default, f"times the cheapest that is as good in {name}", (far, far, far), len(methods), claim, far <= NEAR)
    return rows


def _share_error(share: float, answers: int) -> float:
    """Return the standard error of a share of wrong predictions among `answers` predictions.

    Laplace's rule of succession keeps the standard error above zero if all or none of the predictions are wrong.
    """
    fair = (share * answers + 1) / (answers + 2)
    return float(np.sqrt(fair * (1 - fair) / answers))


def ratios_of(seconds: Sequence[float], default_s: Sequence[float]) -> tuple[float, float, float]:
    """Return the (smallest, median, largest) ratio of two methods' seconds in the same round, over the last rounds of both methods."""
    n = min(len(seconds), len(default_s))
    ratio = np.array(seconds[-n:]) / np.array(default_s[-n:])
    return float(ratio.min()), float(np.median(ratio)), float(ratio.max())


def _on_front(mine: Sequence[Mapping[str, Any]], error: str) -> list[bool]:
    marks = iter(front([(one["seconds_frame"], one[error]) for one in mine if not one["exact"]]))
    return [not one["exact"] and next(marks) for one in mine]


def _claims(
    mine: Sequence[Mapping[str, Any]], default: Mapping[str, Any], machine: Mapping[str, str], problem: Problem
) -> list[dict[str, Any]]:
    """Return the rows of two claims about a test problem.

    The first claim is that the default method is on the Pareto fronts of signal error and profile error. The second claim is that it is
    faster than RF-Genesis as published.
    """
    rows = []

    def add(one: Mapping[str, Any], metric: str, claim: str, value: tuple[float, float, float], n: int, holds: bool) -> None:
        rows.append({
            **_case(one, machine, problem), "exact": False, "front": None, "front of the signal": None, **UNSCORED,
            "claim": claim, "run_keys": "", "metric": metric, "paper": None, "value": value[1], "low": value[0], "high": value[2], "n": n,
            "domain": problem.truth, "verdict": claims.limit_kept(holds),
        })  # fmt: skip

    for error, words in ERRORS.items():
        others = [(one["seconds_frame"], one[error]) for one in mine if not one["exact"] and one is not default]
        far = shortfall((default["seconds_frame"], default[error]), others)
        claim = f"no other is more than {100 * (NEAR - 1):.0f} % better in both time and {words}"
        add(default, f"factor from the front, {words}", claim, (far, far, far), len(mine), far <= NEAR)
    naive = next((one for one in mine if (one["family"], one["setting"]) == (RFGENESIS, PUBLISHED)), None)
    if naive is not None:
        ratio = ratios_of(naive["seconds"], default["seconds"])
        lower = all(default[error] < naive[error] for error in (*ERRORS, "free_error_db"))
        claim = f"at least {FASTER:g} times faster than the RF-Genesis-style pipeline, at lower error by every measure"
        add(naive, "its seconds a frame over those of the default", claim, ratio, len(naive["seconds"]), lower and ratio[0] >= FASTER)
    return rows
