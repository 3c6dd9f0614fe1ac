"""The campaign: every recording of both domains, made where it is missing, and what that took.

Resumable at any moment: what is finished is in the store, and the same command makes the rest. Times are those that were taken when each
recording was made, by whichever process; several at once share the whole campaign's time. Disk is what its files hold. In other profiles
the paper's campaign is extrapolated, its disk from shapes, its time per domain and motion: from the time of a set-up (a track, a room that
creeps), of a traced state (an aspect of a turntable, a frame of a drive) and of a frame that is processed. A set-up's share is told from
the recordings that found theirs made; without any, each recording pays its own.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

import numpy as np

from experiments.campaign import tally, truth
from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import Case, planned
from experiments.campaign.cases import log as nominal_log
from experiments.campaign.twin import VOID
from experiments.claims import NONE, Claim, row
from experiments.scans import virtual_scan
from experiments.statistics import Estimate
from radartwin.build.radar import build_radar
from radartwin.config.compose import compose
from radartwin.config.config import Config
from radartwin.config.study import CampaignConfig
from radartwin.features.processed import MAX_RANGE_M
from radartwin.io.progress import Progress
from radartwin.radar.chirp import Radar
from radartwin.radar.processing import azimuth_row
from radartwin.runs import workers
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Product, Store
from radartwin.testbed.testbed import Gaps

TABLE = Table(
    name="campaign",
    title="The recordings of both domains",
    caption="Every recording that the other tables share, and the time, memory and disk space that making it took on this machine. "
    "Recordings are clean and processed. Turntables are traced at the aspects of one revolution; drives share the set-up of "
    "their track. The project chose the targets. Intervals are bootstraps over recordings.",
)

MEASURED, TWIN = "measured", "twin"
ALL = "all"
_COLUMNS = ("of", "motion", "made", "found", "frames", "traced", "set_ups")
LABELS = {MEASURED: "measured", TWIN: "simulated"}
ROUNDED_S = 2.0  # of the times kept with a product
FRAME = Claim("a measured frame takes at most 60 ms", below=60.0, least=1)
DISK = Claim("the paper's campaign takes at most 10 GB", below=10.0, least=1)
MINUTES = Claim("the paper's campaign is made within 60 minutes", below=60.0, least=1)


@dataclass(frozen=True)
class Made:
    """What one recording took: the making of what is kept, and of what features are read from.

    Attributes:
        now: whether this run made it.
        seconds, core_seconds, bytes: (clean, processed) each.
        frames, traced: frames of the recording, states that were traced for it.
        setups: of tracks and rooms, made with it; others found them.
    """

    domain: str
    case: Case
    keys: tuple[str, ...]
    now: bool
    seconds: tuple[float, float]
    core_seconds: tuple[float, float]
    bytes: tuple[int, int]
    frames: int
    traced: int
    setups: int


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Make what is missing and tell what it took. Raises UserError for a campaign that cannot be made."""
    campaign = Campaign(config, store, progress)
    made = make(campaign, progress)
    return Result(TABLE.name, rows(config, made), {}, metrics(made), [key for one in made for key in one.keys])


def make(campaign: Campaign, progress: Progress) -> list[Made]:
    """Every recording of the campaign, in the order of its plan."""
    wanted = campaign.plan()
    missing = [one for one in wanted if not campaign.holds(*one)]
    gaps = truth.gaps_of(campaign.config)
    counts = [states(domain, case, campaign.log(case, domain).frames, gaps) for domain, case in missing]
    size = sum(expected_bytes(build_radar(campaign.config.radar), *count) for count in counts)
    told = f"{len(wanted)} recordings, {len(missing)} of them to be made: {sum(frames for frames, _ in counts):,} frames"
    progress.say(f"campaign: {told} from {sum(traced for _, traced in counts):,} traced states, about {size / 1e9:.2g} GB")
    campaign.prepare(missing, fresh=True)
    return _with_scans(
        campaign, [_made(campaign, domain, case, (domain, case) in missing) for domain, case in progress.over(wanted, "recordings")]
    )


def _made(campaign: Campaign, domain: str, case: Case, now: bool) -> Made:
    clean = campaign.clean(domain, case)
    processed = campaign.process(domain, case)
    first, second = clean.read_json("meta"), processed.read_json("meta")
    told = first["told"]
    seconds, core_seconds = ((float(first[name]), float(second[name])) for name in ("seconds", "core_seconds"))
    return Made(
        domain, case, (clean.key, processed.key), now, seconds, core_seconds, (_size(clean), _size(processed)),
        told["frames"], told["traced"], told.get(tally.SETUPS, 0),
    )  # fmt: skip


def _with_scans(campaign: Campaign, made: list[Made]) -> list[Made]:
    """A room's scan belongs to the first simulated recording of the room, also where it was made before it."""
    out, config, store = list(made), campaign.config, campaign.store
    strength = config.measured.gap.geometry
    if config.materials.source == VOID:
        return out  # no scan
    for room in dict.fromkeys(one.case.room for one in made if one.domain == TWIN):
        if not store.holds(virtual_scan.KIND, virtual_scan.specification(config, room, strength), virtual_scan.ROOTS):
            continue  # nothing was scanned for it
        ours = [k for k, one in enumerate(made) if one.domain == TWIN and one.case.room == room]
        scan = virtual_scan.fetch(config, store, room, strength).read_json("meta")
        ended = _seconds(scan["finished"])
        began = ended - float(scan["seconds"])
        spans = [(_seconds(meta["finished"]) - float(meta["seconds"]), _seconds(meta["finished"])) for meta in _metas(campaign, made, ours)]
        if not any(low - ROUNDED_S <= began and ended <= high + ROUNDED_S for low, high in spans):
            first = out[ours[0]]
            seconds, core = (
                (first_[0] + float(scan[name]), first_[1])
                for first_, name in ((first.seconds, "seconds"), (first.core_seconds, "core_seconds"))
            )
            out[ours[0]] = replace(first, seconds=seconds, core_seconds=core, setups=first.setups + 1)
    return out


def _metas(campaign: Campaign, made: Sequence[Made], some: Sequence[int]) -> list[dict[str, Any]]:
    """When and how long the clean recordings of these were made."""
    return [campaign.clean(made[k].domain, made[k].case).read_json("meta") for k in some]


def _seconds(time: str) -> float:
    return datetime.fromisoformat(time).timestamp()


def _size(product: Product) -> int:
    return sum(path.stat().st_size for path in product.path.rglob("*") if path.is_file())


def rows(config: Config, made: Sequence[Made]) -> list[dict[str, Any]]:
    """Per domain and motion, then of each domain, then of the paper's campaign."""
    out: list[dict[str, Any]] = []
    for domain in (MEASURED, TWIN):
        own = [one for one in made if one.domain == domain]
        for motion in dict.fromkeys(one.case.motion for one in own):
            out += _group(config, domain, motion, [one for one in own if one.case.motion == motion])
        if own:
            out += _group(config, domain, ALL, own)
    return out + (_paper(config, made) if config.measured.provider == "testbed" else [])


def _group(config: Config, domain: str, motion: str, some: Sequence[Made]) -> list[dict[str, Any]]:
    keys = [one.keys[0] for one in some]
    frames = np.array([one.frames for one in some], float)
    wall, core = (1e3 * np.array([sum(getattr(one, name)) for one in some]) for name in ("seconds", "core_seconds"))
    now = sum(one.now for one in some)
    case = {
        "of": LABELS[domain], "motion": motion, "made": now, "found": len(some) - now, "frames": int(frames.sum()),
        "traced": sum(one.traced for one in some), "set_ups": sum(one.setups for one in some),
    }  # fmt: skip
    claim = FRAME if domain == MEASURED and motion == ALL and config.measured.provider == "testbed" else NONE
    figures = [
        ("wall time per frame (ms)", _ratio(wall, frames, config), claim),
        ("core time per frame (ms)", _ratio(core, frames, config), NONE),
        ("disk (MB)", _exactly(sum(sum(one.bytes) for one in some) / 1e6, len(some)), NONE),
    ]
    return [row(config, case, metric, found, keys, said) for metric, found, said in figures]


def _paper(config: Config, made: Sequence[Made]) -> list[dict[str, Any]]:
    """Time and disk of the paper's campaign: its own, or extrapolated from these recordings where every motion has some."""
    paper = compose(["profile=paper"]).profile.campaign
    own = config.profile.campaign == paper
    label = "" if own else ", extrapolated"
    cost: dict[tuple[str, str], list[Made]] = defaultdict(list)
    for one in made:
        cost[one.domain, one.case.motion].append(one)
    wanted: dict[tuple[str, str], list[Case]] = defaultdict(list)
    for domain in (MEASURED, TWIN):
        for case in planned(paper, domain == MEASURED):
            wanted[domain, case.motion].append(case)
    minutes, disk = np.nan, np.nan
    if own:
        minutes, disk = sum(sum(one.seconds) for one in made) / 60, sum(sum(one.bytes) for one in made) / 1e9
    elif all(group in cost for group in wanted):
        minutes = sum(_extrapolated(cost[domain, motion], domain, cases, paper) for (domain, motion), cases in wanted.items()) / 60
        radar = build_radar(config.radar)
        counts = [count for (domain, _), cases in wanted.items() for count in _states(domain, cases, paper)]
        disk = sum(expected_bytes(radar, *count) for count in counts) / 1e9
    at_once = workers.worker_count(config.jobs, sum(len(cases) for cases in wanted.values()))
    case = {
        "of": "both", "motion": ALL, "made": sum(one.now for one in made), "found": sum(not one.now for one in made),
        "frames": sum(one.frames for one in made), "traced": sum(one.traced for one in made), "set_ups": sum(one.setups for one in made),
    }  # fmt: skip
    keys = [one.keys[0] for one in made]
    return [
        row(
            config,
            case,
            f"time of the paper's campaign, {at_once} at once (min){label}",
            _exactly(minutes / at_once, len(made)),
            keys,
            MINUTES,
        ),
        row(config, case, f"disk of the paper's campaign (GB){label}", _exactly(disk, len(made)), keys, DISK),
    ]


def _states(domain: str, cases: Sequence[Case], campaign: CampaignConfig) -> list[tuple[int, int]]:
    """(frames, states to be traced) of each planned case."""
    lengths = [nominal_log(case, campaign, measured=domain == MEASURED).frames for case in cases]
    return [states(domain, case, length, Gaps()) for case, length in zip(cases, lengths, strict=True)]


def _extrapolated(some: Sequence[Made], domain: str, cases: Sequence[Case], paper: CampaignConfig) -> float:
    """Seconds of these cases of one domain and motion, from what others of the same took."""
    frames, traced = np.sum(_states(domain, cases, paper), axis=0)
    without = [one for one in some if not one.setups]
    plain = without or some
    each_state = sum(one.seconds[0] for one in plain) / sum(one.traced for one in plain)
    setups = [one.seconds[0] - each_state * one.traced for one in some if one.setups]
    places = len({case.room for case in cases})
    seconds = each_state * traced + (places * float(np.mean(setups)) if without and setups else 0.0)
    read = sum(one.frames for one in some)
    return seconds + sum(one.seconds[1] for one in some) / read * frames


def states(domain: str, case: Case, frames: int, gaps: Gaps) -> tuple[int, int]:
    """(frames, states to be traced) of a recording of so many."""
    return frames, min(frames, truth.aspects(case, gaps)) if domain == MEASURED and case.motion == "turntable" else frames


def expected_bytes(radar: Radar, frames: int, traced: int) -> int:
    """Of a recording in the store: its samples as counts, or its aspects of one chirp as complex numbers, and what is processed."""
    chirp = radar.num_tx * radar.num_rx * radar.num_samples
    bins = int(MAX_RANGE_M / radar.range_resolution_m) + 1
    read = bins * (4 + 8 * len(azimuth_row(radar)) + (4 * radar.num_chirps if traced == frames else 0))
    return (8 * chirp * traced if traced < frames else 4 * chirp * radar.num_chirps * frames) + read * frames


def metrics(made: Sequence[Made]) -> dict[str, float]:
    """Milliseconds a frame by domain and motion."""
    cost: dict[str, list[Made]] = defaultdict(list)
    for one in made:
        cost[f"{one.domain}_{one.case.motion}_ms"].append(one)
    return {name: 1e3 * sum(sum(one.seconds) for one in some) / sum(one.frames for one in some) for name, some in cost.items()}


def _exactly(value: float, count: int) -> Estimate:
    return Estimate(float(value), float(value), float(value), count)


def _ratio(above: np.ndarray, below: np.ndarray, config: Config) -> Estimate:
    """Sum over sum, with a bootstrap over recordings."""
    value = float(above.sum() / below.sum())
    chosen = np.random.default_rng(config.seed).integers(len(above), size=(config.profile.resamples, len(above)))
    low, high = np.quantile(above[chosen].sum(axis=1) / below[chosen].sum(axis=1), [0.025, 0.975])
    return Estimate(value, min(float(low), value), max(float(high), value), len(above))


def page(found: Iterable[dict[str, Any]]) -> str:
    """The rows as a table for a terminal: a line per domain and motion, then what is claimed."""
    found = list(found)
    told: dict[tuple[str, ...], dict[str, Any]] = defaultdict(dict)
    for one in found:
        if one["of"] != "both":
            told[tuple(_text(one[column]) for column in _COLUMNS)][one["metric"]] = one["value"]
    metrics = list(dict.fromkeys(metric for values in told.values() for metric in values))
    lines = [(*(column.replace("_", "-") for column in _COLUMNS), *metrics)]
    lines += [(*key, *(_text(values.get(metric)) for metric in metrics)) for key, values in told.items()]
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    text = ["  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)) for line in lines]
    text += [f"{one['metric']}: {_text(one['value'])} ({one['claim']}: {one['verdict']}; n {one['n']})" for one in found if one["claim"]]
    return "\n".join(text)


def _text(value: float | str | None) -> str:
    if value is None or isinstance(value, str):
        return value or "-"
    return f"{value:,.0f}" if abs(value) >= 100 or value == round(value) else f"{value:.3g}"
