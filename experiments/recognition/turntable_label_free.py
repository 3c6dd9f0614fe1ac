"""Turntable without measured labels: does training on simulation alone recognise the attributes of an object, or the object itself?

The encoder is trained on noisy copies of simulated features, and predicts the object whose text embedding is nearest to its output. Paper
(recognition, label-free): geometry 0.72 (largest class 0.58), material 0.72 (largest class 0.67); the object itself is not recognised.
"""

from collections.abc import Iterator
from dataclasses import replace

from experiments.campaign.frame import Frame
from experiments.cells import Cell
from experiments.draws import Query
from experiments.framed import framed
from experiments.recognition import protocol
from experiments.recognition.copies import Copied, with_copies
from experiments.recognition.plots import accuracy_bars
from experiments.recognition.protocol import GEOMETRY, MATERIAL, Scored, correct, settings
from experiments.recognition.readings import MOTION, revolutions
from experiments.recognition.transfer import ranked
from experiments.verdicts import NONE, Claim
from radartwin.config.config import Config
from radartwin.recognize.encoder import nearest_text
from radartwin.recognize.probes import transferred_probe
from radartwin.recognize.score import majority_share, uniform_chance
from radartwin.recognize.split import label_free
from radartwin.runs.experiment import Table

TABLE = Table(
    name="turntable_label_free",
    title="Recognition on the turntable without labels",
    caption="Rotation features are rank-normalised within each domain and distance. An encoder and a linear classifier (probe) on "
    "its embeddings are trained on the simulated features and applied to the measured ones. Chance for geometry and "
    "material is the share of the largest class. Rows with an entry in the column 'twin' belong to a simulation that knows only the "
    "surface of vessels, and those with an entry in the column 'truth' to a testbed whose objects equal the catalogue (paper profile).",
)

ENCODER, RANKS = "encoder on ranks", "ranks alone"
PAPER = {"geometry": "0.72", "material": "0.72"}


def query(config: Config) -> Query:
    return Query(config, (MOTION,), several=True, unknown=True, exact=True)


def cells(config: Config, copied: Copied, frame: Frame) -> Iterator[Cell]:
    """Declare the cells of one draw."""
    split = label_free(ranked(copied(config, frame)), ranked(revolutions(frame)))
    trained = protocol.encoders(config, split)
    for attribute, classes in (("geometry", GEOMETRY), ("material", MATERIAL)):
        embedded = [[encoder.embedded(rows.relabelled(classes)) for rows in (split.train, split.test)] for encoder in trained]
        plain = label_free(split.train.relabelled(classes), split.test.relabelled(classes))
        scored = Scored(config, plain.test, frame, majority_share(plain.test))
        claim = Claim(f"{attribute} transfers: above the majority", PAPER[attribute])
        for method, splits, claimed in ((RANKS, [plain], NONE), (ENCODER, [label_free(*pair) for pair in embedded], claim)):
            answers = [transferred_probe(method_split) for method_split in splits]
            case = {"supervision": "label_free", "attribute": attribute, "method": method}
            yield scored.accuracy(case, correct(answers, plain.test.label), claimed, answers=answers)
    texts, temperature = protocol.anchors(split.test.classes), settings(config).temperature
    names = [nearest_text(encoder, split.unlabelled, texts, temperature) for encoder in trained]
    panel, chance = ("nearest description", split.test.label, names[0]), uniform_chance(split.test)
    case = {"supervision": "label_free", "attribute": "identity", "method": ENCODER}
    claim = replace(protocol.at_chance("identity stays at chance", "does not transfer", chance), untestable=protocol.SAME_MODELS)
    yield Scored(config, split.test, frame, chance).accuracy(case, correct(names, split.test.label), claim, panel=panel)


run, recordings, score = framed(
    TABLE, query, cells, *accuracy_bars(TABLE.name, "attribute", grey=RANKS, confusion=True), source=with_copies
)
