"""Feature rows with what is known of each: which recording and frame it is of, which object, stratum and domain.

Rows are kept in the order of their recordings' names, whatever order files were read in and whichever worker made them, so that nothing
downstream can depend on it. A recording is what one answer is given for, and its frames always go together; where it was cut from a longer
one, as revolutions are, `source` names that, and what is learned from and what is scored never share a source.
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
    """Rows whose objects nobody has told.

    Attributes:
        names: of the D features.
        values: (N, D) float64, finite.
        recording: (N,) name of the recording a row is of; unique across domains.
        stratum: (N,) what is matched, such as the distance; "" where nothing is.
        domain: (N,) SIMULATED or MEASURED.
        source: (N,) name of the stored recording that `recording` was cut from, or is.
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
            raise InputError(f"samples: a domain is {SIMULATED} or {MEASURED}")
        if (bad := np.argwhere(~np.isfinite(self.values))).size:
            row, column = bad[0]
            raise InputError(f"samples: {self.names[column]} of recording {self.recording[row]} is not finite; check the recording")

    def __len__(self) -> int:
        return len(self.recording)

    def _columns(self) -> tuple[str, ...]:
        return ("recording", "stratum", "domain", "source")

    def take(self, rows: ArrayLike):
        """The chosen rows: a mask, or indices."""
        chosen = np.asarray(rows)
        return replace(self, values=self.values[chosen], **{name: getattr(self, name)[chosen] for name in self._columns()})

    def with_values(self, values: NDArray, names: Sequence[str] | None = None):
        """The same rows with other features."""
        return replace(self, values=np.asarray(values, dtype=np.float64), names=tuple(names) if names is not None else self.names)


@dataclass(frozen=True, eq=False)
class Samples(Unlabelled):
    """Rows with their object, (N,), and nothing else that says what they are."""

    label: NDArray[np.str_]

    def __post_init__(self) -> None:
        super().__post_init__()
        owners = dict(zip(self.recording, zip(self.label, self.domain, self.source, strict=True), strict=True))
        for name, *owner in zip(self.recording, self.label, self.domain, self.source, strict=True):
            if owners[name] != tuple(owner):
                raise InputError(f"samples: recording {name} has two labels, domains or sources; a recording shows one object")

    def _columns(self) -> tuple[str, ...]:
        return (*super()._columns(), "label")

    @property
    def classes(self) -> tuple[str, ...]:
        """The labels that occur, sorted."""
        return tuple(map(str, np.unique(self.label)))

    def unlabelled(self) -> Unlabelled:
        return Unlabelled(self.names, self.values, self.recording, self.stratum, self.domain, self.source)

    def relabelled(self, classes: Mapping[str, str]) -> Samples:
        """The same rows with each label replaced by its class, such as objects by their shape."""
        return replace(self, label=np.array([classes[label] for label in self.label], dtype=str))

    def without(self, label: str) -> Samples:
        """All rows of other objects."""
        return self.take(self.label != label)

    def per_recording(self) -> Samples:
        """One row per recording, the mean of its rows."""
        names, first, inverse = np.unique(self.recording, return_index=True, return_inverse=True)
        means = np.zeros((len(names), self.values.shape[1]))
        np.add.at(means, inverse, self.values)
        return self.take(first).with_values(means / np.bincount(inverse)[:, None])


@dataclass(frozen=True, eq=False)
class Part:
    """What one recording brings: its rows (n, D) or (D,), its label, what it is matched by, and what it was cut from if it is not whole."""

    recording: str
    label: str
    domain: str
    values: NDArray
    stratum: str = ""
    source: str = ""


def gather(names: Sequence[str], parts: Sequence[Part]) -> Samples:
    """All rows of the recordings, in the order of the recordings' names.

    Raises:
        InputError: no recording, a recording that comes twice, or rows that do not fit the features.
    """
    if not parts:
        raise InputError("samples: there are no recordings to gather")
    ordered = sorted(parts, key=lambda part: part.recording)
    for one, two in itertools.pairwise(ordered):
        if one.recording == two.recording:
            raise InputError(f"samples: recording {one.recording} comes twice")
    rows = [np.atleast_2d(np.asarray(part.values, dtype=np.float64)) for part in ordered]
    if wrong := [part.recording for part, row in zip(ordered, rows, strict=True) if row.shape[1] != len(names)]:
        raise InputError(f"samples: recording {wrong[0]} does not have the {len(names)} features {', '.join(names[:3])} ...")
    counts = [len(row) for row in rows]

    def column(values: Sequence[str]) -> NDArray[np.str_]:
        return np.repeat(np.array(values, dtype=str), counts)

    columns = {name: column([getattr(part, name) for part in ordered]) for name in ("recording", "stratum", "domain", "label")}
    return Samples(tuple(names), np.concatenate(rows), source=column([part.source or part.recording for part in ordered]), **columns)


def join(*samples: Samples) -> Samples:
    """Rows of several sets with the same features, simulated and measured ones for example."""
    if len({one.names for one in samples}) != 1:
        raise InputError("samples: sets with different features cannot be joined")
    columns = {name: np.concatenate([getattr(one, name) for one in samples]) for name in samples[0]._columns()}
    together = Samples(samples[0].names, np.concatenate([one.values for one in samples]), **columns)
    return together.take(np.argsort(together.recording, kind="stable"))
