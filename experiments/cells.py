"""Compute the rows of a result table from the frame (experiments.campaign.frame).

A table declares cells, each one row of the table: the rows of the frame that it selects, the estimate, and the claim if it states one. Its
function `cells` receives the frame of one draw (the measured recordings of this draw, and all simulated ones); `table_rows` computes the
cells of every draw and joins them. An estimate is made by one of the functions below from the VALUES of its units, over which it resamples:
a column's name gives one unit for each selected recording, `per` one unit for each object, and an array is used as it is.
"""

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from experiments import statistics
from experiments.campaign.cases import MEASURED, TWIN
from experiments.campaign.frame import PLACE, Column, Frame
from experiments.statistics import ANY, Estimate
from experiments.verdicts import NONE, Claim, Row
from radartwin.config.config import Config
from radartwin.errors import ConfigError

Values = str | Callable[[Frame], Any] | ArrayLike
Estimator = Callable[[Frame, int, int], Estimate]  # selected rows, resamples, seed
AVERAGED, SUMMED = ("chance", "seed_sd"), ("answers", "first_only", "second_only")  # columns to average, and to sum, over draws


@dataclass(frozen=True, eq=False)
class Cell:
    """One row of a result table: the columns `case` say what it is about, and `of` are the rows of the frame that the estimate uses."""

    case: Mapping[str, Any]
    metric: str
    of: Frame
    estimate: Estimator | Estimate
    claim: Claim = NONE
    count: int | None = None  # number that column n shows; None stands for the number of recordings
    panel: Any = None  # what a figure shows beside the row, of the first draw

    def row(self, config: Config) -> Row:
        """Compute the row. Raises ConfigError for a cell that selects no recordings, or that needs a column that the frame lacks."""
        where = f"cell {self.metric!r} ({', '.join(f'{name} {value}' for name, value in self.case.items())})"
        if self.of.empty:
            raise ConfigError(f"{where} selects no recordings; add them to profile.campaign or to the recording set")
        try:
            known, seeds = self.estimate, (config.profile.resamples, config.seed)
            estimate = known if isinstance(known, Estimate) else known(self.of, *seeds)
        except KeyError as error:
            raise ConfigError(f"{where} reads {error}, which its recordings lack; choose recordings with this column") from error
        return Row(self.case, self.metric, estimate, frozenset(self.of.key), self.claim, config, self.count, panel=self.panel)


Cells = Callable[[Frame], Iterable[Cell]]


def table_rows(config: Config, frame: Frame, cells: Cells, exact: Callable[[Row], bool] = lambda row: True) -> list[Row]:
    """Compute the cells for each draw, and join the draws.

    A twin or a truth with a name has further rows, with this name in the column `twin` or `truth` and without a claim: the rows whose value
    the twin changes, so that rows of measurements alone are left out, and the rows of another truth that `exact` chooses.
    """

    def rows(part: Frame) -> list[Row]:
        return joined_rows([cell.row(config) for cell in cells(draw_frame)] for draw_frame in by_draw(part))

    def same(row: Row) -> tuple[Any, ...]:
        return row.metric, *row.case.items()

    usual = configured(frame)
    out = rows(usual)
    known = {same(row): row["value"] for row in out}
    kept = {"twin": lambda row: row["value"] != known.get(same(row)), "truth": exact}
    for column, domain in (("twin", TWIN), ("truth", MEASURED)):
        for name in (name for name in frame[column].unique() if name):
            part = frame[(frame[column] == name) | frame.index.isin(usual.index[usual.domain != domain])]
            for row in filter(kept[column], rows(part)):
                out.append(replace(row, case={**row.case, column: name}, claim=Claim(paper=row.claim.paper)))
                out[-1]["draws"] = row["draws"]
    return out


def joined_rows(draws: Iterable[Iterable[Row]]) -> list[Row]:
    """Join the rows of several draws of one table: the mean over the draws that have a row (column draws; see statistics.over_draws). The
    columns AVERAGED and SUMMED may differ between draws.
    """
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in itertools.chain.from_iterable(draws):
        fixed = ((name, value) for name, value in row.case.items() if name not in (*AVERAGED, *SUMMED))
        groups.setdefault((row.metric, *fixed), []).append(row)
    out = []
    for group in groups.values():
        out.append(_joined(group) if len(group) > 1 else group[0])
        out[-1]["draws"] = len(group)
    return out


def _joined(rows: Sequence[Row]) -> Row:
    """Join the rows of several draws. The claim has the mean of each bound, and cannot be decided if most draws cannot decide it."""
    first, config, case = rows[0], rows[0].config, dict(rows[0].case)
    for name in (*AVERAGED, *SUMMED):
        if values := [row.case[name] for row in rows if row.case.get(name) is not None]:
            case[name] = sum(values) if name in SUMMED else float(np.mean(values))
    bounds = {}
    for name in ("bound", "null"):
        values = [getattr(row.claim, name) for row in rows]
        bounds[name] = values[0] if len(set(values)) == 1 else float(np.mean(values))
    reasons = [row.claim.untestable for row in rows if row.claim.untestable]
    return replace(
        first,
        case=case,
        estimate=statistics.over_draws([row.estimate for row in rows], config.profile.resamples, config.seed),
        recordings=frozenset().union(*(row.recordings for row in rows)),
        claim=replace(first.claim, **bounds, untestable=reasons[0] if 2 * len(reasons) > len(rows) else ""),
        count=None if first.count is None else sum(row.count or 0 for row in rows),
    )


def configured(frame: Frame) -> Frame:
    """Return the rows of the configured testbed, and those of simulations without the name of a twin."""
    return frame[(frame.twin == "") & (frame.truth == "")]


def by_draw(frame: Frame) -> list[Frame]:
    """Return one frame for each draw of the measurement: its measured recordings, and all simulated recordings."""
    measured = frame.domain == MEASURED
    return [frame[~measured | (frame.draw == draw)] for draw in sorted(frame.draw[measured].unique())]


def first_draw(frame: Frame) -> Frame:
    """Return the frame of the first draw of the configured testbed, as the figures show it."""
    return by_draw(configured(frame))[0]


def keys(frame: Frame) -> list[str]:
    """Return the store keys of all recordings of a frame."""
    return sorted(set(frame.key))


def paired(frame: Frame, on: Sequence[str] = PLACE) -> Frame:
    """Return a row for each measured recording and each simulated recording of the same place; the columns of the latter end in `_twin`."""
    measured, twin = (frame[frame.domain == domain] for domain in (MEASURED, TWIN))
    return measured.merge(twin, on=list(on), suffixes=("", "_twin"))


def per(column: str | list[str], domain: str | None = None) -> Callable[[Frame], Column]:
    """Return a function that averages a column for each object: first over the recordings of each place, then over the places."""

    def means(rows: Frame) -> Column:
        selected = rows if domain is None else rows[rows.domain == domain]
        return selected.groupby(list(PLACE), sort=False)[column].mean().groupby("object", sort=False).mean()

    return means


def gap(column: str, first: str, second: str) -> Callable[[Frame], Column]:
    """Return a function of the rows that gives the value in the domain `first` less that in `second` for each object (see `per`)."""
    return lambda rows: per(column, first)(rows) - per(column, second)(rows)


def using(function: Callable[..., Estimate], *of: Values) -> Estimator:
    """Estimate by `function(*values, resamples, seed)`, where `values` are the values of the units for each entry of `of`."""
    return lambda rows, *seeds: function(*(_values(rows, values) for values in of), *seeds)


def _values(rows: Frame, of: Values) -> NDArray:
    return np.asarray(rows[of] if isinstance(of, str) else of(rows) if callable(of) else of)


def mean(of: Values, limits: tuple[float, float] = ANY, on: str = "") -> Estimator:
    """Estimate the mean over units. `limits` are those of the quantity, and `on` is the scale of the interval (`statistics.SCALES`)."""
    return using(partial(statistics.mean, limits=limits, on=on), of)


def difference(of: Values, by: str, first: str, second: str) -> Estimator:
    """Estimate the mean over the units whose column `by` is `first`, less that over the units whose column is `second`."""
    return using(statistics.difference, *(lambda rows, kind=kind: _values(rows[rows[by] == kind], of) for kind in (first, second)))


def rank_correlation(first: Values, second: Values) -> Estimator:
    """Estimate Spearman's rank correlation over units, with a permutation test."""
    return lambda rows, resamples, seed: statistics.spearman(_values(rows, first), _values(rows, second), seed)


def mantel(columns: Sequence[str]) -> Estimator:
    """Estimate how well the distances between objects in the space of some columns agree between measurement and simulation."""
    first, second = (lambda rows, of=of: distances(per(list(columns), of)(rows).to_numpy()) for of in (MEASURED, TWIN))
    return lambda rows, resamples, seed: statistics.mantel(first(rows), second(rows), seed)


def distances(points: NDArray) -> NDArray[np.float64]:
    """Return the Euclidean distances (N, N) of points (N, D) after each coordinate is scaled to unit standard deviation."""
    from scipy.spatial.distance import pdist, squareform

    spread = points.std(axis=0)
    return squareform(pdist((points - points.mean(axis=0)) / np.where(spread > 0, spread, 1.0)))
