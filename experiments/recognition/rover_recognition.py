"""Object and material recognition from a moving radar at three levels of supervision, in both rooms (the paper's Table 3 and bar figure).

The option `supervision` sets the highest level: label_free, calibrated, or few_shot (on drives; labelled_probe has it on the turntable).
Chance is one over the number of classes, or the share of the largest class where the paper uses it. Material classes differ much in size,
so their claim is judged by balanced accuracy. As a control, a forest is trained with shuffled class labels.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from experiments.campaign.cases import REFLECTOR
from experiments.campaign.frame import Frame
from experiments.cells import Cell
from experiments.draws import Query
from experiments.framed import Figures, framed
from experiments.recognition import transfer
from experiments.recognition.plots import bars, confusions, grouped
from experiments.recognition.protocol import MATERIAL, NO_SESSIONS, SHAPE, Scored, at_chance, correct, seeds
from experiments.verdicts import NONE, Claim, Row
from radartwin.config.config import Config
from radartwin.recognize.probes import forest
from radartwin.recognize.samples import join
from radartwin.recognize.score import majority_share, uniform_chance
from radartwin.recognize.split import LEVELS, Split, draw_shots, label_free, most_shots, shuffled
from radartwin.runs.experiment import Table

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


def query(config: Config) -> Query:
    return Query(config, MOTIONS, several=True, exact=True)


def cells(config: Config, frame: Frame) -> Iterator[Cell]:
    """Declare the levels up to the configured one; a testbed whose objects equal the catalogue has the first level."""
    levels = LEVELS[: LEVELS.index(config.supervision.mode) + 1] if (frame.truth == "").all() else LEVELS[:1]
    for room in (room for room in ROOMS if room in set(frame.room)):
        for motion in MOTIONS:
            drives = frame[(frame.room == room) & (frame.motion == motion)]
            case, raw = {"room": room, "motion": motion}, transfer.predict_from_signatures(drives)
            yield from _label_free(config, drives, raw, case)
            if "calibrated" in levels:
                yield from _materials(config, drives, raw, case)
            if "few_shot" in levels and motion == "lateral":
                yield from _few_shot(config, drives, case)


def _label_free(config: Config, drives: Frame, raw: NDArray, place: Mapping[str, str]) -> Iterator[Cell]:
    """Declare level (i), without labels: objects, shapes (lateral drives), and the control whose forest learns permuted labels."""
    motion, in_paper = place["motion"], place["room"] == PAPER_ROOM
    for classes, names in (("object", None), ("shape", SHAPE)) if motion == "lateral" else (("object", None),):
        case = {"supervision": "label_free", **place, "classes": classes}
        split = transfer.ranked_split(drives, names)
        truth = split.test.per_recording()
        answers = {TRAINED: transfer.predict(config, split), RAW: [raw if names is None else np.array([names[label] for label in raw])]}
        hits = {method: correct(predictions, truth.label) for method, predictions in answers.items()}
        chance = uniform_chance(truth) if names is None else majority_share(truth)
        paper_trained, paper_raw = PAPER.get((motion, classes), ("", "")) if in_paper else ("", "")
        text = ""
        if motion == "lateral" and (in_paper or names is None):
            text = "label-free transfer is above chance" if in_paper else "label-free transfer stays at chance"
        # In the paper, recognition does not transfer in the other room.
        claims = {TRAINED: Claim(text, paper_trained) if in_paper else at_chance(text, paper_trained, chance)}
        fails = at_chance("matching raw signatures fails" if in_paper and names is None else "", paper_raw, chance)
        claims[RAW] = replace(fails, untestable=NO_SESSIONS)
        scored, gain = Scored(config, truth, drives, chance), Claim("training on the twin beats matching its raw signatures")
        panels = {TRAINED: (f"{motion} drive", truth.label, answers[TRAINED][0])} if in_paper and names is None else {}
        yield from scored.compared(case, hits, {(TRAINED, RAW): gain}, claims, answers=None if names is None else answers, panels=panels)
        if names is None:
            permuted = transfer.predict(config, split, lambda original, seed: label_free(shuffled(original.train, seed), original.test))
            yield scored.control({**case, "method": "simulated labels shuffled"}, correct(permuted, truth.label).mean(axis=1))


def _materials(config: Config, drives: Frame, raw: NDArray, place: Mapping[str, str]) -> Iterator[Cell]:
    """Declare level (ii): material classes with and without calibration by one reflector recording, which is not scored."""
    paper_trained, paper_raw = PAPER[place["motion"], "material"] if place["room"] == PAPER_ROOM else ("", "")
    plain, mapped = (transfer.calibrated_split(drives, MATERIAL, mapped) for mapped in (False, True))
    truth = plain.test.per_recording()
    of_raw = np.array([MATERIAL[name] for name in raw[transfer.of_domains(drives)[1].per_recording().label != REFLECTOR]])
    methods = {
        RAW: ([of_raw], paper_raw),
        "without calibration": (transfer.predict(config, plain), ""),
        TRAINED: (transfer.predict(config, mapped), paper_trained),
    }
    for method, (answers, paper) in methods.items():
        case, hits = {"supervision": "calibrated", **place, "classes": "material", "method": method}, correct(answers, truth.label)
        yield Scored(config, truth, drives, majority_share(truth)).accuracy(case, hits, Claim(paper=paper), answers=answers)
        claim = Claim("one reflector recording lifts material above chance") if method == TRAINED else NONE
        yield Scored(config, truth, drives, 1 / len(truth.classes)).accuracy(case, hits, claim, balanced=True, answers=answers)


def _few_shot(config: Config, drives: Frame, place: Mapping[str, str]) -> Iterator[Cell]:
    """Declare level (iii) on the rover: train on simulated frames and a few labelled measured recordings, if there are enough."""
    supervision, (simulated, measured) = config.supervision, map(transfer.ranked, transfer.of_domains(drives))
    recordings, shots = measured.per_recording(), config.supervision.shots
    if most_shots(recordings) < shots:
        return
    hits = np.full((supervision.seeds, len(recordings)), np.nan)
    for number, seed in enumerate(seeds(config)):
        known, rest = draw_shots(measured, shots, seed)
        truth = rest.per_recording()
        predicted = forest(Split("few_shot", join(simulated, known), rest, shots), seed, supervision.trees)
        hits[number, np.isin(recordings.recording, truth.recording)] = predicted == truth.label
    case = {"supervision": "few_shot", **place, "classes": "object", "method": f"trained on simulation and {shots} recordings per class"}
    yield Scored(config, recordings, drives, uniform_chance(recordings)).accuracy(case, hits)


def _exact(row: Row) -> bool:
    return (row["supervision"], row["classes"]) == ("label_free", "object")


def _figures(rows: list[Row], first: Frame) -> Figures:
    in_paper = [row for row in rows if row["room"] == PAPER_ROOM and row["method"] in (RAW, TRAINED)]
    groups = grouped(in_paper, lambda row: f"{row['motion']}\n{row['classes']}")
    return {TABLE.name: lambda: bars(groups, "accuracy", "squash court", grey=RAW), "rover_confusion": lambda: confusions(rows)}


def _metrics(rows: list[Row]) -> dict[str, float]:
    kept = [row for row in rows if _exact(row) and row["method"] == TRAINED and not row.get("truth")]
    return {f"{row['room']}_{row['motion']}_object": row["value"] for row in kept}


run, recordings, score = framed(TABLE, query, cells, _figures, _metrics, exact=_exact)
