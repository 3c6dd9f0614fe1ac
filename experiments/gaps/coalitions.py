"""Recordings of testbed and twin under any set of gaps, and the losses that the set brings: what `gap_attribution` shares out.

A set of gaps decides both sides: `geometry` and `labels` the twin, `hardware` the testbed and whether the twin is read with its receiver's
noise (without it neither side has any), all others the testbed. So twenty sides serve dozens of sets. What holds no liquid is the same
whatever `contents` is (radartwin/testbed/variation.py), and is recorded with it on alone.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.campaign.campaign import Campaign, load_clean, make_together
from experiments.campaign.cases import Case
from experiments.campaign.schedule import RecordingTask
from experiments.gaps.shapley import Coalition
from experiments.recognition import readings, transfer
from experiments.recognition.protocol import right
from experiments.recognition.readings import recording_name
from radartwin.config.config import Config
from radartwin.config.materials import TrueMaterials
from radartwin.config.study import GapConfig
from radartwin.features import sets
from radartwin.features.processed import Processed, process
from radartwin.features.profile import profile_correlation
from radartwin.io.progress import Progress
from radartwin.recognize.samples import Samples, join
from radartwin.scene.objects.catalogue import catalogue
from radartwin.store.products import Store

LABELS = "labels"  # of the twin's materials: the configured source's for the true ones
TWIN = frozenset(("geometry", LABELS, "hardware"))  # what decides the twin's side; hardware, whether its noise is read too
TESTBED = tuple(f.name for f in fields(GapConfig) if f.name != "geometry")
GAPS = ("geometry", LABELS, *TESTBED)
# What the testbed's room must be set up anew for
SETS_UP = ("clutter", "solver", "materials", "roughness", "contents", "hardware")
FEATURES = "rotation"
# Of the feature error: all that is seen at 1 m is narrower than the array's beam, so that its extent spreads by 0.0015 rad between objects
# and the channels' mismatch alone moves it by 27 spreads, which outweighed all else (seen in the first run)
UNSPREAD = ("extent",)
FRAMES = 16  # of a turn: six harmonics need thirteen
ERROR, PROFILE, RECOGNITION = "feature error", "range-profile correlation lost", "recognition lost"
SCORES = (ERROR, PROFILE, RECOGNITION)
Losses = dict[str, dict[Coalition, NDArray[np.float64]]]  # by score and set of gaps: (recordings,)


def cases(objects: Iterable[str]) -> list[Case]:
    """Turntables at 1 m in the laboratory, in the order in which recognition answers."""
    return sorted((Case(name, "lab", "turntable", 1.0) for name in objects), key=lambda case: recording_name("measured", case))


def configured(config: Config, on: Collection[str]) -> Config:
    """The configuration under these gaps, all others off: one turn of FRAMES frames."""
    gap = GapConfig(**{f.name: float(f.name in on) for f in fields(GapConfig)})
    campaign = replace(config.profile.campaign, frames_per_turn=FRAMES, turns=1)
    materials = config.materials if LABELS in on else TrueMaterials()
    return replace(
        config, materials=materials, measured=replace(config.measured, gap=gap), profile=replace(config.profile, campaign=campaign)
    )


def side(domain: str, on: Coalition) -> Coalition:
    """What of a set of gaps decides one domain."""
    return on & TWIN if domain == "twin" else on & set(TESTBED)


@dataclass(frozen=True, eq=False)
class Read:
    """One domain's recordings under one side, in the order of the cases.

    Attributes:
        keys: of them. values: (N, features), those of the feature error. profiles: N of (B,) mean power over range_m (B,).
        frames: rows per frame.
    """

    keys: tuple[str, ...]
    values: NDArray[np.float64]
    profiles: Sequence[NDArray[np.float64]]
    range_m: NDArray[np.float64]
    frames: Samples


class Sides:
    """Every side that sets of gaps need, each read once; what is not in the store is made."""

    def __init__(self, config: Config, store: Store, progress: Progress, some: Sequence[Case]):
        self.config, self.store, self.progress, self.cases = config, store, progress, list(some)
        self._read: dict[tuple[str, Coalition], Read] = {}

    def prepare(self, sets_of_gaps: Iterable[Coalition]) -> None:
        """Make and read what these sets need; what shares a room is made together."""
        wanted = {(domain, side(domain, on)) for on in sets_of_gaps for domain in ("twin", "measured")}
        ordered = sorted(wanted, key=lambda one: (one[0], _setup(*one), sorted(one[1])))
        self.make(ordered)
        for domain, on in self.progress.over(ordered, "sides"):
            self.read(domain, on)

    def make(self, some: Sequence[tuple[str, Coalition]]) -> None:
        """Make what is missing of these sides, by several processes."""
        missing: dict[str, RecordingTask] = {}
        for domain, on in some:
            for case in self.cases:
                setup, clean = _setup(domain, _switched(on, case)), not _received(domain, on)
                for key, one in self._campaign(on, case).missing([(domain, case)], clean=clean, setup=setup).items():
                    missing[key] = replace(one, clean=clean and missing.get(key, one).clean)
        make_together(missing, self.progress)

    def read(self, domain: str, on: Coalition) -> Read:
        """One side."""
        if (domain, on) not in self._read:
            view = _Side(self, domain, on)
            found = [view.processed(domain, case) for case in self.cases]
            values = [
                sets.vector(one, self.log(domain, case), FEATURES, UNSPREAD)[1] for case, (_, one) in zip(self.cases, found, strict=True)
            ]
            self._read[domain, on] = Read(
                keys=tuple(key for key, _ in found),
                values=np.stack(values).astype(np.float64),
                profiles=[one.power.mean(axis=0, dtype=np.float64) for _, one in found],
                range_m=found[0][1].range_m,
                frames=readings.frames(view, domain, self.cases, FEATURES).samples,
            )
        return self._read[domain, on]

    def processed(self, domain: str, on: Coalition, case: Case) -> tuple[str, Processed]:
        """(key without the receiver, what features are read from) of one recording, made now unless it is in the store."""
        campaign = self._campaign(on, case)
        product = campaign.clean(domain, case)
        if _received(domain, on):
            return product.key, campaign.processed(domain, case)[1]
        return product.key, process(load_clean(product), doppler=False)

    def log(self, domain: str, case: Case) -> Any:
        """Its nominal course."""
        return self._campaign(frozenset(), case).log(case, domain)

    def _campaign(self, on: Coalition, case: Case) -> Campaign:
        return Campaign(configured(self.config, _switched(on, case)), self.store, self.progress)

    @property
    def keys(self) -> list[str]:
        """Of everything that was read."""
        return sorted({key for read in self._read.values() for key in read.keys})


def _switched(on: Coalition, case: Case) -> Coalition:
    """The gaps that are on: what holds no liquid is recorded with `contents` alone."""
    return on if catalogue()[case.object].contents is not None else on | {"contents"}


def _received(domain: str, on: Coalition) -> bool:
    """Whether a side is read with its receiver's noise."""
    return domain == "measured" or "hardware" in on


def _setup(domain: str, on: Coalition) -> str:
    """What a side's room is set up for."""
    return " ".join(gap for gap in (SETS_UP if domain == "measured" else ("geometry", LABELS)) if gap in on) or "as it is"


class _Side:
    """A campaign (experiments.recognition.readings) of one domain's recordings under one side."""

    def __init__(self, of: Sides, domain: str, on: Coalition):
        self._of, self._on = of, on
        self._made = {(domain, case): of.processed(domain, on, case) for case in of.cases}

    def cases(self, domain: Any, **chosen: Any) -> Sequence[Case]:
        return self._of.cases

    def prepare(self, wanted: Any, materials: Any = None) -> None: ...

    def processed(self, domain: Any, case: Any, materials: Any = None) -> tuple[str, Processed]:
        return self._made[domain, case]

    def log(self, case: Any, domain: str = "measured") -> Any:
        return self._of.log(domain, case)


def losses(config: Config, sides: Sides, sets_of_gaps: Iterable[Coalition]) -> Losses:
    """What each set of gaps costs, recording by recording.

    ERROR: root mean square over features (but for UNSPREAD) of simulated less measured, in units of each feature's standard deviation over
    the twin's recordings without any gap. PROFILE: one less the correlation of mean range profiles in decibels, 0.3 to 5.5 m. RECOGNITION:
    share of seeds in which a forest that learned the twin's frames tells a measured recording wrongly (ranks within domain and distance).
    """
    wanted = list(dict.fromkeys(sets_of_gaps))
    sides.prepare(wanted)
    ideal = sides.read("twin", frozenset()).values
    spread = ideal.std(axis=0)
    tells = spread > 1e-9 * np.abs(ideal).max(axis=0, initial=0.0)
    found: Losses = {score: {} for score in SCORES}
    for on in wanted:
        twin, measured = (sides.read(domain, side(domain, on)) for domain in ("twin", "measured"))
        apart = (twin.values - measured.values)[:, tells] / spread[tells]
        found[ERROR][on] = np.sqrt((apart**2).mean(axis=1))
        pairs = zip(twin.profiles, measured.profiles, strict=True)
        found[PROFILE][on] = np.array([1 - profile_correlation(one, other, twin.range_m, "db") for one, other in pairs])
    for learned in dict.fromkeys(side("twin", on) for on in wanted):
        scored = [on for on in wanted if side("twin", on) == learned]
        measured = {on: sides.read("measured", side("measured", on)).frames for on in scored}
        for on, share in told(config, sides.read("twin", learned).frames, measured).items():
            found[RECOGNITION][on] = 1 - share
    return found


def told(config: Config, simulated: Samples, measured: Mapping[Coalition, Samples]) -> dict[Coalition, NDArray[np.float64]]:
    """Share of seeds in which each recording is told, (recordings,), by forests that learned the simulated frames.

    Sets of measured recordings are ranked each by itself, and answered by the same forests.
    """
    apart = [_renamed(transfer.ranked(samples), number) for number, samples in enumerate(measured.values())]
    split = transfer.label_free(transfer.ranked(simulated), join(*apart))
    hits = right(transfer.answers(config, split), split.test.per_recording().label).mean(axis=0)
    return dict(zip(measured, np.split(hits, len(apart)), strict=True))


def _renamed(samples: Samples, number: int) -> Samples:
    """The same rows with names that sort by `number`."""
    names = {column: np.char.add(f"{number:05d} ", getattr(samples, column)) for column in ("recording", "source")}
    return replace(samples, **names)
