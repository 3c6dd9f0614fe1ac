"""Linear rail: does the tracked range of a corner reflector change by the length of the rail, in measurement and simulation?

Paper (linear transformations), radial: the excursion (total change of the range) is 0.50 m measured and 0.51 m simulated, the correlation
of the range tracks over frames 0.78. Diagonal, at 45 degrees to the line of sight: 0.22 m measured, 0.44 m simulated and 0.42 m expected
(here 0.49 m, that of the logged motion); the paper names ambiguous peaks in clutter as the cause.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments import statistics
from experiments.campaign.cases import COMPARED, LABELS, MEASURED, RAIL, TWIN
from experiments.campaign.columns import TRACKERS
from experiments.campaign.frame import Frame
from experiments.cells import Cell, mean, paired
from experiments.drawing import DOMAIN_STYLES, PAGE_WIDTH_IN, Figure, figure, legend_above
from experiments.framed import framed
from experiments.verdicts import BELOW, NONE, Claim, within
from radartwin.config.config import Config
from radartwin.features import peak_track
from radartwin.features.align import overlap
from radartwin.runs.experiment import Table

TABLE = Table(
    name="linear_rail",
    title="Translation on a rail",
    caption="A corner reflector moves 60 cm along a rail from a distance of one metre, radially and at 45 degrees. Rows give the "
    "power-weighted range of the tracked peak, searched over the whole span of the rail. 'continuous' follows the strongest "
    "track without jumps; 'brightest' takes the strongest bin of each frame and states no claim.",
)

MOTIONS = RAIL
WITHIN_M = 0.02
SHORTER_M = 0.1  # smallest difference of excursions that counts as an effect; the paper has 0.20 m
PAPER = {
    ("radial", MEASURED): "0.50", ("radial", TWIN): "0.51", ("diagonal", MEASURED): "0.22", ("diagonal", TWIN): "0.44",
}  # fmt: skip
AS_FAR = within("the excursion is within 2 cm of the rail's", -WITHIN_M, WITHIN_M, paper="0.51 to 0.50", least=1)
SHAPE = Claim("the trajectory has the measured one's shape", "0.78", bound=0.3, null=0.0)
SHORT = Claim(
    "the measured diagonal excursion is smaller than the rail's", "0.22 to 0.42", -SHORTER_M, BELOW, 0.0,
    untestable="no object stands beside the rail",
)  # fmt: skip


def cells(config: Config, frame: Frame) -> Iterator[Cell]:
    """Declare the excursions of each object, motion and tracker, and the agreement of the tracks of both domains."""
    for (name, motion), both in frame.groupby(["object", "motion"], sort=False):
        for tracker in TRACKERS:
            case = {"object": name, "motion": motion, "tracker": tracker}
            counted = tracker == TRACKERS[0]  # claims count one tracker
            for domain in COMPARED:
                of, at = both[both.domain == domain], {**case, "of": LABELS[domain]}
                claim = NONE if not counted else AS_FAR if motion == "radial" else SHORT if domain == MEASURED else NONE
                moved, expected = of[tracker].map(peak_track.excursion), of.nominal_m.map(peak_track.excursion)
                yield Cell(at, "excursion (m)", of, mean(moved, statistics.POSITIVE), Claim(paper=PAPER[motion, domain]))
                yield Cell(at, "excursion less the rail's (m)", of, mean(moved - expected), claim)
            case["of"] = "both"
            tracks = paired(both)[[tracker, f"{tracker}_twin"]].to_numpy()
            shapes = [statistics.correlation(*overlap(measured, twin, 0)) for measured, twin in tracks]
            claim = SHAPE if counted and motion == "radial" else NONE
            yield Cell(case, "shape correlation", both, mean(shapes, statistics.SIGNED, statistics.FISHER), claim)
            shorter = [peak_track.excursion(measured) - peak_track.excursion(twin) for measured, twin in tracks]
            yield Cell(case, "measured less simulated excursion (m)", both, mean(shorter))


def _figure(frame: Frame) -> Figure:
    """Draw tracked and logged range over time, with one panel per motion and tracker."""
    groups = frame.groupby(["object", "motion"], sort=False)
    contents = [(motion, both, tracker) for (_, motion), both in groups for tracker in TRACKERS]
    drawing, panels = figure(1, len(contents), width_in=PAGE_WIDTH_IN, height_in=2.5, sharey=True, squeeze=False)
    for panel, (motion, both, tracker) in zip(panels[0], contents, strict=True):
        for domain, (colour, _) in DOMAIN_STYLES.items():
            for number, recording in enumerate(both[both.domain == domain].itertuples()):
                label = LABELS[domain] if number == 0 else None
                panel.plot(_time_s(recording), getattr(recording, tracker), color=colour, lw=1, label=label)
        log = next(both[both.domain == TWIN].itertuples())
        panel.plot(_time_s(log), log.nominal_m, color="black", lw=1, ls=":", label="log")
        panel.set(title=f"{motion}, {tracker}", xlabel="time (s)")
        panel.grid(color="0.9", lw=0.5)
    panels[0, 0].set_ylabel("range of the peak (m)")
    legend_above(drawing, panels[0, 0], 3)
    return drawing


def _time_s(recording: Any) -> NDArray[np.float64]:
    return np.arange(len(recording.nominal_m)) / recording.frame_rate_hz


METRICS = {
    "excursion_{motion}_{of}": {"metric": "excursion (m)", "tracker": "continuous"},
    "shape_correlation_{motion}_{of}": {"metric": "shape correlation", "tracker": "continuous"},
}
run, recordings, score = framed(TABLE, {"motions": MOTIONS}, cells, {TABLE.name: _figure}, METRICS)
