"""Unlabelled adaptation: how much do unlabelled measured recordings help an encoder that is trained on simulation alone?

The two-layer network classifies measured turntable revolutions without labels. "none" scales the measured features by mean and spread of
the simulated ones, "statistics" (as all other tables) each domain by its own, and "weighted statistics" by those of simulated rows weighted
by estimated class shares. "continued training" trains further on simulated rows; "prototypes" and "views" add a loss that moves measured
rows towards their nearest text, or two noisy versions of a row together. In the skewed batch, a third of the classes has a single
recording.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from experiments.campaign.frame import Frame
from experiments.cells import Cell
from experiments.framed import framed
from experiments.recognition.copies import Copied, with_copies
from experiments.recognition.plots import accuracy_bars
from experiments.recognition.protocol import Scored, anchors, scaled, seeds, settings
from experiments.recognition.readings import TURNTABLE, revolutions
from experiments.verdicts import Claim
from radartwin.config.config import Config
from radartwin.recognize.adaptation import skewed, weighted_statistics
from radartwin.recognize.continued_training import Alignment, align
from radartwin.recognize.encoder import Encoder, nearest_text, text_scores
from radartwin.recognize.probes import repeatability
from radartwin.recognize.samples import Samples, Unlabelled
from radartwin.recognize.score import uniform_chance
from radartwin.recognize.split import label_free
from radartwin.recognize.training import fit
from radartwin.runs.experiment import Table

TABLE = Table(
    name="unlabelled_adaptation",
    title="Effect of unlabelled measured recordings",
    caption="Accuracy of the two-layer network without measured labels, for several uses of the unlabelled measured batch. In a balanced "
    "batch all classes are equally frequent; in a skewed batch a third of them has a single recording. Differences are against "
    "'statistics', which the other tables use. n counts recordings. Intervals are bootstraps over draws and "
    "objects.",
)

NONE, STATISTICS, WEIGHTED, CONTINUED, PROTOTYPES, VIEWS = (
    "none", "statistics", "weighted statistics", "continued training", "prototypes", "views",
)  # fmt: skip
ALIGNMENTS = {CONTINUED: Alignment(weight=0.0), PROTOTYPES: Alignment(), VIEWS: Alignment("views", 0.1)}
METHODS = (NONE, STATISTICS, WEIGHTED, *ALIGNMENTS)


def cells(config: Config, copied: Copied, frame: Frame) -> Iterator[Cell]:
    """Declare the cells of one draw. Without a second recording of an object, there is no skewed batch."""
    whole, copies = revolutions(frame), copied(config, frame)
    simulated = scaled(copies)
    place = {name: row for row, name in enumerate(whole.recording)}
    texts, encoder_settings = anchors(whole.classes), settings(config)
    batches = ("balanced", "skewed") if len(skewed(whole, config.seed)) < len(whole) else ("balanced",)
    # the skewed batch differs between seeds, so that a row is missing in the batches of some seeds
    hits = {batch: {method: np.full((len(seeds(config)), len(whole)), np.nan) for method in METHODS} for batch in batches}
    for number, seed in enumerate(seeds(config)):
        encoder = fit(label_free(simulated, whole), texts, encoder_settings, seed).encoder
        for batch in batches:
            rows = whole if batch == "balanced" else skewed(whole, seed)
            at = [place[name] for name in rows.recording]
            for method in METHODS:
                named = _predict(method, encoder, simulated, copies, rows, texts, config, seed)
                hits[batch][method][number, at] = named == rows.label
    scored = Scored(config, whole, frame, uniform_chance(whole))
    for batch, batch_hits in hits.items():
        pairs = {(method, STATISTICS): Claim() for method in METHODS if method != STATISTICS}
        if batch == "skewed":
            pairs[WEIGHTED, STATISTICS] = Claim("unequal class shares are corrected")
        yield from scored.compared({"supervision": "label_free", "batch": batch}, batch_hits, pairs)


def _predict(
    method: str,
    encoder: Encoder,
    simulated: Samples,
    unscaled: Samples,
    batch: Samples,
    texts: dict[str, NDArray],
    config: Config,
    seed: int,
) -> NDArray[np.str_]:
    """Return the predicted class of each row of the batch. The class labels of the batch are not used."""
    encoder_settings, classes = settings(config), sorted(texts)

    def probabilities(rows: Unlabelled) -> NDArray:
        return text_scores(encoder.embed(rows.values), np.stack([texts[name] for name in classes]), encoder_settings.temperature)

    if method == NONE:
        centre, spread = unscaled.values.mean(axis=0), np.maximum(unscaled.values.std(axis=0), repeatability(unscaled.names))
        adapted = batch.with_values((batch.values - centre) / np.where(spread > 0, spread, np.inf))
    elif method == WEIGHTED:
        adapted = weighted_statistics(simulated, batch, probabilities).measured
    else:
        adapted = scaled(batch)
    if method in ALIGNMENTS:
        encoder = align(encoder, label_free(simulated, adapted), texts, encoder_settings, seed, ALIGNMENTS[method])
    return nearest_text(encoder, adapted.unlabelled(), texts, encoder_settings.temperature)


run, recordings, score = framed(TABLE, TURNTABLE, cells, *accuracy_bars(TABLE.name, "batch", grey=NONE), source=with_copies)
