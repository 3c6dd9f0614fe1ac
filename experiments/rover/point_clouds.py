"""Are the detections of a measured drive where the simulated drive has detections, frame by frame?

Both recordings of a drive give one point cloud per frame (radartwin.features.cloud). The table compares the measured and the simulated
cloud of each frame of the logged motion. In a control, the simulated cloud is moved along range by several distances. A detection that
leaves the range profile at one end enters it again at the other end. The control keeps the number, the spacing and the azimuths of the
detections, and removes the agreement in range.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from experiments import draws
from experiments.campaign.cases import COMPARED, LABELS, MEASURED, ROVER, TWIN, Case
from experiments.campaign.source import RecordingSource, read_both
from experiments.claims import NONE, Claim, RowList
from experiments.rover.drive_features import Place
from experiments.statistics import POSITIVE
from radartwin.config.config import Config
from radartwin.features import cloud
from radartwin.features.log import Log
from radartwin.features.processed import Processed
from radartwin.features.profile import FAR_M, NEAR_M
from radartwin.io.progress import Progress
from radartwin.plotting.style import PAGE_WIDTH_IN, PALETTE, figure
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NEAR_RANGE_M, NEAR_AZIMUTH_RAD = 0.1, np.deg2rad(15.0)  # limits within which two detections agree

TABLE = Table(
    name="point_clouds",
    title="Point clouds along drives",
    caption="Detections (CFAR in range, maxima of the azimuth spectrum) of each frame of a drive, measured against simulated. Rows give "
    "the Chamfer distance of the clouds, and the share of the detections of one domain that have a detection of the other domain within "
    "10 cm and 15 degrees, as means over frames and then over recordings. A frame in which one of the clouds is empty has no Chamfer "
    "distance. In the control, the simulated clouds are moved along range by 0.65 m to 4.55 m; a point that leaves one end of the "
    "profile (0.3 m to 5.5 m) enters at the other end. "
    "Intervals are bootstraps over recordings.",
)
SHIFTS_M = (FAR_M - NEAR_M) * np.arange(1, 8) / 8  # distances in range by which the control moves the simulated cloud
BETTER = Claim("more measured detections agree with the simulation than with the control", "", bound=0.05, null=0.0)


@dataclass(frozen=True, eq=False)
class Clouds:
    """The detections of one recording: for each frame (N, 2) range in metres and azimuth in radians."""

    key: str
    frames: list[NDArray[np.float64]]


def run(config: Config, store: Store, progress: Progress) -> Result:
    return draws.scored(config, store, progress, lambda campaign: score(config, campaign, progress), rover=True)


def score(config: Config, source: RecordingSource, progress: Progress) -> Result:
    """Build the rows of each place (room, motion, distance), and of all drives of each room and motion."""
    found = read_both(source, ROVER, lambda case: (case.object, (case.room, case.motion, case.distance_m)), _clouds, progress)
    rows, shares, keys = RowList(config), defaultdict(list), defaultdict(list)
    for place in sorted({place for _, place in found[MEASURED]}):
        pairs = [(measured, found[TWIN][name, at][0]) for (name, at), some in found[MEASURED].items() if at == place for measured in some]
        used = [one.key for pair in pairs for one in pair]
        values = [compared(*pair) for pair in pairs]
        for metric in values[0]:
            if defined := [one[metric] for one in values if np.isfinite(one[metric])]:
                rows.add_mean(_at(place), metric, defined, used, NONE, POSITIVE)
        shares[place[0], place[1]] += [one[FOUND] - one[CONTROL] for one in values if np.isfinite(one[FOUND])]
        keys[place[0], place[1]] += used
    shares = {where: gains for where, gains in shares.items() if gains}
    for (room, motion), gains in shares.items():
        rows.add_mean(_at((room, motion, None)), GAIN, gains, keys[room, motion], BETTER if len(gains) > 1 else NONE)
    metrics = {f"found_{room}_{motion}": float(np.mean(gains)) for (room, motion), gains in shares.items()}
    every = [one.key for domain in COMPARED for some in found[domain].values() for one in some]
    return Result("point_clouds", rows, {"point_clouds": lambda: _figure(found)}, metrics, every)


FOUND, CONTROL = "measured detections that are simulated", "measured detections that are simulated, control"
EXTRA, CHAMFER = "simulated detections that are measured", "Chamfer distance (m)"
COUNTS = {domain: f"detections in a frame, {LABELS[domain]}" for domain in COMPARED}
GAIN = "measured detections that are simulated, above the control"


def compared(measured: Clouds, simulated: Clouds) -> dict[str, float]:
    """Return the mean of each metric over the common frames of two recordings; NaN if no frame has a value of the metric."""
    values = defaultdict(list)
    for one, two in zip(measured.frames, simulated.frames, strict=False):
        moved = [np.column_stack([NEAR_M + (two[:, 0] - NEAR_M + by) % (FAR_M - NEAR_M), two[:, 1]]) for by in SHIFTS_M]
        values[FOUND].append(cloud.matched(one, two, NEAR_RANGE_M, NEAR_AZIMUTH_RAD))
        values[CONTROL].append(float(np.mean([cloud.matched(one, other, NEAR_RANGE_M, NEAR_AZIMUTH_RAD) for other in moved])))
        values[EXTRA].append(cloud.matched(two, one, NEAR_RANGE_M, NEAR_AZIMUTH_RAD))
        values[CHAMFER].append(cloud.chamfer_m(one, two))
        values[COUNTS[MEASURED]].append(float(len(one)))
        values[COUNTS[TWIN]].append(float(len(two)))
    return {metric: _mean(some) for metric, some in values.items()}


def _mean(values: list[float]) -> float:
    finite = np.array(values)[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else float("nan")


def _clouds(case: Case, key: str, processed: Processed, log: Log) -> Clouds:
    return Clouds(key, cloud.detections(processed))


def _at(place: Place | tuple[str, str, None]) -> dict[str, Any]:
    return {"room": place[0], "motion": place[1], "distance_m": place[2]}


def _figure(found: dict[str, dict[Any, list[Clouds]]]) -> Figure:
    """Draw both clouds of all frames of one drive per motion, from above, in the frame of the radar."""
    chosen = {}
    for name, place in found[MEASURED]:
        chosen.setdefault(place[1], (name, place))
    drawing, panels = figure(1, len(chosen), width_in=PAGE_WIDTH_IN, height_in=3.2, sharex=True, sharey=True, squeeze=False)
    for panel, (name, place) in zip(panels[0], chosen.values(), strict=True):
        for domain, colour, marker in ((MEASURED, PALETTE[0], "o"), (TWIN, PALETTE[1], "+")):
            points = np.concatenate(found[domain][name, place][0].frames)
            x, y = points[:, 0] * np.cos(points[:, 1]), points[:, 0] * np.sin(points[:, 1])
            fill = {"facecolors": "none", "edgecolors": colour} if marker == "o" else {"color": colour}
            panel.scatter(-y, x, s=14, lw=0.7, marker=marker, label=LABELS[domain], **fill)
        label = f"{name.replace('_', ' ')}, {place[0].replace('_', ' ')},\n{place[1]} drive at {place[2]:g} m"
        panel.set_title(label, fontsize=8)
        panel.set(aspect="equal")
        panel.set(xlabel="right of the radar (m)", ylim=(0, FAR_M))
    panels[0, 0].set_ylabel("in front of the radar (m)")
    panels[0, 0].legend(loc="lower left", fontsize=7)
    return drawing
