"""Draw the gallery: measured and simulated recordings side by side as maps of range over time, Doppler and azimuth.

The option experiment.pairs=[OBJECT/ROOM/MOTION/DISTANCE_M, ...] chooses the recordings, such as mug/squash_court/lateral/1; without it they
are the profile's list PAIRS, or the first recordings of a recording set. Dashed lines and rings mark the target's logged position. The maps
of a turntable are those of a whole revolution (its frame rate limits the Doppler frequency), the Doppler and azimuth maps of other motions
those of the middle frame.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from experiments import statistics
from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import LABELS, RAIL, ROVER, Case, Log, Motion
from experiments.drawing import PAGE_WIDTH_IN, Figure, figure, range_map
from experiments.interface import Config, Progress, Result, Store, Table
from experiments.verdicts import RowList
from radartwin.errors import ConfigError
from radartwin.features import envelope, peak_track
from radartwin.features.processed import Processed
from radartwin.features.profile import gate_energies, multipath_share, profile_correlation
from radartwin.plotting.style import pixel_edges
from radartwin.radar.processing import doppler_fft, range_fft, steering
from radartwin.radar.recording import Recording
from radartwin.scene.objects.catalogue import catalogue

READS = ("pairs",)  # options experiment.NAME of this experiment
TABLE = Table(
    name="gallery",
    title="Measured and simulated recordings side by side",
    caption="Recordings of the campaign, measured (above) and simulated (below), with one decibel scale per column: range over "
    "time, over Doppler and over azimuth. On a turntable, Doppler is computed across the frames of a revolution and folds "
    "at the frame rate in both domains; for other motions the middle frame is shown. The twin is the scanned room with "
    "materials that the vision-language model chose. For other pairs run: radartwin run experiment=gallery "
    "experiment.pairs=[OBJECT/ROOM/MOTION/DISTANCE_M,...]. Each row is one recording, so it has no interval.",
)

PAIRS = {
    "quick": ("corner_reflector/lab/turntable/1",),
    "paper": (
        "corner_reflector/lab/turntable/2", "mustard/lab/turntable/1", "corner_reflector/lab/diagonal/1",
        "corner_reflector/squash_court/depth/1", "mug/atrium/lateral/1",
    ),
}  # fmt: skip
RECORDED = 4  # default number of pairs from a recording set
NEAREST_M, FARTHEST_M = 0.5, 2.5  # smallest and largest allowed distance of a target
DRIVEN = ("atrium", "squash_court")
SPAN_DB = 75.0  # span of the colour scale below the brightest cell of both domains; it keeps furniture visible beside a reflector
FASTEST_MPS = 3.0
AZIMUTH_RAD = np.radians(np.arange(-80.0, 81.0))
Real = NDArray[np.floating]
_PADDING = 8  # factor of zero padding in the Doppler transform, because a bin of 16 chirps is as wide as 0.93 m/s


@dataclass(frozen=True, eq=False)
class View:
    """One recording as three maps of received power: range over time, over Doppler velocity and over azimuth."""

    range_m: Real  # (B,) range of each bin
    across: dict[str, Real]  # for each panel the axis (X,) across the range axis: time, Doppler or azimuth
    maps: dict[str, Real]  # for each panel the power (X, B)
    # for each panel the logged target as (position on this axis, range): a line (K,) or a point (1,); an unknown position is NaN
    truth: dict[str, tuple[Real, Real]]


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Draw one figure per pair of a measured and a simulated recording, and add table rows on the agreement of the pair."""
    campaign = Campaign(config, store, progress)
    cases = cases_to_draw(config, campaign)
    rows = RowList(config)
    figures: dict[str, Callable[[], Figure]] = {}
    keys: list[str] = []
    for case in progress.over(cases, "pairs"):
        recordings = {domain: campaign.processed(domain, case) for domain in LABELS}
        logs = {domain: campaign.log(case, domain) for domain in LABELS}
        views = {domain: view(recordings[domain][1], logs[domain], partial(campaign.recording, domain, case)) for domain in LABELS}
        _add_rows(rows, case, recordings, logs)
        name = f"gallery_{case.object}_{case.room}_{case.motion}_{case.distance_m:g}m"
        figures[name] = partial(draw, views, _title(case), config.measured.provider)
        keys += [key for key, _ in recordings.values()]
    metrics = {f"correlation_{r['pair'].replace('/', '_')}": r["value"] for r in rows if r["metric"] == "profile correlation"}
    return Result(TABLE.name, rows, figures, metrics, keys)


def cases_to_draw(config: Config, campaign: Campaign) -> list[Case]:
    """Return the configured pairs of recordings; the default is the list of the profile, or the first recordings of a recording set."""
    if config.experiment.pairs or config.measured.provider != "recordings":
        return [parse(pair) for pair in config.experiment.pairs or PAIRS.get(config.profile.name, PAIRS["quick"])]
    return list({(c.object, c.room, c.motion, c.distance_m): c for c in reversed(campaign.cases("measured"))}.values())[::-1][:RECORDED]


def parse(pair: str) -> Case:
    """Convert a text of the form OBJECT/ROOM/MOTION/DISTANCE_M to a case. Raises ConfigError if no campaign has such a recording."""
    parts = pair.split("/")
    where = f"experiment.pairs: {pair!r}"
    if len(parts) != 4:
        raise ConfigError(f"{where} must be OBJECT/ROOM/MOTION/DISTANCE_M, such as mug/lab/turntable/1")
    name, room, motion, text = parts
    if name not in catalogue():
        raise ConfigError(f"{where}: unknown object {name!r}; choose {', '.join(catalogue())}")
    if motion not in get_args(Motion):
        raise ConfigError(f"{where}: unknown motion {motion!r}; choose {', '.join(get_args(Motion))}")
    rooms = DRIVEN if motion in ROVER else ("lab",)
    if room not in rooms:
        raise ConfigError(f"{where}: motion {motion} is not recorded in {room!r}; choose {' or '.join(rooms)}")
    try:
        distance = float(text)
    except ValueError as error:
        raise ConfigError(f"{where}: {text!r} is not a distance; give metres") from error
    if not NEAREST_M <= distance <= FARTHEST_M:
        raise ConfigError(f"{where}: {text} m is out of range; give {NEAREST_M:g} to {FARTHEST_M:g} m")
    return Case(name, room, motion, distance)  # type: ignore[arg-type]


def view(processed: Processed, log: Log, recording: Callable[[], Recording]) -> View:
    """Compute the power maps of a recording; `recording` loads the samples of the middle frame, for the Doppler map without a turntable."""
    turning = log.angle_rad is not None
    count = processed.num_frames if log.angle_rad is None else envelope.frames_per_revolution(log.angle_rad)
    time_s, middle = np.arange(count) / log.frame_rate_hz, count // 2
    radar, weights = processed.radar, steering(processed.radar, AZIMUTH_RAD)
    azimuth, speed, nominal = course(log, count)
    averaged_frames = slice(count) if turning else slice(middle, middle + 1)
    beams = np.einsum("fab,ap->pfb", processed.channels[averaged_frames], weights, optimize=True)
    if turning:
        slow = np.fft.fftshift(np.fft.fft(processed.channels[:count], axis=0) / count, axes=0)
        doppler = np.mean(np.abs(slow) ** 2, axis=1)
        doppler_axis = np.fft.fftshift(np.fft.fftfreq(count, 1 / log.frame_rate_hz))
        point = (np.array([np.nan]), nominal[:1])
    else:
        profiles, _ = range_fft(recording().iq[middle], radar)
        spectra, velocity = doppler_fft(profiles, radar, bins=_PADDING * radar.num_chirps)
        kept = np.abs(velocity) <= FASTEST_MPS
        doppler = np.mean(np.abs(spectra[kept][..., : len(processed.range_m)]) ** 2, axis=(1, 2))
        doppler_axis, point = velocity[kept], (speed[middle : middle + 1], nominal[middle : middle + 1])
    here = np.degrees(azimuth[middle : middle + 1]), nominal[middle : middle + 1]
    across = {"time": time_s, "Doppler": doppler_axis, "azimuth": np.degrees(AZIMUTH_RAD[::-1])}
    maps = {"time": processed.power[:count], "Doppler": doppler, "azimuth": np.mean(np.abs(beams[::-1]) ** 2, axis=1)}
    maps = {name: power.astype(np.float64) for name, power in maps.items()}
    return View(processed.range_m, across, maps, {"time": (time_s, nominal), "Doppler": point, "azimuth": here})


def course(log: Log, frames: int) -> tuple[Real, Real, Real]:
    """Return azimuth in radians, radial velocity in m/s, and distance in metres of the logged target; each array has the shape (F,)."""
    away = log.target_poses[:, :3, 3] - log.sensor_poses[:, :3, 3]
    seen = np.einsum("fji,fj->fi", np.broadcast_to(log.sensor_poses[:, :3, :3], (len(away), 3, 3)), away)
    azimuth = np.broadcast_to(np.arctan2(seen[:, 1], seen[:, 0]), log.frames)[:frames]
    distance = np.asarray(log.distance_m, float)
    return azimuth, np.gradient(distance, 1 / log.frame_rate_hz)[:frames], distance[:frames]


def _add_rows(rows: RowList, case: Case, recordings: dict[str, tuple[str, Processed]], logs: dict[str, Log]) -> None:
    pair = f"{case.object}/{case.room}/{case.motion}/{case.distance_m:g}"

    def add(of: str, metric: str, value: float, keys: list[str]) -> None:
        rows.add({"pair": pair, "of": of}, metric, statistics.exact(value, 1), keys)

    both = [key for key, _ in recordings.values()]
    measured, simulated = (recordings[domain][1].power.mean(axis=0, dtype=np.float64) for domain in ("measured", "twin"))
    add("both", "profile correlation", profile_correlation(measured, simulated, recordings["twin"][1].range_m), both)
    for domain, (key, processed) in recordings.items():
        log = logs[domain]
        nominal = np.asarray(log.distance_m, float)
        path = peak_track.around(processed, nominal, log.frame_rate_hz)
        energy = gate_energies(processed.power, processed.range_m, nominal)[0]
        add(LABELS[domain], "range of the target less the log's (mm)", 1e3 * float(np.average(path - nominal, weights=energy)), [key])
        add(LABELS[domain], "multipath share", multipath_share(processed.power, processed.range_m, nominal), [key])


def draw(views: dict[str, View], title: str, domain: str) -> Figure:
    """Draw the measured maps above the simulated maps; the two maps of a column have the same decibel scale."""
    turning = bool(np.isnan(views["measured"].truth["Doppler"][0][0]))
    labels = {
        "time": "time (s)",
        "Doppler": "Doppler over the revolution (Hz)" if turning else "radial velocity (m/s)",
        "azimuth": "azimuth (degrees), left positive",
    }
    drawing, panels = figure(2, 3, width_in=PAGE_WIDTH_IN, height_in=4.6, sharey=True, sharex="col")
    for column, (panel, label) in enumerate(labels.items()):
        top = 10 * np.log10(max(recording.maps[panel].max() for recording in views.values()))
        for axes, (side, recording) in zip(panels[:, column], views.items(), strict=True):
            level = 10 * np.log10(np.maximum(recording.maps[panel], 10 ** ((top - SPAN_DB) / 10)))
            extent = (*pixel_edges(recording.across[panel]), *pixel_edges(recording.range_m))
            range_map(axes, level, extent, top, SPAN_DB)
            _mark(axes, *recording.truth[panel])
            if not column:
                axes.set_ylabel(f"{LABELS[side]}{f' ({domain})' if side == 'measured' else ''}\nrange (m)")
        panels[0, column].set_title(f"range over {panel}")
        panels[1, column].set_xlabel(label)
        bar = drawing.colorbar(panels[0, column].images[0], ax=panels[:, column], location="bottom", pad=0.02, shrink=0.9)
        bar.set_label("received / transmitted power (dB)")
    drawing.suptitle(title)
    return drawing


def _title(case: Case) -> str:
    motion = (
        "on a turntable" if case.motion == "turntable" else f"on a rail, {case.motion}" if case.motion in RAIL else f"{case.motion} drive"
    )
    room = case.room.replace("_", " ")
    return f"{catalogue()[case.object].label} in the {room}, {motion}, {case.distance_m:g} m; dashed line and ring: logged target"


def _mark(axes: Any, across: Real, range_m: Real) -> None:
    """Mark the target's logged position: a line over time, a ring at a known position, or a line at its range."""
    dashed = {"color": "white", "lw": 0.6, "ls": (0, (3, 9))}
    if len(across) > 1:
        axes.plot(across, range_m, **dashed)
    elif np.isnan(across[0]):
        axes.axhline(range_m[0], **dashed)
    else:
        axes.plot(across, range_m, "o", mfc="none", mec="white", ms=9, mew=1.0)
