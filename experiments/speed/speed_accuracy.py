"""Speed against accuracy: run time and error of each simulation method on each test problem.

A method is on the Pareto front of a problem if no other method is at least as fast and as accurate, and better in one of the two. The claim
about the default holds if no other is both faster and more accurate by more than the factor NEAR. The timed methods alternate, and the
table gives ratios within one run, because run times depend on the machine and its load. The last problem, the campaign's turntable
recordings (`campaign_methods`), compares run time with feature error and recognition error.
"""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments import verdicts
from experiments.campaign.schedule import RecordingTask
from experiments.interface import Config, Progress, Result, Table
from experiments.speed import campaign_methods, chart, chart_page, measuring
from experiments.speed.chart import front, shortfall
from experiments.speed.machine import machine
from experiments.speed.methods import DEFAULT, OURS, RFGENESIS, of_problem
from experiments.speed.problems import Problem, problems
from experiments.statistics import Estimate, exact
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
MEASURED = (  # columns of the measurements; most are empty in the rows of the campaign
    "problem", "family", "setting", "seconds_frame", "wall_s_frame", "setup_s", "frames timed", "memory_mib", "rays", "signal_error",
    "profile_error_db", "offset_db", "free_error_db",
)  # fmt: skip
# columns of fronts and of the campaign's errors
SCORED = ("front", "front of the signal", "feature_error", "recognition_error", "front of features", "front of recognition")
COST = "seconds a frame over those of the default"
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
    keys += [key for method in on_campaign for key in method["keys"]]
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
    """Return each method's run time over the default's, then the claims: on the Pareto fronts, and faster than RF-Genesis."""
    rows: list[dict[str, Any]] = []
    for name in dict.fromkeys(method["problem"] for method in measured):
        mine = [method for method in measured if method["problem"] == name]
        default = next(method for method in mine if (method["family"], method["setting"]) == (OURS, DEFAULT))
        row = partial(_row, machine, known[name].title, known[name].truth)
        signal, profile = (
            front([(math.inf, math.inf) if method["exact"] else (method["seconds_frame"], method[error]) for method in mine])
            for error in ERRORS
        )
        for number, method in enumerate(mine):
            marks = {"front": profile[number], "front of the signal": signal[number]}
            rows.append(row(method, COST, ratios_of(method["seconds"], default["seconds"]), marks))
        for error, words in ERRORS.items():
            others = [(method["seconds_frame"], method[error]) for method in mine if not method["exact"] and method is not default]
            far = shortfall((default["seconds_frame"], default[error]), others)
            claim = f"no other is more than {100 * (NEAR - 1):.0f} % better in both time and {words}"
            rows.append(row(default, f"factor from the front, {words}", exact(far, len(mine)), {}, claim, far <= NEAR))
        naive = next((method for method in mine if (method["family"], method["setting"]) == (RFGENESIS, PUBLISHED)), None)
        if naive is not None:
            ratio = ratios_of(naive["seconds"], default["seconds"])
            lower = all(default[error] < naive[error] for error in (*ERRORS, "free_error_db"))
            claim = f"at least {FASTER:g} times faster than the RF-Genesis-style pipeline, at lower error by every measure"
            rows.append(row(naive, f"its {COST}", ratio, {}, claim, lower and ratio.low >= FASTER))
    return rows


def _row(
    machine: Mapping[str, str], title: str, domain: str, method: Mapping[str, Any], metric: str, estimate: Estimate,
    marks: Mapping[str, bool], claim: str = "", holds: bool | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Return one row of the table from the measurement of a method."""
    return {
        **{name: method.get(name) for name in MEASURED}, "least_s_frame": min(method["seconds"]), "most_s_frame": max(method["seconds"]),
        "title": title, "machine": "; ".join(machine.values()), "exact": method["exact"], **{name: method.get(name) for name in SCORED},
        **marks, "claim": claim, **verdicts.score_columns(metric, estimate, domain, holds, method.get("keys", ())),
    }  # fmt: skip


def campaign_rows(methods: Sequence[Mapping[str, Any]], machine: Mapping[str, str], domain: str) -> list[dict[str, Any]]:
    """Return rows for the campaign's recordings: each method's relative run time and two errors, then the claims about faster methods."""
    default, row = methods[0], partial(_row, machine, campaign_methods.TITLE, domain)
    scores = {"features": "feature_error", "recognition": "recognition_error"}
    fronts = {f"front of {name}": front([(method["seconds_frame"], method[score]) for method in methods]) for name, score in scores.items()}
    marks = [dict(zip(fronts, on, strict=True)) for on in zip(*fronts.values(), strict=True)]
    rows = [row(method, COST, ratios_of(method["seconds"], default["seconds"]), mark) for method, mark in zip(methods, marks, strict=True)]
    # standard errors of the default's scores; by Laplace's rule of succession, that of a share is never zero
    fair = (default["recognition_error"] * default["answers"] + 1) / (default["answers"] + 2)
    errors = {"features": default["spread of feature_error"], "recognition": math.sqrt(fair * (1 - fair) / default["answers"])}
    for name, score in scores.items():
        as_good = [method["seconds_frame"] for method in methods if method[score] <= default[score] + errors[name]]
        far = default["seconds_frame"] / min(as_good)
        claim = f"no other that is as good in {name}, within a standard error, is more than {100 * (NEAR - 1):.0f} % faster"
        metric = f"times the cheapest that is as good in {name}"
        rows.append(row(default, metric, exact(far, len(methods)), marks[0], claim, far <= NEAR))
    return rows


def ratios_of(seconds: Sequence[float], default_s: Sequence[float]) -> Estimate:
    """Return the median and the range of the ratio of two methods' seconds in the same round, over the last rounds of both methods."""
    n = min(len(seconds), len(default_s))
    ratio = np.array(seconds[-n:]) / np.array(default_s[-n:])
    return Estimate(float(np.median(ratio)), float(ratio.min()), float(ratio.max()), len(seconds))
