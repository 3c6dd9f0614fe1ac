"""Object and material recognition from a moving radar at three levels of supervision, in both rooms (the paper's Table 3 and bar figure).

The option `supervision` sets the highest level in the table: label_free gives the rows of level (i), calibrated adds level (ii), few_shot
adds level (iii) on drives. The table labelled_probe has level (iii) on the turntable. The chance level is one over the number of classes,
or the share of the largest class in rows where the paper uses this share. Material classes differ much in size, so the claim about
materials is judged by balanced accuracy. As a control, a random forest is trained on simulated recordings with shuffled class labels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments import draws
from experiments.campaign.cases import REFLECTOR
from experiments.campaign.frame import shared
from experiments.campaign.schedule import RecordingTask
from experiments.campaign.source import RecordingSource
from experiments.claims import Claim
from experiments.recognition import transfer
from experiments.recognition.figures import bars, confusions
from experiments.recognition.protocol import MATERIAL, NO_SESSIONS, SHAPE, RecognitionRows, at_chance, correct
from radartwin.config.config import Config
from radartwin.errors import InputError
from radartwin.io.progress import Progress
from radartwin.recognize.samples import join
from radartwin.recognize.score import majority_share, uniform_chance
from radartwin.recognize.split import Split, draw_shots, label_free, most_shots, shuffled
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

TABLE = Table(
    name="rover_recognition",
    title="Recognition by supervision level",
    caption="Random forests classify frames; a recording gets the majority label of its frames. Label-free: features are replaced "
    "by ranks within domain and distance. Calibrated: energy features are mapped by one unlabelled recording of the "
    "reflector, which is not scored. For material classes, chance is the share of the largest class (accuracy) or one third "
    "(balanced accuracy). Rows with an entry in the column 'truth' belong to a testbed "
    "whose objects equal the catalogue (paper profile).",
)

ROOMS, MOTIONS = ("squash_court", "atrium"), ("lateral", "depth")
PAPER_ROOM = "squash_court"
TRAINED, RAW = "trained on simulation", "raw signatures"
# The paper's Table 3 for the squash court: (motion, classes) -> accuracy (trained, raw).
PAPER = {
    ("lateral", "object"): ("0.23 +- 0.02", "0.09"),
    ("depth", "object"): ("0.13 +- 0.02", "0.04"),
    ("lateral", "shape"): ("0.65 +- 0.01", "0.55"),
    ("depth", "material"): ("0.51", "0.35"),
    ("lateral", "material"): ("0.48", "0.30"),
}


@dataclass(frozen=True, eq=False)
class Drives:
    """Drives of one room and motion: frames of both domains, and the objects (recordings,) predicted from raw range-time signatures."""

    room: str
    motion: str
    frames: transfer.Frames
    raw: NDArray

    @property
    def in_paper(self) -> bool:
        return self.room == PAPER_ROOM

    def case(self, level: str, classes: str, method: str) -> dict[str, Any]:
        return {"supervision": level, "room": self.room, "motion": self.motion, "classes": classes, "method": method}


@dataclass
class Shown:
    """Content of the figures: `bars` by group and method, and `panels` with (truth, prediction) of each confusion matrix."""

    bars: dict[str, dict[str, Mapping[str, Any]]] = field(default_factory=dict)
    panels: dict[str, tuple[NDArray, NDArray]] = field(default_factory=dict)


def recordings(config: Config, store: Store, progress: Progress) -> dict[str, RecordingTask]:
    own = [config, *draws.exact_objects(config)]
    return draws.recordings(own, lambda campaign: shared(campaign, MOTIONS), store, progress, rover=True)


def run(config: Config, store: Store, progress: Progress) -> Result:
    def scored(own: Config) -> Result:
        mode = config.supervision.mode if own is config else "label_free"  # the other levels are shown only for the configured testbed
        return draws.scored(own, store, progress, lambda campaign: score(own, campaign, progress, mode), rover=True)

    return draws.beside_exact_objects(config, scored, lambda row: row["classes"] == "object")


def score(config: Config, source: RecordingSource, progress: Progress, mode: str) -> Result:
    """Build the rows of the supervision levels up to `mode`. Raises InputError if the campaign has no measured drives."""
    rows, shown, used = RecognitionRows(config), Shown(), set()
    recorded = {case.room for case in source.cases("measured") if case.motion in MOTIONS}
    if not recorded:
        raise InputError("the campaign has no measured drives; add objects to profile.campaign.rover_objects or record drives")
    for room in (room for room in ROOMS if room in recorded):
        for motion in MOTIONS:
            progress.say(f"{motion} drives in {room}")
            frames = transfer.read(source, room, motion)
            used |= set(frames.keys)
            drives = Drives(room, motion, frames, transfer.predict_from_signatures(source, room, motion))
            _add_label_free(rows, shown, drives)
            if mode != "label_free":
                _add_materials(rows, shown, drives, source)
            if mode == "few_shot" and motion == "lateral":
                _add_few_shot(rows, drives)
    classes = sorted({label for truth, _ in shown.panels.values() for label in truth})
    figures = {
        "rover_recognition": lambda: bars(shown.bars, "accuracy", "squash court", grey=RAW),
        "rover_confusion": lambda: confusions(shown.panels, classes),
    }
    metrics = {
        f"{r['room']}_{r['motion']}_object": r["value"]
        for r in rows
        if r["method"] == TRAINED and r["classes"] == "object" and r["supervision"] == "label_free"
    }
    return Result("rover_recognition", rows, figures, metrics, sorted(used))


def _add_label_free(rows: RecognitionRows, shown: Shown, drives: Drives) -> None:
    """Add the rows of supervision level (i), without class labels of measured recordings: object accuracy, shape accuracy in sideways
    ("lateral") drives, and the control.
    """
    frames, motion, in_paper = drives.frames, drives.motion, drives.in_paper
    recordings = frames.measured.per_recording()
    for classes, names in (("object", None), ("shape", SHAPE)) if motion == "lateral" else (("object", None),):
        split = transfer.ranked_split(frames, names)
        truth = recordings if names is None else recordings.relabelled(names)
        raw = drives.raw if names is None else np.array([names[label] for label in drives.raw])
        chance = uniform_chance(truth) if names is None else majority_share(truth)
        predictions = transfer.predict(rows.config, split)
        hits, raw_hits = correct(predictions, truth.label), correct([raw], truth.label)
        ours, theirs = PAPER.get((motion, classes), ("", "")) if in_paper else ("", "")
        text = ""
        if motion == "lateral" and (in_paper or names is None):
            text = "label-free transfer is above chance" if in_paper else "label-free transfer stays at chance"
        # In the paper, recognition does not transfer in the other room.
        claim = Claim(text, ours) if in_paper else at_chance(text, ours, chance)
        case, answers = drives.case("label_free", classes, TRAINED), None if names is None else predictions
        row = rows.share(case, hits, truth, frames.keys, chance, claim, answers=answers)
        claim = at_chance("matching raw signatures fails" if in_paper and names is None else "", theirs, chance)
        case, answers = drives.case("label_free", classes, RAW), None if names is None else [raw]
        other = rows.share(case, raw_hits, truth, frames.keys, chance, replace(claim, untestable=NO_SESSIONS), answers=answers)
        claim = Claim("training on the twin beats matching its raw signatures")
        rows.gain(drives.case("label_free", classes, f"{TRAINED} - {RAW}"), hits, raw_hits, truth, frames.keys, claim)
        if in_paper:
            shown.bars[f"{motion}\n{classes}"] = {RAW: other, TRAINED: row}
        if names is None:
            if in_paper:
                shown.panels[f"{motion} drive"] = (truth.label, predictions[0])
            _add_control(rows, drives, split, chance)


def _add_control(rows: RecognitionRows, drives: Drives, split: Split, chance: float) -> None:
    """Add the control: the same random forests, trained on simulated recordings with permuted class labels."""
    truth = drives.frames.measured.per_recording()
    predictions = transfer.predict(rows.config, split, lambda one, seed: label_free(shuffled(one.train, seed), one.test))
    shares = correct(predictions, truth.label).mean(axis=1)
    rows.control(drives.case("label_free", "object", "simulated labels shuffled"), shares, truth, drives.frames.keys, chance)


def _add_materials(rows: RecognitionRows, shown: Shown, drives: Drives, source: RecordingSource) -> None:
    """Add the rows of supervision level (ii): accuracy of material classes with and without calibration by one reflector recording,
    which is not scored.
    """
    frames, motion, in_paper = drives.frames, drives.motion, drives.in_paper
    ours, theirs = PAPER[motion, "material"] if in_paper else ("", "")
    recordings = frames.measured.per_recording()
    scored = recordings.label != REFLECTOR
    truth = recordings.take(scored).relabelled(MATERIAL)

    def predict(mapped: bool) -> list[NDArray]:
        split = transfer.calibrated_split(source, frames, drives.room, motion, MATERIAL, mapped)
        return transfer.predict(rows.config, split)

    methods = {
        RAW: ([np.array([MATERIAL[label] for label in drives.raw[scored]])], theirs),
        "without calibration": (predict(mapped=False), ""),
        TRAINED: (predict(mapped=True), ours),
    }
    for method, (predictions, paper) in methods.items():
        hits = correct(predictions, truth.label)
        case = drives.case("calibrated", "material", method)
        plain = rows.share(case, hits, truth, frames.keys, majority_share(truth), Claim(paper=paper), answers=predictions)
        claim = Claim("one reflector recording lifts material above chance") if method == TRAINED else Claim()
        rows.share(case, hits, truth, frames.keys, 1 / len(truth.classes), claim, balanced=True, answers=predictions)
        if in_paper and method != "without calibration":
            shown.bars.setdefault(f"{motion}\nmaterial", {})[method] = plain


def _add_few_shot(rows: RecognitionRows, drives: Drives) -> None:
    """Add the rows of supervision level (iii) on the rover: train on simulated frames and a few labelled measured recordings, if
    there are enough recordings.
    """
    supervision, frames = rows.config.supervision, drives.frames
    simulated, measured = transfer.ranked(frames.simulated), transfer.ranked(frames.measured)
    recordings = frames.measured.per_recording()
    shots = supervision.shots
    if most_shots(recordings) < shots:
        return
    hits = np.full((supervision.seeds, len(recordings)), np.nan)
    for number in range(supervision.seeds):
        known, rest = draw_shots(measured, shots, rows.config.seed + number)
        split = Split("few_shot", join(simulated, known), rest, shots)
        predictions = transfer.forest(split, rows.config.seed + number, supervision.trees)
        truth = rest.per_recording()
        hits[number, np.isin(recordings.recording, truth.recording)] = predictions == truth.label
    scored = ~np.isnan(hits).all(axis=0)
    case = drives.case("few_shot", "object", f"trained on simulation and {shots} recordings per class")
    rows.share(case, hits[:, scored], recordings.take(scored), frames.keys, uniform_chance(recordings))
