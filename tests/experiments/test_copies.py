"""Copies of a real campaign's simulated revolutions: drawn targets are simulated once, and exchanged for the target of the recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fake_campaign import STILL

from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import TWIN
from experiments.campaign.frame import shared
from experiments.recognition import copies
from experiments.recognition.readings import MOTION
from radartwin.config.compose import compose
from radartwin.config.config import Config
from radartwin.io.progress import Progress
from radartwin.recognize import randomise
from radartwin.scene.objects.catalogue import catalogue
from radartwin.store import products
from radartwin.store.products import Store

OBJECTS = ("can_211_300", "can_211_400")
VARIANTS = 2


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Config:
    small = ["profile.campaign.frames_per_turn=13", "profile.campaign.draws=1", "supervision.copies=4", f"supervision.variants={VARIANTS}"]
    objects = f"profile.campaign.turntable_objects=[{','.join(OBJECTS)}]"
    folder = tmp_path_factory.mktemp("copies")
    return compose(["experiment=labelled_probe", "materials=void", objects, *small, f"output={folder}", "tracking=off", "jobs=1"])


@pytest.fixture(scope="module")
def campaign(config: Config) -> Campaign:
    return Campaign(config, Store(Path(config.output) / "cache"), Progress(quiet=True), 0)


def test_drawn_targets_are_simulated_once(config: Config, campaign: Campaign) -> None:
    calls = copies.calls(config)
    assert [case.object for _, _, case, _ in calls] == list(OBJECTS)
    for function, *arguments in calls:
        function(*arguments)
    twins = [case for domain, case in shared(campaign, [MOTION], several=True) if domain == TWIN]
    with products.counting() as counts:
        for number, case in enumerate(twins):
            assert len(copies._alone(config, campaign.store, campaign, case, [config.seed, number])) == 1 + VARIANTS
    assert len(twins) == len(calls)
    assert not counts.by_kind["targets_alone built"]


def test_no_call_simulates_a_target_that_nothing_moves(config: Config) -> None:
    assert copies.calls(compose(["experiment=labelled_probe", *STILL, f"output={config.output}"])) == []


def test_the_exchange_takes_the_target_out_of_the_recording(config: Config, campaign: Campaign) -> None:
    """Without the room, a recording has the target on its stand. Without the echo of the nominal target, little is left in its gate."""
    case = next(case for case in campaign.cases(TWIN, motion=MOTION) if case.object == OBJECTS[1])
    processed = campaign.processed(TWIN, case)[1]
    nominal, *drawn = copies._alone(config, campaign.store, campaign, case, [config.seed, 1])
    assert len(drawn) == VARIANTS
    gate = np.abs(processed.range_m - case.distance_m) < 0.13
    whole, rest = (float(np.mean(np.abs(channels[..., gate]) ** 2)) for channels in (processed.channels, processed.channels - nominal))
    assert rest < 0.1 * whole
    changed = randomise.exchanged(processed, nominal, drawn[0])
    assert changed.channels == pytest.approx(processed.channels - nominal + drawn[0], rel=1e-5, abs=1e-9)


def test_an_echo_outside_the_stored_range_bins_is_below_60_db(campaign: Campaign) -> None:
    case = next(case for case in campaign.cases(TWIN, motion=MOTION) if case.object == OBJECTS[1])
    log, range_m = campaign.log(case, TWIN), campaign.processed(TWIN, case)[1].range_m
    radar = campaign.processed(TWIN, case)[1].radar
    surfaces = catalogue()[case.object].surfaces()
    echo = np.abs(randomise.alone(surfaces, radar, log.sensor_poses, log.target_poses, randomise.Randomisation(), 3))
    outside = np.abs(range_m - case.distance_m) >= copies.NEAR_TARGET_M
    assert echo[..., outside].max() < 1e-3 * echo.max()
