"""The table `campaign`: run time and disk space of every measured and simulated recording. Missing recordings are simulated.

The run time of a recording is the time that one worker took to simulate the recording. With parallel workers, the whole campaign takes less
time than the sum of these run times. The profile `paper` measures the paper's campaign; all other profiles extrapolate its run time and
disk space. The extrapolated disk space of the campaign follows from array shapes. The extrapolated run time of the campaign is a sum over
domains and motions. Each term of this sum has three parts: the times of set-ups (a track, or a room whose parts drift), of traced states
(an angle of a turntable, or a frame of a drive), and of processed frames. The time per traced state is measured on the recordings that
reused a cached set-up. The run time of another recording minus the time of its traced states is its set-up time.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

import numpy as np

from experiments.campaign import tally, truth
from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import COMPARED, LABELS, MEASURED, TWIN, VOID, Case, planned
from experiments.campaign.cases import log as nominal_log
from experiments.campaign.schedule import RecordingTask
from experiments.claims import BELOW, NONE, Claim, RowList
from experiments.scans import virtual_scan
from experiments.statistics import exact, ratio
from radartwin.builders.radar import build_radar
from radartwin.config.compose import compose
from radartwin.config.config import Config
from radartwin.config.study import CampaignConfig
from radartwin.features.processed import MAX_RANGE_M
from radartwin.io.one_line import plural
from radartwin.io.progress import Progress
from radartwin.radar.chirp import Radar
from radartwin.radar.processing import azimuth_row
from radartwin.runs import workers
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Product, Store
from radartwin.testbed.testbed import Gaps

TABLE = Table(
    name="campaign",
    title="Run time and disk space of the campaign",
    caption="Time and disk space on this machine for the recordings that all tables share. Each recording is simulated without "
    "receiver effects and then processed to features; both parts count. Turntables are traced at the aspects (target "
    "angles) of one revolution; drives share the set-up of their track. The project, not the paper, chose the limits of "
    "time and disk space. Intervals are bootstraps over recordings.",
    timed=True,
)

ALL = "all"
ROUNDED_S = 2.0  # rounding of the times in a product's metadata
FRAME = Claim("a measured frame takes at most 60 ms", bound=60.0, direction=BELOW, least=1, limit=True)
DISK = Claim("the paper's campaign takes at most 10 GB", bound=10.0, direction=BELOW, least=1, limit=True)
MINUTES = Claim("the paper's campaign is made within 60 minutes", bound=60.0, direction=BELOW, least=1, limit=True)
ALL_MINUTES = Claim("all draws of the paper's campaign are made within 90 minutes", bound=90.0, direction=BELOW, least=1, limit=True)


@dataclass(frozen=True)
class Made:
    """Run time and disk space of one recording."""

    domain: str
    case: Case
    keys: tuple[str, ...]  # store keys of the clean and the processed recording
    seconds: tuple[float, float]  # wall time of the clean and the processed recording
    core_seconds: tuple[float, float]  # core time of the clean and the processed recording
    bytes: tuple[int, int]  # size of the clean and the processed recording in the store
    frames: int
    traced: int  # number of traced states
    setups: int  # number of tracks and rooms that were set up for this recording; 0 if it reused cached set-ups


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Simulate the missing recordings and tabulate run time and disk space of all. Raises UserError if a recording cannot be simulated."""
    made = make(Campaign(config, store, progress), progress)
    return Result(TABLE.name, rows(config, made), {}, metrics(made), [key for one in made for key in one.keys])


def recordings(config: Config, store: Store, progress: Progress) -> dict[str, RecordingTask]:
    campaign = Campaign(config, store, progress)
    return campaign.missing(campaign.plan())


def make(campaign: Campaign, progress: Progress) -> list[Made]:
    """Simulate the missing recordings of the campaign. Returns the run times and sizes of all recordings in the order of
    `Campaign.plan`.
    """
    wanted = campaign.plan()
    missing = [one for one in wanted if not campaign.holds(*one)]
    gaps = truth.gaps_of(campaign.config)
    counts = [states(domain, case, campaign.log(case, domain).frames, gaps) for domain, case in missing]
    size = sum(expected_bytes(build_radar(campaign.config.radar), *count) for count in counts)
    frames, traced = (sum(count[k] for count in counts) for k in (0, 1))
    progress.say(
        f"campaign: {plural(len(wanted), 'recording')}, {len(missing)} of them to be simulated: {frames:,} frames from {traced:,} traced "
        f"poses, about {size / 1e9:.2g} GB"
    )
    campaign.prepare(missing, fresh=True)
    made = [_made(campaign, domain, case) for domain, case in progress.over(wanted, "recordings")]
    return _with_scans(campaign, made)


def _made(campaign: Campaign, domain: str, case: Case) -> Made:
    clean = campaign.clean(domain, case)
    processed = campaign.process(domain, case)
    first, second = clean.read_json("meta"), processed.read_json("meta")
    counts = first["told"]
    seconds, core_seconds = ((float(first[name]), float(second[name])) for name in ("seconds", "core_seconds"))
    return Made(
        domain, case, (clean.key, processed.key), seconds, core_seconds, (_size(clean), _size(processed)),
        counts["frames"], counts["traced"], counts.get(tally.SETUPS, 0),
    )  # fmt: skip


def _with_scans(campaign: Campaign, made: list[Made]) -> list[Made]:
    """Add the run time of each room's phone scan to the first recording simulated in that room, if the scan was simulated separately."""
    out, config, store = list(made), campaign.config, campaign.store
    strength = config.measured.gap.geometry
    if config.materials.source == VOID:
        return out  # no scan
    for room in dict.fromkeys(one.case.room for one in made if one.domain == TWIN):
        if not store.holds(virtual_scan.KIND, virtual_scan.specification(config, room, strength), virtual_scan.ROOTS):
            continue  # no scan
        ours = [k for k, one in enumerate(made) if one.domain == TWIN and one.case.room == room]
        scan = virtual_scan.fetch(config, store, room, strength).read_json("meta")
        began, ended = _span_s(scan)
        spans = [_span_s(campaign.clean(made[k].domain, made[k].case).read_json("meta")) for k in ours]
        if not any(low - ROUNDED_S <= began and ended <= high + ROUNDED_S for low, high in spans):
            first = out[ours[0]]
            seconds, core_seconds = first.seconds[0] + float(scan["seconds"]), first.core_seconds[0] + float(scan["core_seconds"])
            out[ours[0]] = replace(
                first, seconds=(seconds, first.seconds[1]), core_seconds=(core_seconds, first.core_seconds[1]), setups=first.setups + 1
            )
    return out


def _span_s(meta: dict[str, Any]) -> tuple[float, float]:
    """Return start and end time of the computation of a stored result, in seconds."""
    ended = datetime.fromisoformat(meta["finished"]).timestamp()
    return ended - float(meta["seconds"]), ended


def _size(product: Product) -> int:
    return sum(path.stat().st_size for path in product.path.rglob("*") if path.is_file())


def rows(config: Config, made: Sequence[Made]) -> RowList:
    """Build the table rows: one group per domain and motion, one per domain, and one for the paper's campaign."""
    out = RowList(config)
    for domain in COMPARED:
        own = [one for one in made if one.domain == domain]
        for motion in dict.fromkeys(one.case.motion for one in own):
            _add_group(out, domain, motion, [one for one in own if one.case.motion == motion])
        if own:
            _add_group(out, domain, ALL, own)
    if config.measured.provider == "testbed":
        _add_paper(out, made)
    return out


def _case(of: str, motion: str, some: Sequence[Made]) -> dict[str, Any]:
    return {
        "of": of, "motion": motion, "recordings": len(some), "frames": sum(one.frames for one in some),
        "traced": sum(one.traced for one in some), "set_ups": sum(one.setups for one in some),
    }  # fmt: skip


def _add_group(rows: RowList, domain: str, motion: str, some: Sequence[Made]) -> None:
    """Add rows with the time per frame and the disk space of the recordings of one domain and motion."""
    keys = [one.keys[0] for one in some]
    frames = np.array([one.frames for one in some], float)
    wall, core = (1e3 * np.array([sum(getattr(one, name)) for one in some]) for name in ("seconds", "core_seconds"))
    case = _case(LABELS[domain], motion, some)
    claim = FRAME if domain == MEASURED and motion == ALL and rows.config.measured.provider == "testbed" else NONE
    seeds = rows.config.profile.resamples, rows.config.seed
    rows.add(case, "wall time per frame (ms)", ratio(wall, frames, *seeds), keys, claim)
    rows.add(case, "core time per frame (ms)", ratio(core, frames, *seeds), keys)
    rows.add(case, "disk (MB)", exact(sum(sum(one.bytes) for one in some) / 1e6, len(some)), keys)


def _add_paper(rows: RowList, made: Sequence[Made]) -> None:
    """Add rows with run time and disk space of the paper's campaign, for one draw and for all draws of the paper profile.

    With profile=paper the run time and disk space are measured. With any other profile they are extrapolated, provided that every motion
    has recordings.
    """
    config, paper = rows.config, compose(["profile=paper"]).profile.campaign
    cases = [(domain, case) for domain in COMPARED for case in planned(paper, domain == MEASURED)]
    count = workers.worker_count(config.jobs, len(cases))
    keys, case = [one.keys[0] for one in made], _case("both", ALL, made)
    own = config.profile.campaign == paper
    label = f"{count} at once" + ("" if own else ", extrapolated")
    for draws, minutes, disk in (("one draw", MINUTES, DISK), ("all draws", ALL_MINUTES, NONE)):
        wanted = [(domain, one) for domain, one in cases if draws == "all draws" or not one.draw]
        if own:
            some = [one for one in made if (one.domain, one.case) in set(wanted)]
            seconds, size = sum(sum(one.seconds) for one in some), sum(sum(one.bytes) for one in some)
        else:
            seconds, size = _expected(config, paper, wanted, made)
        rows.add(case, f"time of the paper's campaign, {draws}, {label} (min)", exact(seconds / 60 / count, len(made)), keys, minutes)
        rows.add(case, f"disk of the paper's campaign, {draws}, {label} (GB)", exact(size / 1e9, len(made)), keys, disk)


def _expected(config: Config, paper: CampaignConfig, wanted: Sequence[tuple[str, Case]], made: Sequence[Made]) -> tuple[float, float]:
    """Extrapolate run time and disk space of the recordings `wanted` of the campaign `paper` from the timed recordings `made`.

    Returns (seconds in one process, bytes). Both values are NaN if a motion has no timed recording.
    """
    recorded: dict[tuple[str, str], list[Made]] = defaultdict(list)
    for one in made:
        recorded[one.domain, one.case.motion].append(one)
    groups: dict[tuple[str, str], list[Case]] = defaultdict(list)
    for domain, case in wanted:
        groups[domain, case.motion].append(case)
    if not all(group in recorded for group in groups):
        return np.nan, np.nan
    radar = build_radar(config.radar)
    seconds, size = 0.0, 0.0
    for group, cases in groups.items():
        counts = _states(group[0], cases, paper)
        seconds += extrapolated(recorded[group], counts, len({(case.room, case.draw) for case in cases}))
        size += sum(expected_bytes(radar, *one) for one in counts)
    return seconds, size


def _states(domain: str, cases: Sequence[Case], campaign: CampaignConfig) -> list[tuple[int, int]]:
    """Return (number of frames, number of ray-traced states of the scene) of each planned recording (see `states`)."""
    lengths = [nominal_log(case, campaign, measured=domain == MEASURED).frames for case in cases]
    return [states(domain, case, length, Gaps()) for case, length in zip(cases, lengths, strict=True)]


def extrapolated(some: Sequence[Made], counts: Sequence[tuple[int, int]], rooms: int) -> float:
    """Extrapolate the run time in seconds of recordings with these (frames, traced states) from the timed recordings `some` of the
    same kind.
    """
    frames, traced = np.sum(counts, axis=0)
    without = [one for one in some if not one.setups]
    plain = without or some
    each_state = sum(one.seconds[0] for one in plain) / sum(one.traced for one in plain)
    setups = [one.seconds[0] - each_state * one.traced for one in some if one.setups]
    seconds = each_state * traced + (rooms * float(np.mean(setups)) if without and setups else 0.0)
    read = sum(one.frames for one in some)
    return seconds + sum(one.seconds[1] for one in some) / read * frames


def states(domain: str, case: Case, frames: int, gaps: Gaps) -> tuple[int, int]:
    """Return the number of radar frames of a recording (equal to `frames`), and the number of states of its scene that are ray-traced. For
    a virtual measurement on the turntable, a traced state is one rotation angle of the target. For all other recordings, every frame is
    traced.
    """
    return frames, min(frames, truth.aspects(case.object, gaps)) if domain == MEASURED and case.motion == "turntable" else frames


def expected_bytes(radar: Radar, frames: int, traced: int) -> int:
    """Return the disk space of a recording in the store, in bytes.

    The disk space is the sum of the recording before receiver effects (clean part) and the processed part. The clean part holds samples as
    16-bit counts, or for a turntable the complex signals of one chirp at the traced target angles.
    """
    chirp = radar.num_tx * radar.num_rx * radar.num_samples
    bins = int(MAX_RANGE_M / radar.range_resolution_m) + 1
    read = bins * (4 + 8 * len(azimuth_row(radar)) + (4 * radar.num_chirps if traced == frames else 0))
    return (8 * chirp * traced if traced < frames else 4 * chirp * radar.num_chirps * frames) + read * frames


def metrics(made: Sequence[Made]) -> dict[str, float]:
    """Return the run time per frame in milliseconds for each domain and motion."""
    cost: dict[str, list[Made]] = defaultdict(list)
    for one in made:
        cost[f"{one.domain}_{one.case.motion}_ms"].append(one)
    return {name: 1e3 * sum(sum(one.seconds) for one in some) / sum(one.frames for one in some) for name, some in cost.items()}
