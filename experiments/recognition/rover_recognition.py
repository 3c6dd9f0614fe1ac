"""Recognition from a moving radar at three levels of supervision, in both rooms (the paper's Table 3 and its bar figure).

`supervision` says how much is known at most: label_free gives the rows of level (i), calibrated adds level (ii), few_shot level (iii).
Baselines are counted, not quoted: chance is one over the classes, or the share of the majority where the paper takes that. Material classes
are of very different size, so the claim about them is judged by balanced accuracy. Control: a forest on shuffled simulated labels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.recognition import labelled_probe, transfer
from experiments.recognition.figures import bars, confusions
from experiments.recognition.protocol import MATERIAL, SHAPE, Rows, encoders, right
from experiments.recognition.readings import Campaign
from radartwin.config.config import Config
from radartwin.errors import InputError
from radartwin.io.progress import Progress
from radartwin.recognize.probes import leave_one_out_centroid
from radartwin.recognize.samples import Samples, join
from radartwin.recognize.score import majority_share, uniform_chance
from radartwin.recognize.split import Split, draw_shots, label_free, most_shots, shuffled
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

TABLE = Table(
    name="rover_recognition",
    title="Recognition by supervision level",
    caption="Random forests classify frames; a recording gets the majority label of its frames. Label-free: features are replaced by "
    "ranks within domain and distance. Calibrated: energy features are mapped by one unlabelled recording of the reflector, "
    "which is not scored. Chance for material is the share of the largest class for accuracy, and one third for balanced "
    "accuracy. p is the exact binomial probability over recordings.",
)

ROOMS, MOTIONS = ("squash_court", "atrium"), ("lateral", "depth")
PAPER_ROOM = "squash_court"
TRAINED, RAW = "trained on simulation", "raw signatures"
# Of the paper's Table 3, all in the squash court: (motion, classes) -> (trained, raw).
PAPER = {
    ("lateral", "object"): ("0.23 +- 0.02", "0.09"),
    ("depth", "object"): ("0.13 +- 0.02", "0.04"),
    ("lateral", "shape"): ("0.65 +- 0.01", "0.55"),
    ("depth", "material"): ("0.51", "0.35"),
    ("lateral", "material"): ("0.48", "0.30"),
}
Shown = dict[str, dict[str, Mapping[str, Any]]]


def run(config: Config, store: Store, progress: Progress) -> Result:
    from experiments.campaign.campaign import Campaign as Recorded

    return score(config, Recorded(config, store, progress), store, progress)


def score(config: Config, campaign: Campaign, store: Store, progress: Progress) -> Result:
    table, shown, used = Rows(config, []), {}, set()
    panels: dict[str, tuple[NDArray, NDArray]] = {}
    recorded = {case.room for case in campaign.cases("measured") if case.motion in MOTIONS}
    if not recorded:
        raise InputError("the campaign has no measured drives; nothing can be recognised")
    for room in (room for room in ROOMS if room in recorded):
        for motion in MOTIONS:
            progress.say(f"{motion} sweeps in {room}")
            frames = transfer.read(campaign, room, motion)
            used |= set(frames.keys)
            raw, _ = transfer.raw_answers(campaign, room, motion)
            label_free_rows(config, table, shown, frames, raw, room, motion, panels)
            if config.supervision.mode != "label_free":
                material_rows(config, table, shown, campaign, frames, raw, room, motion)
            if config.supervision.mode == "few_shot" and motion == "lateral":
                few_shot_row(config, table, frames, room)
    if config.supervision.mode == "few_shot":
        used |= set(turntable_rows(config, table, shown, campaign, store, progress))
    classes = sorted({label for truth, _ in panels.values() for label in truth})
    figures = {
        "rover_recognition": lambda: bars(shown, "accuracy", "squash court; turntable in the lab", grey=RAW),
        "rover_confusion": lambda: confusions(panels, classes),
    }
    metrics = {f"{room}_{motion}_object": found["value"] for (room, motion), found in _headline(table).items()}
    return Result(TABLE.name, table.rows, figures, metrics, sorted(used))


def _headline(table: Rows) -> dict[tuple[str, str], dict[str, Any]]:
    return {
        (r["room"], r["motion"]): r
        for r in table.rows
        if r["method"] == TRAINED and r["classes"] == "object" and r["level"] == "label_free"
    }


def _case(level: str, room: str, motion: str, classes: str, method: str) -> dict[str, Any]:
    return {"level": level, "room": room, "motion": motion, "classes": classes, "method": method}


def label_free_rows(
    config: Config, table: Rows, shown: Shown, frames: transfer.Frames, raw: NDArray, room: str, motion: str, panels: dict
) -> None:
    """Level (i): objects, their shape, and the control."""
    in_paper = room == PAPER_ROOM
    recordings = frames.measured.per_recording()
    for classes, names in (("object", None), ("shape", SHAPE)):
        if classes == "shape" and motion != "lateral":
            continue
        split = transfer.ranked_split(frames, names)
        truth = recordings if names is None else recordings.relabelled(names)
        told = raw if names is None else np.array([names[label] for label in raw])
        chance = uniform_chance(truth) if names is None else majority_share(truth)
        found = transfer.answers(config, split)
        hits, raw_hits = right(found, truth.label), right([told], truth.label)
        ours, theirs = PAPER.get((motion, classes), ("", "")) if in_paper else ("", "")
        claim = ""
        if motion == "lateral" and (in_paper or names is None):
            claim = "label-free transfer is above chance" if in_paper else "label-free transfer stays at chance"
        row = table.share(_case("label_free", room, motion, classes, TRAINED), hits, truth, frames.keys, chance, paper=ours, claim=claim)
        if claim and not in_paper:  # the paper's other room: the claim is that nothing transfers
            row["verdict"] = "holds" if row["low"] <= chance <= row["high"] else "fails"
        claim = "matching raw signatures fails" if in_paper and names is None else ""
        other = table.share(
            _case("label_free", room, motion, classes, RAW), raw_hits, truth, frames.keys, chance, paper=theirs, claim=claim
        )
        if claim:
            other["verdict"] = "holds" if other["low"] <= chance else "fails"
        table.gain(
            _case("label_free", room, motion, classes, f"{TRAINED} - {RAW}"), hits, raw_hits, truth, frames.keys,
            claim="training on the twin beats matching its raw signatures",
        )  # fmt: skip
        if in_paper:
            shown[f"{motion}\n{classes}"] = {RAW: other, TRAINED: row}
        if names is None:
            if in_paper:
                panels[f"{motion} sweep"] = (truth.label, found[0])
            control(config, table, split, truth, frames, room, motion, chance)


def control(
    config: Config, table: Rows, split: Split, truth: Samples, frames: transfer.Frames, room: str, motion: str, chance: float
) -> None:
    """The same forests on labels dealt anew over the simulated recordings."""
    found = transfer.answers(config, split, lambda one, seed: label_free(shuffled(one.train, seed), one.test))
    shares = right(found, truth.label).mean(axis=1)
    draws = np.unique(split.train.recording).size
    table.control(_case("label_free", room, motion, "object", "simulated labels shuffled"), shares, draws, truth, frames.keys, chance)


def material_rows(
    config: Config, table: Rows, shown: Shown, campaign: Campaign, frames: transfer.Frames, raw: NDArray, room: str, motion: str
) -> None:
    """Level (ii): material classes after one recording of the reflector, which is not scored; and without it."""
    in_paper = room == PAPER_ROOM
    ours, theirs = PAPER[motion, "material"] if in_paper else ("", "")
    recordings = frames.measured.per_recording()
    scored = recordings.label != transfer.CALIBRATION_OBJECT
    truth = recordings.take(scored).relabelled(MATERIAL)
    chance = 1 / len(truth.classes)
    methods = {
        RAW: [np.array([MATERIAL[label] for label in raw[scored]])],
        "without calibration": transfer.answers(config, transfer.calibrated_split(campaign, frames, room, motion, MATERIAL, mapped=False)),
        TRAINED: transfer.answers(config, transfer.calibrated_split(campaign, frames, room, motion, MATERIAL)),
    }
    for method, found in methods.items():
        hits = right(found, truth.label)
        case = _case("calibrated", room, motion, "material", method)
        paper = {TRAINED: ours, RAW: theirs}.get(method, "")
        plain = table.share(case, hits, truth, frames.keys, majority_share(truth), paper=paper)
        claim = "one reflector recording lifts material above chance" if method == TRAINED else ""
        table.share(case, hits, truth, frames.keys, chance, claim=claim, balanced=True)
        if in_paper and method != "without calibration":
            shown.setdefault(f"{motion}\nmaterial", {})[method] = plain


def few_shot_row(config: Config, table: Rows, frames: transfer.Frames, room: str) -> None:
    """Level (iii) on the rover: the twin's frames and those of a few labelled recordings; left out where there are too few."""
    simulated, measured = transfer.ranked(frames.simulated), transfer.ranked(frames.measured)
    recordings = frames.measured.per_recording()
    shots = config.supervision.shots
    if most_shots(recordings) < shots:
        return
    hits = np.full((config.supervision.seeds, len(recordings)), np.nan)
    for number in range(config.supervision.seeds):
        known, rest = draw_shots(measured, shots, config.seed + number)
        found = transfer.forest(Split("few_shot", join(simulated, known), rest, shots), config.seed + number, config.supervision.trees)
        truth = rest.per_recording()
        hits[number, np.isin(recordings.recording, truth.recording)] = found == truth.label
    scored = ~np.isnan(hits).all(axis=0)
    case = _case("few_shot", room, "lateral", "object", f"trained on simulation and {shots} recordings per class")
    table.share(case, hits[:, scored], recordings.take(scored), frames.keys, uniform_chance(recordings))


def turntable_rows(config: Config, table: Rows, shown: Shown, campaign: Campaign, store: Store, progress: Progress) -> tuple[str, ...]:
    """Level (iii) of the paper: the labelled probe on the turntable."""
    free = replace(config, supervision=replace(config.supervision, mode="label_free", shots=0))
    data = labelled_probe.gather_data(free, campaign, store, progress, {})
    keys = tuple(sorted({key for found in data.keys.values() for key in found}))
    measured = data.measured
    chance = uniform_chance(measured)
    trained = encoders(free, label_free(data.copies[labelled_probe.PRETRAINED], measured))
    hits = right([leave_one_out_centroid(encoder.embedded(measured)) for encoder in trained], measured.label)
    raw = right([leave_one_out_centroid(measured)], measured.label)
    case = _case("few_shot", "lab", "turntable", "object", TRAINED)
    row = table.share(case, hits, measured, keys, chance, paper="0.95 +- 0.02", claim="the labelled probe is above chance")
    other = table.share(case | {"method": labelled_probe.RAW}, raw, measured, keys, chance, paper="0.90")
    shown["turntable\nobject"] = {RAW: other, TRAINED: row}
    return keys
