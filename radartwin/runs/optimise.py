"""Implement `radartwin run --search METRIC`: search for settings that maximise or minimise a metric, with Optuna.

The search is saved in output/search/NAME.db. NAME depends on all settings of the search, so the same command continues it.
"""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from radartwin.config.compose import Composer, parse_overrides
from radartwin.config.config import Config
from radartwin.config.messages import METRICS
from radartwin.errors import BackendError, ConfigError, UserError
from radartwin.io import files
from radartwin.io.one_line import plural
from radartwin.runs.job import FAILED, Outcome
from radartwin.runs.run import extend_path, naming
from radartwin.runs.sweep import composed, folders, split, sweeping
from radartwin.store.digest import spec_digest

if TYPE_CHECKING:
    from optuna import Study
    from optuna.distributions import BaseDistribution
    from optuna.trial import Trial


@dataclass(frozen=True)
class SearchGoal:
    """The metric to optimise, the number of trials (runs with proposed settings), and how many trials run at the same time."""

    metric: str
    trials: int = 20
    direction: str = "maximize"  # "maximize" or "minimize" the metric
    at_once: int = 1

    def __post_init__(self) -> None:
        if self.trials < 1 or self.at_once < 1:
            raise ConfigError(f"--trials {self.trials} and --at-once {self.at_once} must be 1 or more")


def search(overrides: Sequence[str], config_dirs: Sequence[Path], goal: SearchGoal) -> int:
    """Run trials until the search has the requested number of trials, print the best trial, and return the exit status.

    Raises ConfigError without a search space or metric of this name, and BackendError without Optuna or its database.
    """
    extend_path(config_dirs)
    settings, _ = split(overrides)
    fixed, searched = space(settings)
    if not searched:
        raise ConfigError("--search needs a setting to search over, such as 'trajectory.height_m=interval(0.5,1.5)'")
    composer = Composer(config_dirs)
    middle = [f"{key}={_text(_middle(distribution))}" for key, distribution in searched.items()]
    (first,) = composed([[*fixed, *middle]], composer)
    for old, instead in METRICS.get(first.experiment.name or "", {}).items():
        if match := re.fullmatch(old, goal.metric):
            raise ConfigError(f"--search {goal.metric}: the metric was renamed or removed after version 1.0; {match.expand(instead)}")
    study, place = _study(first, fixed, searched, goal)
    title = f"search {goal.direction} {goal.metric} over {' '.join(override for override in settings if naming([override]))}"
    with sweeping(first, [*fixed, *middle], ["--search", goal.metric, *overrides, *folders(config_dirs)], composer, title) as running:
        while (done := len(_finished(study))) < goal.trials:
            trials = [study.ask(searched) for _ in range(min(goal.at_once, goal.trials - done))]
            proposed = [[*fixed, *(f"{key}={_text(value)}" for key, value in trial.params.items())] for trial in trials]
            jobs = zip(trials, proposed, composed(proposed, composer), strict=True)
            running.run({trial.number: (job, config) for trial, job, config in jobs}, total=goal.trials)
            for trial in trials:
                _report(study, trial, running.outcomes[trial.number], goal.metric)
    status = running.close()
    print(f"search: {plural(len(_finished(study)), 'trial')} in {place}; {_best(study, goal)}")
    return status


def space(overrides: Sequence[str]) -> tuple[list[str], dict[str, BaseDistribution]]:
    """Split overrides into fixed overrides and the search distribution of each setting. Raises ConfigError.

    interval(a,b) is a continuous range, tag(log,interval(a,b)) a logarithmic one; range(a,b,step) and a,b,c are lists of values.
    """
    optuna = _optuna()
    fixed, searched = [], {}
    for text, override in zip(overrides, parse_overrides(overrides), strict=True):
        if not override.is_sweep_override():
            fixed.append(text)
            continue
        key, value = override.get_key_element(), cast(Any, override.value())
        if override.is_interval_sweep():
            low, high = float(value.start), float(value.end)
            log = "log" in value.tags
            if not (math.isfinite(low) and math.isfinite(high) and low < high and (low > 0 or not log)):
                raise ConfigError(f"{text}: wrong interval; give a smaller and a larger finite number, with the tag log both above zero")
            searched[key] = optuna.distributions.FloatDistribution(low, high, log=log)
        else:
            searched[key] = optuna.distributions.CategoricalDistribution(list(override.sweep_string_iterator()))
    return fixed, searched


def _study(first: Config, fixed: Sequence[str], searched: dict[str, BaseDistribution], goal: SearchGoal) -> tuple[Study, Path]:
    """Open or create Optuna's database for this search space, and queue trials again that a killed process left unfinished."""
    optuna = _optuna()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    described = {key: repr(distribution) for key, distribution in searched.items()}
    identity = {"space": described, "fixed": sorted(fixed), "metric": goal.metric, "direction": goal.direction}
    name = f"{first.experiment.name or 'search'}-{spec_digest(identity)[:8]}"
    place = files.make_folder(Path(first.output).absolute() / "search") / f"{name}.db"
    try:
        with files.lock(place.with_name(f".{place.name}.lock")):
            storage = optuna.storages.RDBStorage(f"sqlite:///{place.as_posix()}", engine_kwargs={"connect_args": {"timeout": 60}})
            study = optuna.create_study(storage=storage, study_name=name, direction=goal.direction, load_if_exists=True)
    except UserError:
        raise
    except Exception as error:  # SQLAlchemy, alembic and SQLite each raise their own exception types
        reason = " ".join(str(error).split())[:200]
        raise BackendError(f"{place}: the search database cannot be opened ({reason}); move the file away to start a new search") from error
    study.sampler = optuna.samplers.TPESampler(seed=first.seed + len(study.trials))
    for trial in study.get_trials(states=(optuna.trial.TrialState.RUNNING,)):
        study.enqueue_trial(trial.params)
        study.tell(trial.number, state=optuna.trial.TrialState.FAIL)
    return study, place


def _report(study: Study, trial: Trial, outcome: Outcome, metric: str) -> None:
    optuna = _optuna()
    value = outcome.metrics.get(metric)
    if outcome.finished and value is None:
        known = ", ".join(sorted(outcome.metrics)) or "none"
        raise ConfigError(f"--search {metric}: the experiment has no such metric; it has {known}")
    if outcome.finished and value is not None and math.isfinite(value):
        trial.set_user_attr("run_key", outcome.run_key)
        study.tell(trial, value)
    else:
        trial.set_user_attr("reason", outcome.line or FAILED)
        study.tell(trial, state=optuna.trial.TrialState.FAIL)


def _finished(study: Study) -> list[Any]:
    """Return the completed trials and the trials that failed for a stated reason, but not the trials that were interrupted by a kill."""
    return [trial for trial in study.get_trials(deepcopy=False) if trial.value is not None or "reason" in trial.user_attrs]


def _best(study: Study, goal: SearchGoal) -> str:
    try:
        best = study.best_trial
    except ValueError:
        return "none succeeded"
    settings = " ".join(f"{key}={_text(value)}" for key, value in best.params.items())
    return f"best {goal.metric} = {best.value:.6g} at {settings}, run {best.user_attrs['run_key'][:8]}"


def _middle(distribution: Any) -> Any:
    choices = getattr(distribution, "choices", None)
    return choices[0] if choices else (distribution.low + distribution.high) / 2


def _text(value: Any) -> str:
    return repr(value) if isinstance(value, float) else str(value)


def _optuna() -> Any:
    with contextlib.suppress(ModuleNotFoundError):
        import optuna

        return optuna
    raise BackendError("--search needs Optuna: pip install 'radartwin[search]'")
