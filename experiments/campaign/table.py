"""The table `campaign`: run time and disk space of every measured and simulated recording. Missing recordings are simulated.

The run time of a recording is the time that one worker took. The profile `paper` measures the paper's campaign; all other profiles
extrapolate it: the disk space from array shapes, and the run time as a sum over domains and motions of the times of set-ups (a track, or a
room whose parts drift), of traced states (an angle of a turntable, or a frame of a drive), and of processed frames. The time per traced
state comes from the recordings that reused a set-up; what another recording takes longer is its set-up time.
"""

from collections import defaultdict
from collections.abc import Sequence
from datetime import datetime
from typing import Any

import numpy as np

from experiments.campaign import packed, tally, truth
from experiments.campaign.campaign import Campaign, make_together
from experiments.campaign.cases import COMPARED, LABELS, MEASURED, TWIN, VOID, Case, planned
from experiments.campaign.cases import log as nominal_log
from experiments.campaign.frame import Frame
from experiments.campaign.schedule import RecordingTask
from experiments.interface import Config, Progress, Result, Store, Table
from experiments.scans import virtual_scan
from experiments.statistics import exact, ratio
from experiments.verdicts import BELOW, NONE, Claim, RowList
from radartwin.builders.radar import build_radar
from radartwin.config.compose import compose
from radartwin.config.study import CampaignConfig
from radartwin.features.processed import MAX_RANGE_M
from radartwin.io.one_line import plural
from radartwin.radar.chirp import Radar
from radartwin.radar.processing import azimuth_row
from radartwin.runs import workers
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


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Simulate the missing recordings and tabulate run time and disk space of all. Raises UserError if a recording cannot be simulated."""
    made = make(Campaign(config, store, progress), progress)
    return Result(TABLE.name, rows(config, made), {}, metrics(made), made[["key", "processed_key"]].to_numpy().ravel().tolist())


def recordings(config: Config, store: Store, progress: Progress) -> dict[str, RecordingTask]:
    campaign = Campaign(config, store, progress)
    return campaign.missing(campaign.plan())


def make(campaign: Campaign, progress: Progress) -> Frame:
    """Simulate the missing recordings, and return the columns of `_made` of all recordings in the order of `Campaign.plan`."""
    import pandas as pd

    wanted = campaign.plan()
    missing = campaign.missing(wanted)
    gaps = truth.gaps_of(campaign.config)
    counts = [states(task.domain, task.case, campaign.log(task.case, task.domain).frames, gaps) for task in missing.values()]
    radar = build_radar(campaign.config.radar)
    size = sum(expected_bytes(radar, task.case.motion, *count) for task, count in zip(missing.values(), counts, strict=True))
    frames, traced = (sum(count[k] for count in counts) for k in (0, 1))
    progress.say(
        f"campaign: {plural(len(wanted), 'recording')}, {len(missing)} of them to be simulated: {frames:,} frames from {traced:,} traced "
        f"poses, about {size / 1e9:.2g} GB"
    )
    make_together(missing, campaign.config.jobs, progress, fresh=True)
    made = pd.DataFrame([_made(campaign, domain, case) for domain, case in progress.over(wanted, "recordings")])
    return _with_scans(campaign, made)


def _made(campaign: Campaign, domain: str, case: Case) -> dict[str, Any]:
    """Return run times and disk space of one recording. `set_ups` counts the tracks and rooms that were set up for this recording."""
    clean, processed = products = campaign.clean(domain, case), campaign.process(domain, case)
    first, second = (product.read_json("meta") for product in products)
    counts, (began_s, ended_s) = first["told"], _span_s(first)
    paths = [path for product in products for path in product.path.rglob("*")]
    return {
        "domain": domain, "motion": case.motion, "room": case.room, "draw": case.draw, "key": clean.key, "processed_key": processed.key,
        "clean_s": float(first["seconds"]), "processing_s": float(second["seconds"]),
        "core_s": float(first["core_seconds"]) + float(second["core_seconds"]),
        "bytes": sum(path.stat().st_size for path in paths if path.is_file()),
        "began_s": began_s, "ended_s": ended_s,
        "frames": counts["frames"], "traced": counts["traced"], "set_ups": counts.get(tally.SETUPS, 0),
    }  # fmt: skip


def _with_scans(campaign: Campaign, made: Frame) -> Frame:
    """Add the run time of each room's phone scan to the first recording simulated in that room, if the scan was simulated separately."""
    config, store, strength = campaign.config, campaign.store, campaign.config.measured.gap.geometry
    if config.materials.source == VOID:
        return made  # no scan
    for room, simulated in made[made.domain == TWIN].groupby("room", sort=False):
        spec = virtual_scan.specification(config, room, strength)
        if "shipped" in spec or not store.holds(virtual_scan.KIND, spec, virtual_scan.ROOTS):
            continue  # no scan
        scan = virtual_scan.fetch(config, store, room, strength).read_json("meta")
        began, ended = _span_s(scan)
        if not ((simulated.began_s - ROUNDED_S <= began) & (ended <= simulated.ended_s + ROUNDED_S)).any():
            made.loc[simulated.index[0], ["clean_s", "core_s", "set_ups"]] += [float(scan["seconds"]), float(scan["core_seconds"]), 1]
    return made


def _span_s(meta: dict[str, Any]) -> tuple[float, float]:
    """Return start and end time of the computation of a stored result, in seconds."""
    ended = datetime.fromisoformat(meta["finished"]).timestamp()
    return ended - float(meta["seconds"]), ended


def rows(config: Config, made: Frame) -> RowList:
    """Build the table rows: one group per domain and motion, one per domain, and one for the paper's campaign."""
    out = RowList(config)
    for domain in COMPARED:
        of_domain = made[made.domain == domain]
        for motion, of_motion in of_domain.groupby("motion", sort=False):
            _add_group(out, domain, motion, of_motion)
        if len(of_domain):
            _add_group(out, domain, ALL, of_domain)
    if config.measured.provider == "testbed":
        _add_paper(out, made)
    return out


def _case(of: str, motion: str, made: Frame) -> dict[str, Any]:
    return {"of": of, "motion": motion, "recordings": len(made)} | made[["frames", "traced", "set_ups"]].sum().astype(int).to_dict()


def _add_group(rows: RowList, domain: str, motion: str, made: Frame) -> None:
    """Add rows with the time per frame and the disk space of the recordings of one domain and motion."""
    keys, case, config = list(made.key), _case(LABELS[domain], motion, made), rows.config
    claim = FRAME if domain == MEASURED and motion == ALL and config.measured.provider == "testbed" else NONE
    for kind, seconds, row_claim in (("wall", made.clean_s + made.processing_s, claim), ("core", made.core_s, NONE)):
        estimate = ratio(1e3 * seconds.to_numpy(), made.frames.to_numpy(float), config.profile.resamples, config.seed)
        rows.add(case, f"{kind} time per frame (ms)", estimate, keys, row_claim)
    rows.add(case, "disk (MB)", exact(made.bytes.sum() / 1e6, len(made)), keys)


def _add_paper(rows: RowList, made: Frame) -> None:
    """Add run time and disk space of the paper's campaign: measured with profile=paper, otherwise extrapolated if every motion is timed."""
    config, paper = rows.config, compose(["profile=paper"]).profile.campaign
    cases = [(domain, case) for domain in COMPARED for case in planned(paper, domain == MEASURED)]
    count = workers.worker_count(config.jobs, len(cases))
    keys, case = list(made.key), _case("both", ALL, made)
    is_paper = config.profile.campaign == paper
    label = f"{count} at once" + ("" if is_paper else ", extrapolated")
    for draws, minutes, disk in (("one draw", MINUTES, DISK), ("all draws", ALL_MINUTES, NONE)):
        wanted = [(domain, recording) for domain, recording in cases if draws == "all draws" or not recording.draw]
        if is_paper:
            of_draws = made if draws == "all draws" else made[made.draw == 0]
            seconds, size = (of_draws.clean_s + of_draws.processing_s).sum(), of_draws.bytes.sum()
        else:
            seconds, size = _expected(config, paper, wanted, made)
        rows.add(case, f"time of the paper's campaign, {draws}, {label} (min)", exact(seconds / 60 / count, len(made)), keys, minutes)
        rows.add(case, f"disk of the paper's campaign, {draws}, {label} (GB)", exact(size / 1e9, len(made)), keys, disk)


def _expected(config: Config, paper: CampaignConfig, wanted: Sequence[tuple[str, Case]], made: Frame) -> tuple[float, float]:
    """Extrapolate (seconds in one process, bytes) of the recordings `wanted` from those of `made`; NaN if a motion has none."""
    recorded = dict(list(made.groupby(["domain", "motion"])))
    groups: dict[tuple[str, str], list[Case]] = defaultdict(list)
    for domain, case in wanted:
        groups[domain, case.motion].append(case)
    if not all(group in recorded for group in groups):
        return np.nan, np.nan
    radar = build_radar(config.radar)
    seconds, size = 0.0, 0.0
    for group, cases in groups.items():
        lengths = [nominal_log(case, paper, measured=group[0] == MEASURED).frames for case in cases]
        counts = [states(group[0], case, frames, Gaps()) for case, frames in zip(cases, lengths, strict=True)]
        seconds += extrapolated(recorded[group], counts, len({(case.room, case.draw) for case in cases}))
        size += sum(expected_bytes(radar, group[1], *count) for count in counts)
    return seconds, size


def extrapolated(timed: Frame, counts: Sequence[tuple[int, int]], rooms: int) -> float:
    """Extrapolate the run time in seconds of recordings with these (frames, traced states) from `timed` ones of the same kind."""
    frames, traced = np.sum(counts, axis=0)
    without, setting_up = timed[timed.set_ups == 0], timed[timed.set_ups > 0]
    plain = without if len(without) else timed
    each_state = plain.clean_s.sum() / plain.traced.sum()
    setup_s = (setting_up.clean_s - each_state * setting_up.traced).mean() if len(without) and len(setting_up) else 0.0
    return float(each_state * traced + rooms * setup_s + timed.processing_s.sum() / timed.frames.sum() * frames)


def states(domain: str, case: Case, frames: int, gaps: Gaps) -> tuple[int, int]:
    """Return the number of frames of a recording, and that of its traced states: frames, or angles of a measured turntable's target."""
    return frames, min(frames, truth.aspects(case.object, gaps)) if domain == MEASURED and case.motion == "turntable" else frames


def expected_bytes(radar: Radar, motion: str, frames: int, traced: int) -> int:
    """Return the disk space of a recording in the store, in bytes.

    The disk space is the sum of the recording before receiver effects (clean part) and the processed part. The clean part holds samples as
    packed 16-bit counts, or for a turntable the complex signals of one chirp at the traced target angles.
    """
    chirp = radar.num_tx * radar.num_rx * radar.num_samples
    bins = int(MAX_RANGE_M / radar.range_resolution_m) + 1
    read = bins * (4 + 8 * len(azimuth_row(radar)) + (4 * radar.num_chirps if traced == frames else 0))
    packed_frame = int(packed.SHARES[motion == "turntable"] * 4 * chirp * radar.num_chirps)
    return (8 * chirp * traced if traced < frames else packed_frame * frames) + read * frames


def metrics(made: Frame) -> dict[str, float]:
    """Return the run time per frame in milliseconds for each domain and motion."""
    cost = made.groupby(["domain", "motion"], sort=False)[["clean_s", "processing_s", "frames"]].sum()
    each = 1e3 * (cost.clean_s + cost.processing_s) / cost.frames
    return {f"{domain}_{motion}_ms": value for (domain, motion), value in each.to_dict().items()}
