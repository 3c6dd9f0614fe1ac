"""Linear rail: does the tracked range of a corner reflector change by the length of the rail, in measurement and simulation?

Paper (linear transformations), radial motion: the excursion (total change of the range) is 0.50 m measured and 0.51 m simulated; the shape
correlation (correlation of the range tracks over frames) is 0.78. Paper, diagonal motion at 45 degrees to the line of sight: the excursion
is 0.22 m measured, 0.44 m simulated and 0.42 m expected; the paper gives ambiguous peaks in clutter as the cause. In this table, the
expected diagonal excursion is that of the logged motion, 0.49 m.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from experiments import draws, statistics
from experiments.campaign.cases import COMPARED, LABELS, MEASURED, RAIL, TWIN, Case
from experiments.campaign.source import RecordingSource, read_both
from experiments.claims import BELOW, NONE, Claim, RowList, within
from experiments.drawing import DOMAIN_STYLES, legend_above
from radartwin.config.config import Config
from radartwin.features import track
from radartwin.features.align import overlap
from radartwin.features.log import Log, distances
from radartwin.features.processed import Processed
from radartwin.io.progress import Progress
from radartwin.plotting.style import PAGE_WIDTH_IN, figure
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE = Table(
    name="linear_rail",
    title="Translation on a rail",
    caption="A corner reflector moves 60 cm along a rail from a distance of one metre, radially and at 45 degrees. Rows give the "
    "power-weighted range of the tracked peak, searched over the whole span of the rail. 'continuous' follows the strongest "
    "track without jumps; 'brightest' takes the strongest bin of each frame and states no claim.",
)

TRACKERS = ("continuous", "brightest")
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


@dataclass(frozen=True, eq=False)
class RailTrack:
    """Ranges in metres of one recording over time_s (F,): the logged range (F,), and the tracked range (F,) of each tracker."""

    key: str
    time_s: NDArray
    nominal_m: NDArray
    tracks_m: dict[str, NDArray]


Tracks = dict[tuple[str, str], dict[str, list[RailTrack]]]  # [object, motion][domain]


def run(config: Config, store: Store, progress: Progress) -> Result:
    return draws.scored(config, store, progress, lambda campaign: score(config, campaign, progress))


def score(config: Config, source: RecordingSource, progress: Progress) -> Result:
    """Build the rows for each object, motion and tracker. Raises ConfigError if a domain has no rail recordings."""
    found = read_both(source, RAIL, lambda case: (case.object, RAIL.index(case.motion)), _tracked, progress)
    tracks = {(name, RAIL[k]): {domain: found[domain][name, k] for domain in COMPARED} for name, k in found[TWIN]}
    rows = RowList(config)
    for (name, motion), by_domain in tracks.items():
        for tracker in TRACKERS:
            _add_rows(rows, {"object": name, "motion": motion, "tracker": tracker}, by_domain)
    metrics = {
        f"{r['metric'].split(' (')[0].replace(' ', '_')}_{r['motion']}_{r['of']}": r["value"]
        for r in rows
        if r["tracker"] == "continuous" and r["metric"] in ("excursion (m)", "shape correlation")
    }
    every = [one.key for by_domain in tracks.values() for some in by_domain.values() for one in some]
    return Result("linear_rail", rows, {"linear_rail": lambda: _figure(tracks)}, metrics, every)


def _tracked(case: Case, key: str, processed: Processed, log: Log) -> RailTrack:
    nominal = distances(log, processed.num_frames)
    low, high = nominal.min() - track.SEARCH_M, nominal.max() + track.SEARCH_M
    tracks = {"continuous": track.track(processed, low, high, log.frame_rate_hz), "brightest": track.brightest(processed, low, high)}
    return RailTrack(key, np.arange(len(nominal)) / log.frame_rate_hz, nominal, tracks)


def _add_rows(rows: RowList, case: dict[str, Any], tracks: dict[str, list[RailTrack]]) -> None:
    motion, tracker = case["motion"], case["tracker"]
    counted = tracker == TRACKERS[0]  # claims count one tracker
    keys = {domain: [one.key for one in tracks[domain]] for domain in COMPARED}
    excursions = {}
    for domain in COMPARED:
        excursions[domain] = np.array([track.excursion(one.tracks_m[tracker]) for one in tracks[domain]])
        expected = np.array([track.excursion(one.nominal_m) for one in tracks[domain]])
        of = {**case, "of": LABELS[domain]}
        rows.add_mean(of, "excursion (m)", excursions[domain], keys[domain], Claim(paper=PAPER[motion, domain]), statistics.POSITIVE)
        claim = NONE if not counted else AS_FAR if motion == "radial" else SHORT if domain == MEASURED else NONE
        rows.add_mean(of, "excursion less the rail's (m)", excursions[domain] - expected, keys[domain], claim)
    both = {**case, "of": "both"}
    twin = tracks[TWIN][0]
    shapes = [statistics.correlation(*overlap(one.tracks_m[tracker], twin.tracks_m[tracker], 0)) for one in tracks[MEASURED]]
    claim = SHAPE if counted and motion == "radial" else NONE
    rows.add_mean(both, "shape correlation", shapes, [*keys[MEASURED], twin.key], claim, statistics.SIGNED, statistics.FISHER)
    shorter = excursions[MEASURED] - excursions[TWIN].mean()
    rows.add_mean(both, "measured less simulated excursion (m)", shorter, [*keys[MEASURED], *keys[TWIN]])


def _figure(tracks: Tracks) -> Figure:
    """Draw tracked and logged range over time, with one panel per motion and tracker."""
    shown = [(key, tracker) for key in tracks for tracker in TRACKERS]
    drawing, panels = figure(1, len(shown), width_in=PAGE_WIDTH_IN, height_in=2.5, sharey=True, squeeze=False)
    for panel, (key, tracker) in zip(panels[0], shown, strict=True):
        for domain, (colour, _) in DOMAIN_STYLES.items():
            for number, one in enumerate(tracks[key][domain]):
                label = LABELS[domain] if number == 0 else None
                panel.plot(one.time_s, one.tracks_m[tracker], color=colour, lw=1, label=label)
        log = tracks[key][TWIN][0]
        panel.plot(log.time_s, log.nominal_m, color="black", lw=1, ls=":", label="log")
        panel.set(title=f"{key[1]}, {tracker}", xlabel="time (s)")
        panel.grid(color="0.9", lw=0.5)
    panels[0, 0].set_ylabel("range of the peak (m)")
    legend_above(drawing, panels[0, 0], 3)
    return drawing
