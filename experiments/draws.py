"""Score a table for several draws of the virtual measurement campaign, and join the scores.

A draw of the campaign (experiments.campaign.cases.Case) is one sample of everything that the testbed chooses at random. The options
profile.campaign.draws (turntable and rail) and profile.campaign.rover_draws (drives) set the number of draws. The simulation under test is
the same for all draws.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from experiments import statistics
from experiments.campaign.campaign import Campaign
from experiments.campaign.campaign import joined as joined_tasks
from experiments.campaign.cases import MEASURED, ROVER, Case, draws
from experiments.campaign.frame import Frame, check_revolutions, shared, stored
from experiments.campaign.schedule import RecordingTask
from experiments.claims import Claim, Row
from radartwin.config.config import Config
from radartwin.errors import ConfigError
from radartwin.io.progress import Progress
from radartwin.runs.experiment import Result
from radartwin.store.products import Store

UNKNOWN, EXACT = "contents unknown", "objects of the catalogue"
OBJECT_GAPS = ("object_shape", "object_material", "contents")  # gaps that change the target
AVERAGED, SUMMED = ("chance", "seed_sd"), ("answers", "first_only", "second_only")  # columns to average, and to sum, over draws


def scored(config: Config, store: Store, progress: Progress, score: Callable[[Campaign], Result], rover: bool = False) -> Result:
    """Return the result of a table over all draws, or over the configured draw (measured.draw).

    Args:
        score: function that returns the result of the table for the campaign of one draw.
        rover: whether the table reads drives, whose number of draws is set separately.
    """
    return joined([score(Campaign(config, store, progress, draw)) for draw in numbers(config, rover)])


def beside_unknown(config: Config, scored_of: Callable[[Config], Result]) -> Result:
    """Return the result of a table, with further rows for a simulation in which the contents of vessels are unknown.

    The column `twin` of the further rows says "contents unknown", and these rows state no claim. A further row is left out if its value
    does not depend on the contents, as for rows that use only measurements. Only a profile with `unknown_contents` has further rows.

    Args:
        scored_of: function that returns the result of the table for a configuration.
    """
    result = scored_of(config)
    for other in unknown_contents(config):
        result = _beside(result, scored_of(other), {"twin": UNKNOWN}, changed_from(result.rows))
    return result


def changed_from(rows: Sequence[Mapping[str, Any]]) -> Callable[[Row], bool]:
    """Return a function that tells whether the value of a row differs from that of the same row in `rows`. Rows that use only measurements
    do not differ.
    """
    ours = {(row["metric"], *row.case.items()): row["value"] for row in rows if isinstance(row, Row)}
    return lambda row: row["value"] != ours.get((row["metric"], *row.case.items()))


def unknown_contents(config: Config) -> list[Config]:
    """Return the configuration of the further rows of `beside_unknown`, or an empty list if there are no further rows."""
    return [replace(config, contents="unknown")] if config.profile.unknown_contents and config.contents == "filled" else []


def beside_exact_objects(config: Config, scored_of: Callable[[Config], Result], kept: Callable[[Row], bool] = lambda row: True) -> Result:
    """Return the result of a table, with further rows for a testbed whose objects equal the catalogue.

    The column `truth` of the further rows says "objects of the catalogue", and these rows state no claim. The further rows come from one
    draw of the testbed without the gaps OBJECT_GAPS.

    Args:
        scored_of: function that returns the result of the table for a configuration.
        kept: function that tells whether a row of the testbed without these gaps is kept.
    """
    result = scored_of(config)
    for other in exact_objects(config):
        result = _beside(result, scored_of(other), {"truth": EXACT}, kept)
    return result


def exact_objects(config: Config) -> list[Config]:
    """Return the configuration of the further rows of `beside_exact_objects`, or an empty list if there are no further rows.

    There are no further rows if the profile has no `exact_objects`, or if the measurements come from a recording set.
    """
    if not config.profile.exact_objects or config.measured.provider != "testbed":
        return []
    gap = replace(config.measured.gap, **dict.fromkeys(OBJECT_GAPS, 0.0))
    return [replace(config, measured=replace(config.measured, gap=gap, draw=numbers(config)[0]))]


def frame(config: Config, store: Store, progress: Progress, motions: Sequence[str], unknown: bool = False) -> Frame:
    """Return the frame of all draws that a table reads. With `unknown`, the frame also has the simulation of `unknown_contents`."""
    import pandas as pd

    read = []
    for twin, own in [("", config), *((UNKNOWN, other) for other in unknown_contents(config) if unknown)]:
        campaign = whole_campaign(own, store, progress, motions[0] in ROVER)
        wanted = [(domain, case) for domain, case in shared(campaign, motions) if domain != MEASURED or not twin]
        read.append(stored(campaign, wanted, progress).assign(twin=twin))
    out = pd.concat(read, ignore_index=True)
    if "turntable" in motions:
        check_revolutions(out)
    return out


def whole_campaign(config: Config, store: Store, progress: Progress, rover: bool = False) -> Campaign:
    """Return the campaign of all draws that a table reads."""
    read = numbers(config, rover)
    return Campaign(config, store, progress, read[0] if len(read) == 1 else None)


def recordings(
    configs: Iterable[Config],
    wanted: Callable[[Campaign], Iterable[tuple[str, Case]]],
    store: Store,
    progress: Progress,
    rover: bool = False,
) -> dict[str, RecordingTask]:
    """Return the recordings that a table reads and the store lacks, for all configurations and draws, as `together` needs them.

    Args:
        wanted: function that returns the (domain, case) pairs that the table reads from a campaign with these draws.
        rover: that of `scored`.
    """
    campaigns = [whole_campaign(one, store, progress, rover) for one in configs]
    return joined_tasks([campaign.missing(wanted(campaign)) for campaign in campaigns])


def _beside(result: Result, other: Result, column: Mapping[str, str], kept: Callable[[Row], bool]) -> Result:
    rows = [*result.rows, *beside(other.rows, column, kept)]
    return replace(result, rows=rows, keys=sorted({*result.keys, *other.keys}))


def beside(rows: Sequence[Mapping[str, Any]], column: Mapping[str, str], kept: Callable[[Row], bool]) -> list[Row]:
    """Return those rows that `kept` chooses, with the entries of `column` and without their claims."""
    found = []
    for row in rows:
        assert isinstance(row, Row), f"{row['metric']} is no Row"
        if kept(row):
            found.append(replace(row, case={**row.case, **column}, claim=Claim(paper=row.claim.paper)))
            found[-1]["draws"] = row.get("draws")
    return found


def numbers(config: Config, rover: bool = False) -> list[int]:
    """Return the numbers of the draws that a table reads. A recording set is a single draw. Raises ConfigError for a configured draw that
    the campaign lacks.
    """
    if config.measured.provider != "testbed":
        return [0]
    known, draw = draws(config.profile.campaign, rover), config.measured.draw
    if draw is not None and draw not in known:
        kind = "drives" if rover else "turntable and rail"
        raise ConfigError(f"measured.draw={draw}: the draws of {kind} are {known[0]} to {known[-1]} in profile={config.profile.name}")
    return list(known) if draw is None else [draw]


def joined(results: Sequence[Result]) -> Result:
    """Join the results of several draws of one table. The figures and models are those of the first draw."""
    first = results[0]
    rows = joined_rows([result.rows for result in results])
    metrics = {name: float(np.mean([one.metrics[name] for one in results if name in one.metrics])) for name in first.metrics}
    keys = sorted({key for one in results for key in one.keys})
    return Result(first.table, list(rows), first.figures, metrics, keys, models=first.models)


def joined_rows(draws: Iterable[Iterable[Mapping[str, Any]]]) -> list[Row]:
    """Join the rows of several draws of one table.

    A joined row is the mean over the draws that have this row (column draws; see statistics.over_draws). Bounds of a claim that depend on
    the draw are averaged.
    """
    found: dict[tuple[Any, ...], list[Row]] = {}
    for rows in draws:
        for row in rows:
            assert isinstance(row, Row), f"{row['metric']} is no Row"
            fixed = ((name, value) for name, value in row.case.items() if name not in (*AVERAGED, *SUMMED))
            found.setdefault((row.metric, *fixed), []).append(row)
    out = [_joined(some) for some in found.values()]
    for row, some in zip(out, found.values(), strict=True):
        row["draws"] = len(some)
    return out


def _joined(rows: Sequence[Row]) -> Row:
    """Join the rows of several draws to one row. All rows have the same metric and the same `case`, except for the columns AVERAGED and
    SUMMED.
    """
    first, config = rows[0], rows[0].config
    if len(rows) == 1:
        return first
    found = statistics.over_draws([row.found for row in rows], config.profile.resamples, config.seed)
    case = dict(first.case)
    for name in (*AVERAGED, *SUMMED):
        values = [row.case[name] for row in rows if row.case.get(name) is not None]
        if values:
            case[name] = sum(values) if name in SUMMED else float(np.mean(values))
    count = None if first.count is None else sum(row.count or 0 for row in rows)
    return Row(
        case, first.metric, found, frozenset().union(*(row.recordings for row in rows)), _claim([row.claim for row in rows]), config, count,
        first.domain,
    )  # fmt: skip


def _claim(claims: Sequence[Claim]) -> Claim:
    """Return the claim of several draws, with the mean of each bound. The joined claim cannot be decided if most draws cannot decide it."""
    bounds = {}
    for name in ("bound", "null"):
        values = [getattr(claim, name) for claim in claims]
        bounds[name] = values[0] if len(set(values)) == 1 else float(np.mean(values))
    reasons = [claim.untestable for claim in claims if claim.untestable]
    return replace(claims[0], **bounds, untestable=reasons[0] if 2 * len(reasons) > len(claims) else "")
