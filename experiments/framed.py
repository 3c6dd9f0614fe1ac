"""Make the functions of a table's module that the runner calls, from what the table declares: recordings, cells, figures and metrics."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from experiments.campaign.cases import MEASURED
from experiments.campaign.frame import Frame
from experiments.cells import Cell, first_draw, keys, table_rows
from experiments.drawing import Figure
from experiments.draws import Query
from experiments.interface import Config, Progress, Result, Store, Table
from experiments.verdicts import Row

Figures = Mapping[str, Callable[[], Figure]]


def _alone(query: Query, store: Store, progress: Progress) -> tuple[Frame]:
    return (query.frame(store, progress),)


def at_draw(config: Config, frame: Frame) -> Config:
    """Return the configuration with the draw of a frame that has the measured recordings of one draw of the testbed."""
    numbers = frame.draw[frame.domain == MEASURED].unique()
    if config.measured.provider != "testbed" or len(numbers) != 1:
        return config
    return replace(config, measured=replace(config.measured, draw=int(numbers[0])))


def framed(
    table: Table,
    query: Callable[[Config], Query] | Mapping[str, Any],
    cells: Callable[..., Iterable[Cell]],
    figures: Callable[[list[Row], Frame], Figures] | Mapping[str, Callable[[Frame], Figure]],
    metrics: Callable[[list[Row]], Mapping[str, float]] | Mapping[str, Mapping[str, Any]],
    *,
    source: Callable[[Query, Store, Progress], tuple[Any, ...]] = _alone,
    exact: Callable[[Row], bool] = lambda row: True,
    listed: Callable[[Row], bool] = lambda row: True,
    named: bool = False,
) -> tuple[Any, Any, Any]:
    """Return the functions `run` and `recordings` of a module, and `score`, which computes the result from a frame.

    Args:
        query: returns the recordings of the table, or the arguments of `Query`.
        cells: (configuration with the draw, frame) -> cells of one draw. Further values that `source` returns beside the frame precede it.
        figures: of the rows and the frame of the first draw, or by name the functions that draw this frame.
        metrics: of the rows, or by name, which is filled with the columns of a row, the columns that the row must have.
        source: returns the frame of a query, and further values.
        exact: argument of `cells.table_rows`. listed: chooses the rows that the table prints.
        named: whether the result lists only the recordings that rows name.
    """

    def asked(config: Config) -> Query:
        return Query(config, **query) if isinstance(query, Mapping) else query(config)

    def measured(rows: list[Row]) -> Mapping[str, float]:
        if not isinstance(metrics, Mapping):
            return metrics(rows)
        kept = [(name, row) for name, has in metrics.items() for row in rows if all(row.get(key) == value for key, value in has.items())]
        return {name.format_map(row).replace(" ", "_"): row["value"] for name, row in kept}

    def score(config: Config, frame: Frame, *more: Any) -> Result:
        rows = table_rows(config, frame, lambda part: cells(at_draw(config, part), *more, part), exact)
        first = first_draw(frame)
        used = sorted(frozenset().union(*(row.recordings for row in rows))) if named else keys(frame)
        drawn = {name: partial(draw, first) for name, draw in figures.items()} if isinstance(figures, Mapping) else figures(rows, first)
        return Result(table.name, [*filter(listed, rows)], drawn, measured(rows), used)

    def run(config: Config, store: Store, progress: Progress) -> Result:
        return score(config, *source(asked(config), store, progress))

    return run, lambda config, store, progress: asked(config).recordings(store, progress), score
