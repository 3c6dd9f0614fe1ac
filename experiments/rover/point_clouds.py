"""Are the detections of a measured drive where the simulated drive has detections, frame by frame?

The table compares the measured and the simulated point cloud of each frame (radartwin.features.cloud). In a control, the simulated cloud is
moved along range, and around the end of the profile, by several distances, which keeps number, spacing and azimuths of the detections and
removes the agreement in range.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from experiments.campaign.cases import COMPARED, LABELS, MEASURED, ROVER, TWIN
from experiments.campaign.frame import Column, Frame
from experiments.cells import Cell, mean, paired
from experiments.drawing import PAGE_WIDTH_IN, PALETTE, Figure, figure
from experiments.framed import framed
from experiments.rover.rover_fidelity import WHERE
from experiments.statistics import POSITIVE, SHARE, SIGNED
from experiments.verdicts import NONE, Claim
from radartwin.config.config import Config
from radartwin.features import cloud
from radartwin.features.profile import FAR_M, NEAR_M
from radartwin.runs.experiment import Table

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
MOTIONS = ROVER
SHIFTS_M = (FAR_M - NEAR_M) * np.arange(1, 8) / 8  # distances in range by which the control moves the simulated cloud
BETTER = Claim("more measured detections agree with the simulation than with the control", "", bound=0.05, null=0.0)


FOUND, CONTROL = "measured detections that are simulated", "measured detections that are simulated, control"
EXTRA, CHAMFER = "simulated detections that are measured", "Chamfer distance (m)"
COUNTS = {domain: f"detections in a frame, {LABELS[domain]}" for domain in COMPARED}
SHARES = (FOUND, CONTROL, EXTRA)
METRICS = (*SHARES, CHAMFER, *COUNTS.values())
GAIN = "measured detections that are simulated, above the control"


Clouds = Sequence[NDArray[np.float64]]  # the detections of each frame: (N, 2) range in metres and azimuth in radians


def cells(config: Config, frame: Frame) -> Iterator[Cell]:
    """Declare the cells of each place (room, motion, distance), and of all drives of each room and motion."""
    pairs = paired(frame).sort_values(WHERE, ignore_index=True)
    drives = [clouds(pairs["detections" + end], pairs["nominal_m" + end]) for end in ("", "_twin")]
    pairs = pairs.join(pd.DataFrame([compared(*both) for both in zip(*drives, strict=True)]))
    for (place, here), (_, group) in zip(frame.groupby(WHERE), pairs.groupby(WHERE), strict=True):
        for metric in METRICS:
            if len(defined := group[metric].dropna()):
                yield Cell(_at(place), metric, here, mean(defined, SHARE if metric in SHARES else POSITIVE))
    pairs[GAIN] = pairs[FOUND] - pairs[CONTROL]
    for (room, motion), group in pairs.dropna(subset=GAIN).groupby(["room", "motion"]):
        here = frame[(frame.room == room) & (frame.motion == motion)]
        yield Cell(_at((room, motion, None)), GAIN, here, mean(group[GAIN], SIGNED), BETTER if len(group) > 1 else NONE)


def _at(place: tuple[str, str, float | None]) -> dict[str, Any]:
    return dict(zip(WHERE, place, strict=True))


def clouds(detections: Column, series: Column) -> list[Clouds]:
    """Return the detections of each frame of several drives, whose number of frames is the length of their time series."""
    return [[points[points[:, 0] == k, 1:] for k in range(len(frames))] for points, frames in zip(detections, series, strict=True)]


def compared(measured: Clouds, simulated: Clouds) -> dict[str, float]:
    """Return the mean of each metric over the common frames of two recordings; NaN if no frame has a value of the metric."""
    values = defaultdict(list)
    for points, twin_points in zip(measured, simulated, strict=False):
        moved = [np.column_stack([NEAR_M + (twin_points[:, 0] - NEAR_M + by) % (FAR_M - NEAR_M), twin_points[:, 1]]) for by in SHIFTS_M]
        values[FOUND].append(cloud.matched(points, twin_points, NEAR_RANGE_M, NEAR_AZIMUTH_RAD))
        values[CONTROL].append(float(np.mean([cloud.matched(points, other, NEAR_RANGE_M, NEAR_AZIMUTH_RAD) for other in moved])))
        values[EXTRA].append(cloud.matched(twin_points, points, NEAR_RANGE_M, NEAR_AZIMUTH_RAD))
        values[CHAMFER].append(cloud.chamfer_m(points, twin_points))
        values[COUNTS[MEASURED]].append(float(len(points)))
        values[COUNTS[TWIN]].append(float(len(twin_points)))
    finite = {metric: np.array(of_frames)[np.isfinite(of_frames)] for metric, of_frames in values.items()}
    return {metric: float(of_frames.mean()) if len(of_frames) else float("nan") for metric, of_frames in finite.items()}


def _figure(frame: Frame) -> Figure:
    """Draw both clouds of all frames of one drive per motion, from above, in the frame of the radar."""
    drives = paired(frame).drop_duplicates("motion")
    drawing, panels = figure(1, len(drives), width_in=PAGE_WIDTH_IN, height_in=3.2, sharex=True, sharey=True, squeeze=False)
    for panel, drive in zip(panels[0], drives.itertuples(), strict=True):
        for domain, points, colour, marker in (
            (MEASURED, drive.detections, PALETTE[0], "o"), (TWIN, drive.detections_twin, PALETTE[1], "+"),
        ):  # fmt: skip
            x, y = points[:, 1] * np.cos(points[:, 2]), points[:, 1] * np.sin(points[:, 2])
            fill = {"facecolors": "none", "edgecolors": colour} if marker == "o" else {"color": colour}
            panel.scatter(-y, x, s=14, lw=0.7, marker=marker, label=LABELS[domain], **fill)
        label = f"{drive.object} {drive.room},\n{drive.motion} drive at {drive.distance_m:g} m".replace("_", " ")
        panel.set_title(label)
        panel.set(aspect="equal")
        panel.set(xlabel="right of the radar (m)", ylim=(0, FAR_M))
    panels[0, 0].set_ylabel("in front of the radar (m)")
    panels[0, 0].legend(loc="lower left")
    return drawing


run, recordings, score = framed(TABLE, {"motions": MOTIONS}, cells, {TABLE.name: _figure}, {"found_{room}_{motion}": {"metric": GAIN}})
