"""Tables of feature rows, each with its recording, object, stratum (recording condition) and domain (simulated or measured).

Feature rows are sorted by the names of their recordings, so that results do not depend on the order of files or on which worker computes
them. A classifier gives one class per recording, and all frames of a recording are either in the training data or in the test data. If a
recording was cut from a longer recording, as single turntable revolutions are, the column `source` names the longer recording. Training and
test rows never come from the same stored recording.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.errors import InputError

SIMULATED, MEASURED = "simulated", "measured"


@dataclass(frozen=True, eq=False)
class Unlabelled:
    """Feature rows without class labels.

    Attributes:
        names: names of the D signal features, which are the columns of `values`.
        values: (N, D) float64 feature values, all finite.
        recording: (N,) name of each row's recording; simulated and measured recordings have different names.
        stratum: (N,) recording condition of each row, such as the distance; only rows of equal condition are compared. "" for none.
        domain: (N,) SIMULATED or MEASURED for each row.
        source: (N,) name of the stored recording from which each row's recording was cut.
    """

    names: tuple[str, ...]
    values: NDArray[np.float64]
    recording: NDArray[np.str_]
    stratum: NDArray[np.str_]
    domain: NDArray[np.str_]
    source: NDArray[np.str_]

    def __post_init__(self) -> None:
        rows = len(self.recording)
        if self.values.shape != (rows, len(self.names)):
            raise InputError(f"samples: {self.values.shape} values do not fit {rows} rows of {len(self.names)} features")
        for name in self._columns():
            if getattr(self, name).shape != (rows,):
                raise InputError(f"samples: {name} must be ({rows},), not {getattr(self, name).shape}")
        if rows and not np.isin(self.domain, (SIMULATED, MEASURED)).all():
            raise InputError(f"samples: a domain must be {SIMULATED} or {MEASURED}")
        if (bad := np.argwhere(~np.isfinite(self.values))).size:
            row, column = bad[0]
            raise InputError(f"samples: {self.names[column]} of recording {self.recording[row]} is not finite; check the recording")

    def __len__(self) -> int:
        return len(self.recording)

    def _columns(self) -> tuple[str, ...]:
        return ("recording", "stratum", "domain", "source")

    def take(self, rows: ArrayLike):
        """Return the rows that a mask or an array of indices selects."""
        selection = np.asarray(rows)
        return replace(self, values=self.values[selection], **{name: getattr(self, name)[selection] for name in self._columns()})

    def with_values(self, values: NDArray, names: Sequence[str] | None = None):
        """Return the same rows with other feature values and, if `names` is given, other feature names."""
        return replace(self, values=np.asarray(values, dtype=np.float64), names=tuple(names) if names is not None else self.names)


@dataclass(frozen=True, eq=False)
class Samples(Unlabelled):
    """Feature rows with class labels.

    Attributes:
        label: (N,) class of each row: its object, or after `relabelled` for example the shape of its object.
        object: (N,) object of each row. The objects are the clusters of tests and intervals, because all recordings of an object share its
            mesh, and therefore the errors of this mesh.
    """

    label: NDArray[np.str_]
    object: NDArray[np.str_]

    def __post_init__(self) -> None:
        super().__post_init__()
        last = dict(zip(self.recording, zip(self.label, self.domain, self.source, strict=True), strict=True))
        for name, *described in zip(self.recording, self.label, self.domain, self.source, strict=True):
            if last[name] != tuple(described):
                raise InputError(f"samples: recording {name} has two labels, domains or sources; a recording shows one object")

    def _columns(self) -> tuple[str, ...]:
        return (*super()._columns(), "label", "object")

    @property
    def classes(self) -> tuple[str, ...]:
        """Return the class labels that occur in the rows, sorted."""
        return tuple(map(str, np.unique(self.label)))

    def unlabelled(self) -> Unlabelled:
        return Unlabelled(self.names, self.values, self.recording, self.stratum, self.domain, self.source)

    def relabelled(self, classes: Mapping[str, str]) -> Samples:
        """Return the same rows with each object name replaced by its class in `classes`, for example its shape."""
        return replace(self, label=np.array([classes[label] for label in self.label], dtype=str))

    def without(self, label: str) -> Samples:
        return self.take(self.label != label)

    def per_recording(self) -> Samples:
        """Return one feature row per recording: the mean of the recording's rows."""
        names, first, inverse = np.unique(self.recording, return_index=True, return_inverse=True)
        means = np.zeros((len(names), self.values.shape[1]))
        np.add.at(means, inverse, self.values)
        return self.take(first).with_values(means / np.bincount(inverse)[:, None])


@dataclass(frozen=True, eq=False)
class Part:
    """One recording: its feature rows (n, D) or (D,), class label, domain, stratum, and the longer recording it was cut from, if any."""

    recording: str
    label: str
    domain: str
    values: NDArray
    stratum: str = ""
    source: str = ""


def gather(names: Sequence[str], parts: Sequence[Part]) -> Samples:
    """Join the feature rows of several recordings into one table, in the order of the recordings' names.

    Raises:
        InputError: no recording is given, two recordings have the same name, or the rows do not match the feature names.
    """
    if not parts:
        raise InputError("samples: there are no recordings; give at least one")
    ordered = sorted(parts, key=lambda part: part.recording)
    for first, second in itertools.pairwise(ordered):
        if first.recording == second.recording:
            raise InputError(f"samples: two recordings are named {first.recording}; give each its own name")
    rows = [np.atleast_2d(np.asarray(part.values, dtype=np.float64)) for part in ordered]
    if wrong := [part.recording for part, row in zip(ordered, rows, strict=True) if row.shape[1] != len(names)]:
        raise InputError(f"samples: recording {wrong[0]} does not have the {len(names)} features {', '.join(names[:3])} ...")
    counts = [len(row) for row in rows]

    def column(values: Sequence[str]) -> NDArray[np.str_]:
        return np.repeat(np.array(values, dtype=str), counts)

    columns = {name: column([getattr(part, name) for part in ordered]) for name in ("recording", "stratum", "domain", "label")}
    source = column([part.source or part.recording for part in ordered])
    return Samples(tuple(names), np.concatenate(rows), source=source, object=columns["label"], **columns)


def join(*samples: Samples) -> Samples:
    """Join several tables of feature rows, sorted by recording. Raise InputError if the tables have different features."""
    if len({table.names for table in samples}) != 1:
        raise InputError("samples: sets with different features cannot be joined; compute all with one feature set")
    columns = {name: np.concatenate([getattr(table, name) for table in samples]) for name in samples[0]._columns()}
    together = Samples(samples[0].names, np.concatenate([table.values for table in samples]), **columns)
    return together.take(np.argsort(together.recording, kind="stable"))
