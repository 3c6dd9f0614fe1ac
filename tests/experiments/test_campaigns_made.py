"""Tests of the table of the virtual measurement campaign, whose recordings are synthetic noise: counts, times and disk space."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from experiments.campaign import packed, table, tally, truth, twin
from experiments.campaign.campaign import Campaign, load_clean
from experiments.campaign.cases import Case, log
from experiments.campaign.turned import Turned
from radartwin.builders.radar import build_radar
from radartwin.config.compose import compose
from radartwin.config.config import Config
from radartwin.io.progress import Progress
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.runs.experiment import check_rows
from radartwin.simulation.aspects import Aspects
from radartwin.store.products import Store
from radartwin.testbed.bystander import Echo
from radartwin.testbed.drift import Drift

TINY = [
    "jobs=1", "experiment=campaign", "materials=void", "profile.resamples=200", "profile.campaign.turntable_objects=[can_211_400]",
    "profile.campaign.frames_per_turn=40", "profile.campaign.turns=8", "profile.campaign.rail_repeats=1", "profile.campaign.draws=1",
    "profile.campaign.rover_objects=[mug]", "profile.campaign.rover_every=25", "profile.campaign.rover_repeats=2",
]  # fmt: skip
PAUSE_S = 0.05


def noise(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return (1e-6 * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))).astype(np.complex64)


def simulated(case: Case, nominal: Any, config: Config, *more: Any) -> Recording | Turned:
    return record(case, config, measured=False)


def record(case: Case, config: Config, measured: bool = True) -> Recording | Turned:
    """Return a recording of noise after a pause for the simulation; the first recording of a motion pauses twice, for its set-up."""
    rng = np.random.default_rng([*case.name.encode(), measured])
    time.sleep(PAUSE_S)
    if case.repetition == 0:
        time.sleep(PAUSE_S)
        tally.count(tally.SETUPS)
    radar, frames = build_radar(config.radar), log(case, config.profile.campaign, measured).frames
    if case.motion == "turntable" and measured:
        return Turned(Aspects(noise(rng, 192, 2, 4, 256)), rng.uniform(0, 6, (frames, 16, 2)), radar)
    return Recording(noise(rng, frames, 16, 2, 4, 256), radar)


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Config]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(truth, "record", record)
        patch.setattr(twin, "record", simulated)
        patch.setattr(packed, "SHARES", (0.9, 0.9))  # noise hardly compresses
        yield compose([*TINY, f"output={tmp_path_factory.mktemp('campaign')}"])


@pytest.fixture(scope="module")
def store(config: Config) -> Store:
    return Store(Path(config.output) / "cache")


@pytest.fixture(scope="module")
def first_run(config: Config, store: Store) -> tuple[Sequence[dict[str, Any]], list[str]]:
    """Return the table rows and the printed messages of the first run, which simulates all recordings."""
    progress, said = Progress(quiet=True), list[str]()
    progress.say = said.append  # type: ignore[method-assign]
    return table.run(config, store, progress).rows, said


def cell(rows: Sequence[dict[str, Any]], of: str, motion: str, metric: str) -> dict[str, Any]:
    (row,) = [row for row in rows if (row["of"], row["motion"]) == (of, motion) and row["metric"].startswith(metric)]
    return row


def test_counts_and_disk_space_match_the_recordings(first_run: tuple[list[dict[str, Any]], list[str]], store: Store) -> None:
    rows, (first, *_) = first_run
    check_rows("campaign", rows)
    drives = cell(rows, "measured", "depth", "wall")
    assert (drives["recordings"], drives["frames"], drives["traced"], drives["set_ups"]) == (2, 4, 4, 1)
    assert drives["value"] >= 1e3 * 3 * PAUSE_S / 4  # pauses of two recordings and a set-up, divided by four frames
    turning = cell(rows, "measured", "turntable", "wall")
    assert (turning["recordings"], turning["frames"], turning["traced"]) == (1, 320, 192)
    assert cell(rows, "simulated", "turntable", "wall")["frames"] == 40  # the simulation of the scanned room makes a single revolution
    every = [cell(rows, of, "all", "disk (MB)") for of in ("measured", "simulated")]
    assert [row["recordings"] for row in every] == [7, 5]
    frames, traced, disk = (sum(row[column] for row in every) for column in ("frames", "traced", "value"))
    held = sum(path.stat().st_size for kind in ("clean", "processed") for path in (store.root / kind).rglob("*") if path.is_file())
    assert disk == pytest.approx(held / 1e6, rel=1e-6)
    assert f"12 recordings, 12 of them to be simulated: {frames} frames from {traced} traced poses" in first
    assert float(first.split("about ")[1].split(" GB")[0]) == pytest.approx(disk / 1e3, rel=0.2)


def test_a_second_run_simulates_nothing(
    config: Config, store: Store, first_run: tuple[list[dict[str, Any]], list[str]], capsys: pytest.CaptureFixture[str]
) -> None:
    rows, again = first_run[0], table.run(config, store, Progress()).rows
    assert "0 of them to be simulated" in capsys.readouterr().err
    for row, other in zip(rows, again, strict=True):
        assert (other["metric"], other["value"]) == (row["metric"], row["value"])  # the table reports the stored times again


def test_the_papers_campaign_is_extrapolated_from_set_ups_states_and_frames() -> None:
    made = pd.DataFrame({"clean_s": [31.0, 1.0, 1.0], "processing_s": 0.5, "frames": 50, "traced": 50, "set_ups": [1, 0, 0]})
    drives = 6 * [(50, 50)]
    seconds = table.extrapolated(made, drives, 2)
    assert seconds == pytest.approx(2 * 30 + 6 * (1.0 + 0.5))  # set-up of two rooms, and six drives
    alone = table.extrapolated(made[:1], drives, 2)
    assert alone == pytest.approx(6 * 31.5)  # the set-up time is unknown, so each recording includes it


def test_targets_are_judged(config: Config, store: Store, first_run: object) -> None:
    made = table.make(Campaign(config, store, Progress(quiet=True)), Progress(quiet=True))
    for seconds, verdict in ((0.03, "holds"), (0.2, "misses")):  # seconds of each frame
        slow = made.assign(clean_s=(seconds + 1e-4 * np.arange(len(made))) * made.frames, processing_s=0.0, set_ups=0)
        rows = table.rows(config, slow)
        verdicts = {row["claim"]: row["verdict"] for row in rows if row["claim"]}
        assert verdicts[table.FRAME.text] == verdict
        assert verdicts[table.DISK.text] == "holds"
        assert verdicts[table.MINUTES.text] == verdict  # verdict for 70,000 room states


def test_a_turntable_recording_is_stored_as_aspects_without_loss(tmp_path: Path) -> None:
    rng, radar = np.random.default_rng(0), Radar.iwr1843()
    drift = Drift(noise(rng, 3, 2, 4, 256), rng.uniform(-2, 2, 30))
    person = Echo(noise(rng, 1, 1, 2, 4, 256), 0.004 * rng.standard_normal(30))
    turned = Turned(Aspects(noise(rng, 16, 2, 4, 256)), rng.uniform(0, 12, (30, 16, 2)), radar, drift, person, {"kind": "test"})
    turned.save(tmp_path)
    assert Turned.is_in(tmp_path)
    back = Turned.load(tmp_path)
    whole = turned.recording()
    assert np.array_equal(back.recording().iq, whole.iq)
    assert back.provenance == {"kind": "test"}
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) < 0.15 * whole.iq.nbytes
    for part in ("drift", "person"):
        without = replace(turned, **{part: None}).recording()
        assert np.abs(whole.iq - without.iq).max() > 1e-8


def test_a_clean_recording_loads_the_same_from_aspects_and_samples(config: Config, store: Store, first_run: object) -> None:
    campaign = Campaign(config, store, Progress(quiet=True))
    for case in campaign.cases("measured", repetition=0):
        product = campaign.clean("measured", case)
        made = record(case, config)
        expected = made.recording() if isinstance(made, Turned) else made
        off = np.abs(load_clean(product).iq - expected.iq).max()
        assert off <= 1e-4 * np.abs(expected.iq).max()
