"""Simulate recordings with any set of gaps (differences between virtual measurement and simulation), and compute the losses of this set.

A coalition is a set of gaps that are on. The gaps `geometry` and `labels` change the simulation, `hardware` changes the measurement and
adds receiver noise to the simulation (without it neither domain has noise), and all other gaps change only the measurement. A "side" is one
domain with the gaps that change it; about twenty sides are enough for the losses of dozens of coalitions. The gap `contents` does not
change an object without liquid (radartwin/testbed/variation.py), which is recorded only with `contents` on.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from experiments.campaign.campaign import Campaign, joined, load_clean, make_together
from experiments.campaign.cases import Case
from experiments.campaign.frame import Frame
from experiments.campaign.schedule import RecordingTask
from experiments.gaps import case_set
from experiments.gaps.shapley import Coalition
from experiments.interface import Config, Progress, Store
from experiments.recognition import readings, transfer
from experiments.recognition.protocol import correct
from experiments.recognition.readings import recording_name
from radartwin.config.materials import TrueMaterials, VlmMaterials
from radartwin.features import families
from radartwin.features.log import Log
from radartwin.features.processed import Processed, process
from radartwin.features.profile import profile_correlation
from radartwin.recognize.samples import Samples, join
from radartwin.recognize.split import label_free
from radartwin.scene.objects.catalogue import catalogue

LABELS = "labels"  # a gap: the simulated room has materials of the configured source instead of the true materials
TWIN = frozenset(("geometry", LABELS, "hardware"))  # gaps that change how the simulated recordings are computed or read
TESTBED = tuple(gap for gap in case_set.GAPS if gap != "geometry")
FEATURES = "rotation"
# The angular extent is left out of the feature error. At 1 m all objects are narrower than the array's beam, so the standard deviation of
# the extent over objects is only 0.0015 rad. Channel mismatch alone changes the extent by 27 such standard deviations. This change
# dominated the feature error in the first run.
WITHOUT = ("extent",)
FRAMES = 16  # frames per revolution; six harmonics need thirteen frames
ERROR, PROFILE, RECOGNITION = "feature error", "range-profile correlation lost", "recognition lost"
SCORES = (ERROR, PROFILE, RECOGNITION)
Losses = dict[str, dict[Coalition, NDArray[np.float64]]]  # [score][coalition]: losses (recordings,)
Side = tuple[str, Coalition]  # domain, and the gaps that change it


def cases(objects: Iterable[str]) -> list[Case]:
    """Return the turntable cases of the objects at 1 m in the laboratory, in the order in which the classifier returns predictions."""
    return sorted((Case(name, "lab", "turntable", 1.0) for name in objects), key=lambda case: recording_name("measured", case))


def configured(config: Config, on: Collection[str]) -> Config:
    """Return the configuration with only the gaps `on`, and one turntable revolution of FRAMES frames. Surfaces of the exact room that are
    not in the scan, which the recorded answers describe, become plasterboard.
    """
    strengths = {gap: 1.0 for gap in on if gap != LABELS}
    materials = config.materials if LABELS in on else TrueMaterials()
    if isinstance(materials, VlmMaterials) and "geometry" not in on and materials.missing is None:
        materials = replace(materials, missing="plasterboard")
    return case_set.with_gaps(config, strengths, materials, frames_per_turn=FRAMES, turns=1)


def side(domain: str, on: Coalition) -> Coalition:
    """Return the gaps of a coalition that change one domain (measured or simulated)."""
    return on & TWIN if domain == "twin" else on & set(TESTBED)


class Sides:
    """Simulate the recordings of the sides that coalitions need, and compute their features; each side is read once."""

    def __init__(self, config: Config, store: Store, progress: Progress, recorded: Sequence[Case]):
        self.config, self.store, self.progress, self.cases = config, store, progress, list(recorded)
        self._read: dict[Side, Frame] = {}

    def prepare(self, sets_of_gaps: Iterable[Coalition]) -> None:
        """Simulate and read the sides of these coalitions."""
        ordered = sides_of(sets_of_gaps)
        make_together(self.missing(ordered), self.config.jobs, self.progress)
        for domain, on in self.progress.over(ordered, "sides"):
            self.read(domain, on)

    def missing(self, sides: Iterable[Side]) -> dict[str, RecordingTask]:
        """Return {store key: task} of the missing recordings of these sides (domains with their gaps)."""
        return joined(
            self._campaign(on, case).missing([(domain, case)], clean=not _received(domain, on))
            for domain, on in sides
            for case in self.cases
        )

    def read(self, domain: str, on: Coalition) -> Frame:
        """Return the frame of one domain (measured or simulated) with the gaps `on`, in the order of the cases: the store `key` before
        receiver effects, the compared features `vector`, the mean power `profile` (B,) over `range_m`, and those of `readings.frames`.
        """
        if (domain, on) not in self._read:
            rows = []
            for case in self.cases:
                (key, processed), log = self.processed(domain, on, case), self.log(domain, case)
                names, frames = families.frames(processed, log, FEATURES)
                compared = {"vector": families.vector(processed, log, FEATURES, WITHOUT)[1], "range_m": processed.range_m}
                compared["profile"] = processed.power.mean(axis=0, dtype=np.float64)
                rows.append(asdict(case) | {"domain": domain, "key": key, "frames": frames, "frame_features": np.array(names)} | compared)
            self._read[domain, on] = pd.DataFrame(rows)
        return self._read[domain, on]

    def processed(self, domain: str, on: Coalition, case: Case) -> tuple[str, Processed]:
        """Return (store key before receiver effects, processed recording) of a case; a missing recording is simulated."""
        campaign = self._campaign(on, case)
        product = campaign.clean(domain, case)
        if _received(domain, on):
            return product.key, campaign.processed(domain, case)[1]
        return product.key, process(load_clean(product), doppler=False)

    def log(self, domain: str, case: Case) -> Log:
        return self._campaign(frozenset(), case).log(case, domain)

    def _campaign(self, on: Coalition, case: Case) -> Campaign:
        return Campaign(configured(self.config, _switched(on, case)), self.store, self.progress)

    @property
    def keys(self) -> list[str]:
        """Store keys of all recordings whose features were computed."""
        return sorted({key for read in self._read.values() for key in read.key})


def sides_of(sets_of_gaps: Iterable[Coalition]) -> list[Side]:
    """Return the sides (measured or simulated recordings with their gaps) of these coalitions."""
    wanted = {(domain, side(domain, on)) for on in sets_of_gaps for domain in ("twin", "measured")}
    return sorted(wanted, key=lambda pair: (pair[0], sorted(pair[1])))


def _switched(on: Coalition, case: Case) -> Coalition:
    """Return the gaps that are on when an object is recorded. An object without liquid is always recorded with the gap `contents` on."""
    return on if catalogue()[case.object].contents is not None else on | {"contents"}


def _received(domain: str, on: Coalition) -> bool:
    """Return whether the features of a side are computed from recordings with receiver effects."""
    return domain == "measured" or "hardware" in on


def losses(config: Config, sides: Sides, sets_of_gaps: Iterable[Coalition]) -> Losses:
    """Compute three losses per recording for each coalition of gaps, as [loss][coalition] -> array (recordings,).

    ERROR is the rms over features of simulated minus measured value, in standard deviations of the simulation without gaps. PROFILE is one
    minus the correlation of the mean range profiles in decibels. RECOGNITION is the share of seeds for which a forest, trained on ranks of
    simulated frames, is wrong.
    """
    wanted = list(dict.fromkeys(sets_of_gaps))
    sides.prepare(wanted)
    ideal = np.stack(list(sides.read("twin", frozenset()).vector))
    spread = ideal.std(axis=0)
    varies = spread > 1e-9 * np.abs(ideal).max(axis=0, initial=0.0)
    by_score: Losses = {score: {} for score in SCORES}
    for on in wanted:
        twin, measured = (sides.read(domain, side(domain, on)) for domain in ("twin", "measured"))
        difference = np.stack(list(twin.vector - measured.vector))[:, varies] / spread[varies]
        by_score[ERROR][on] = np.sqrt((difference**2).mean(axis=1))
        pairs = zip(twin.profile, measured.profile, twin.range_m, strict=True)
        by_score[PROFILE][on] = np.array([1 - profile_correlation(*pair, "db") for pair in pairs])
    for learned in dict.fromkeys(side("twin", on) for on in wanted):
        scored = [on for on in wanted if side("twin", on) == learned]
        measured = {on: readings.frames(sides.read("measured", side("measured", on))) for on in scored}
        for on, share in recognised_shares(config, readings.frames(sides.read("twin", learned)), measured).items():
            by_score[RECOGNITION][on] = 1 - share
    return by_score


def recognised_shares(config: Config, simulated: Samples, measured: Mapping[Coalition, Samples]) -> dict[Coalition, NDArray[np.float64]]:
    """Return, for each coalition, the share of seeds (recordings,) in which forests trained once on simulated frames classify the
    recordings of the testbed correctly. The features are ranks within each set of gaps.
    """
    renamed = []
    for number, samples in enumerate(map(transfer.ranked, measured.values())):  # new names of the recordings sort by the number
        names = {column: np.char.add(f"{number:05d} ", getattr(samples, column)) for column in ("recording", "source")}
        renamed.append(replace(samples, **names))
    split = label_free(transfer.ranked(simulated), join(*renamed))
    hits = correct(transfer.predict(config, split), split.test.per_recording().label).mean(axis=0)
    return dict(zip(measured, np.split(hits, len(renamed)), strict=True))
