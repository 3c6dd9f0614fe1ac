"""Unlabelled adaptation: how much do unlabelled measured recordings help an encoder that is trained on simulation alone?

The two-layer network classifies measured turntable revolutions without any measured class label. The methods differ in how they use the
unlabelled measured batch (radartwin.recognize.adaptation and alignment):
- "none" scales the measured features by the mean and the spread of the simulated features.
- "statistics" standardises each domain by its own mean and spread, as all other tables do. This method assumes equally frequent classes.
- "weighted statistics" gives the measured batch the mean and spread of simulated rows that are weighted by class shares. The shares are
  estimated from the batch.
- "continued training" trains the encoder further on simulated rows alone, as the control of the two methods below.
- "prototypes" and "views" train the encoder further with an additional loss of the unlabelled measured rows. The loss of "prototypes" moves
  a row towards its nearest text, with more weight for more confident rows. The loss of "views" moves the embeddings of two noisy versions
  of a row close together.
In the balanced batch, all classes are equally frequent. In the skewed batch, a third of the classes has a single recording.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments import draws
from experiments.campaign.source import RecordingSource
from experiments.claims import Claim
from experiments.recognition.encoder_comparison import gather_rows
from experiments.recognition.figures import bars
from experiments.recognition.protocol import RecognitionRows, anchors, scaled, seeds, settings
from radartwin.config.config import Config
from radartwin.io.progress import Progress
from radartwin.recognize.adaptation import skewed, weighted_statistics
from radartwin.recognize.alignment import Alignment, align
from radartwin.recognize.encoder import Encoder, nearest_text, text_scores
from radartwin.recognize.probes import repeatability
from radartwin.recognize.samples import Samples, Unlabelled
from radartwin.recognize.score import uniform_chance
from radartwin.recognize.split import label_free
from radartwin.recognize.training import fit
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

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


def run(config: Config, store: Store, progress: Progress) -> Result:
    return draws.scored(config, store, progress, lambda campaign: score(config, campaign, store, progress))


def score(config: Config, source: RecordingSource, store: Store, progress: Progress) -> Result:
    """Build the rows of each batch and method. Without a second recording of an object, there is no skewed batch."""
    measured, copies, keys = gather_rows(config, source, store, progress)
    whole, simulated = measured["features"], scaled(copies["features"])
    place = {name: row for row, name in enumerate(whole.recording)}
    texts, chosen = anchors(whole.classes), settings(config)
    batches = ("balanced", "skewed") if len(skewed(whole, config.seed)) < len(whole) else ("balanced",)
    hits = {(batch, method): np.full((len(seeds(config)), len(whole)), np.nan) for batch in batches for method in METHODS}
    for number, seed in enumerate(progress.over(seeds(config), "seeds")):
        encoder = fit(label_free(simulated, whole), texts, chosen, seed).encoder
        for batch in batches:
            rows = whole if batch == "balanced" else skewed(whole, seed)
            at = [place[name] for name in rows.recording]
            for method in METHODS:
                named = _predict(method, encoder, simulated, copies["features"], rows, texts, config, seed)
                hits[batch, method][number, at] = named == rows.label
    return _result(config, hits, whole, keys)


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
    chosen, classes = settings(config), sorted(texts)

    def probabilities(rows: Unlabelled) -> NDArray:
        return text_scores(encoder.embed(rows.values), np.stack([texts[name] for name in classes]), chosen.temperature)

    if method == NONE:
        centre, spread = unscaled.values.mean(axis=0), np.maximum(unscaled.values.std(axis=0), repeatability(unscaled.names))
        adapted = batch.with_values((batch.values - centre) / np.where(spread > 0, spread, np.inf))
    elif method == WEIGHTED:
        adapted = weighted_statistics(simulated, batch, probabilities).measured
    else:
        adapted = scaled(batch)
    if method in ALIGNMENTS:
        encoder = align(encoder, label_free(simulated, adapted), texts, chosen, seed, ALIGNMENTS[method])
    return nearest_text(encoder, adapted.unlabelled(), texts, chosen.temperature)


def _result(config: Config, hits: dict[tuple[str, str], NDArray], whole: Samples, keys: Sequence[str]) -> Result:
    rows, chance = RecognitionRows(config), uniform_chance(whole)
    shown: dict[str, dict[str, Any]] = {}
    for (batch, method), found in hits.items():
        scored = ~np.isnan(found).all(axis=0)
        case = {"supervision": "label_free", "batch": batch, "method": method}
        shown.setdefault(batch, {})[method] = rows.share(case, found[:, scored], whole.take(scored), keys, chance)
        if method != STATISTICS:
            claim = Claim("unequal class shares are corrected") if (batch, method) == ("skewed", WEIGHTED) else Claim()
            # The skewed batch differs between seeds, so that a row is missing in the batches of some seeds.
            ours, theirs = (np.nanmean(one[:, scored], axis=0, keepdims=True) for one in (found, hits[batch, STATISTICS]))
            rows.gain(case | {"method": f"{method} - {STATISTICS}"}, ours, theirs, whole.take(scored), keys, claim)
    metrics = {
        f"accuracy_{batch}_{method.replace(' ', '_')}": float(row["value"]) for batch, of in shown.items() for method, row in of.items()
    }
    return Result(TABLE.name, rows, {TABLE.name: lambda: bars(shown, "accuracy", grey=NONE)}, metrics, list(keys))
