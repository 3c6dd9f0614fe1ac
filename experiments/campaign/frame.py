"""The frame: one long table (pandas) with everything that the result tables read from the recordings of a campaign.

A row is one recording. The columns CONDITIONS, `domain`, VERSIONS and `key` (of the stored recording) say which; `material_class` and
`shape` come from the catalogue of objects; the other columns are read from the recording (experiments.campaign.columns). The columns
VERSIONS are empty for the configured testbed and for the simulation under test. `twin` names a simulation that knows less or more than
that, `truth` another testbed, and `side` a simulation or a set of measurements that a table compares with the configured one. Rows are
sorted by domain and by object in the order of the catalogue. The store keeps the frame under the keys of its recordings and the code that
reads them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from experiments.campaign import columns
from experiments.campaign.cases import COMPARED, DOMAINS, Case
from radartwin.errors import ConfigError, InputError
from radartwin.features.envelope import HARMONICS
from radartwin.features.log import Log
from radartwin.features.processed import Processed
from radartwin.io.progress import Progress
from radartwin.scene.objects.assortment import every_object
from radartwin.store.products import save_arrays

if TYPE_CHECKING:
    from experiments.campaign.campaign import Campaign

Frame = Any  # a pandas.DataFrame; the types that pandas declares are too wide for the type checker
Column = Any  # a pandas.Series
CONDITIONS = tuple(field.name for field in fields(Case))
KINDS = ("material_class", "shape")  # columns from the catalogue
PLACE = ("object", "room", "motion", "distance_m")  # a measured and a simulated recording of one place are compared
VERSIONS = ("twin", "truth", "side")
Wanted = Sequence[tuple[str, Case]]  # domain, case


class RecordingSource(Protocol):
    """Interface of a campaign (experiments.campaign.campaign). Tests may use a substitute for the campaign with the same interface."""

    def cases(self, domain: str, **conditions: Any) -> Sequence[Case]: ...
    def prepare(self, wanted: Any) -> None: ...
    def processed(self, domain: str, case: Case) -> tuple[str, Processed]: ...
    def log(self, case: Case, domain: str = "measured") -> Log: ...


def shared(source: RecordingSource, motions: Sequence[str], room: str | None = None, several: bool = False) -> Wanted:
    """Return the recordings with these motions (of one room, or of all) whose place is both measured and simulated; with `several`, only
    those that `balanced` keeps. Raises ConfigError if there are none.
    """
    import pandas as pd

    conditions = {"room": room} if room else {}
    cases = [(domain, case) for domain in COMPARED for motion in motions for case in source.cases(domain, motion=motion, **conditions)]
    places = [{_place(case) for of, case in cases if of == domain} for domain in COMPARED]
    if not (common := set.intersection(*places)):
        raise ConfigError(
            f"the campaign has no {' or '.join(motions)} recordings of one object and place, both measured and simulated; "
            "add objects or distances to profile.campaign or to the recording set"
        )
    objects = list(every_object())
    wanted = [(domain, case) for domain, case in cases if _place(case) in common]
    wanted = sorted(
        wanted,
        key=lambda pair: (
            DOMAINS.index(pair[0]), objects.index(pair[1].object), pair[1].room, motions.index(pair[1].motion), pair[1].distance_m,
            pair[1].repetition,
        ),
    )  # fmt: skip
    if not several:
        return wanted
    return [wanted[row] for row in balanced(pd.DataFrame([{"domain": domain, **vars(case)} for domain, case in wanted])).index]


def _place(case: Case) -> tuple[Any, ...]:
    return tuple(getattr(case, name) for name in PLACE)


def stored(campaign: Campaign, wanted: Wanted, progress: Progress) -> Frame:
    """Return the frame of some recordings from the store; a frame that the store lacks is read first. Missing recordings are simulated."""
    campaign.prepare(wanted)
    keys = [[domain, astuple(case), campaign.process(domain, case).key] for domain, case in wanted]

    def build(folder: Path) -> None:
        save(read(campaign, wanted, progress), folder)

    return load(campaign.store.fetch("frame", {"recordings": keys}, [__name__], build).arrays())


def read(source: RecordingSource, wanted: Wanted, progress: Progress) -> Frame:
    """Read the frame of some recordings."""
    import pandas as pd

    rows, known = [], every_object()
    for domain, case in progress.over(list(wanted), "recordings read"):
        key, processed = source.processed(domain, case)
        conditions = {**vars(case), "domain": domain, **dict.fromkeys(VERSIONS, ""), "key": key}
        kind = {name: getattr(known[case.object], name) for name in KINDS}
        rows.append({**conditions, **kind, **columns.read(case, processed, source.log(case, domain))})
    return pd.DataFrame(rows)


def features(rows: Frame) -> list[str]:
    """Return the names of the features that all of these rows have."""
    numbers = rows.select_dtypes("float").drop(columns=[*CONDITIONS, "frame_rate_hz"], errors="ignore")
    return list(numbers.columns[numbers.notna().all()])


def check_revolutions(frame: Frame) -> None:
    """Raise InputError if a turntable recording is no whole revolution with enough frames, so that columns of `columns` are missing."""
    if "revolutions" not in frame or frame.revolutions.isna().any():
        raise InputError(
            f"a turntable recording is no whole revolution of more than {2 * HARMONICS} frames; record one, or raise "
            "profile.campaign.frames_per_turn"
        )


def by_revolution(frame: Frame) -> Frame:
    """Return a row for each whole revolution of the turntable recordings, with the features of this revolution."""
    rows = frame.loc[frame.index.repeat(frame.revolutions.map(len))].reset_index(drop=True)
    rows[features(frame)] = np.concatenate(list(frame.revolutions))
    return rows


def balanced(frame: Frame) -> Frame:
    """Return the rows at distances with two objects or more, with as many repetitions for each. Raises InputError if no row is left."""
    where = ["room", "motion", "distance_m"]
    compared = frame[frame.groupby(where).object.transform("nunique") > 1]
    if compared.empty:
        raise InputError("the campaign has no recordings of two objects at one distance, both measured and simulated; add objects")
    groups = compared.groupby(["domain", *PLACE])
    fewest = groups.distance_m.transform("size").groupby([compared[name] for name in ("domain", *where)]).transform("min")
    return compared[groups.cumcount() < fewest]


def save(frame: Frame, folder: Path) -> None:
    """Save a frame as arrays: one array for a column of numbers or texts, and one array for each cell of a column of arrays."""
    arrays: dict[str, np.ndarray] = {}
    for name, column in frame.items():
        if isinstance(column.iloc[0], np.ndarray):
            arrays |= {f"{name}/{row}": value for row, value in enumerate(column)}
        else:
            arrays[name] = np.array(column.tolist())
    save_arrays(folder, arrays)


def load(arrays: dict[str, np.ndarray]) -> Frame:
    """Return the frame that `save` has written."""
    import pandas as pd

    cells: dict[str, list[Any]] = {}
    for name, values in arrays.items():
        column, is_cell, _ = name.partition("/")
        cells.setdefault(column, []).extend([values] if is_cell else values.tolist())
    return pd.DataFrame(cells)
