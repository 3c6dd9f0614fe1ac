"""Simulate a target alone in free space, with the drawn target and turntable of a randomisation (radartwin.recognize.randomise)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import TWIN, Case
from radartwin.builders.radar import build_radar
from radartwin.builders.simulator import simulator_options
from radartwin.config.simulator import AutoSimulator, MitsubaSimulator
from radartwin.features.processed import process
from radartwin.recognize import randomise
from radartwin.scene.objects.catalogue import with_other_reflectors
from radartwin.scene.scene import Scene
from radartwin.simulation.simulate import simulate


def record(campaign: Campaign, case: Case, strengths: randomise.Randomisation, seed: Sequence[int]) -> np.ndarray:
    """Return the channels (F, A, B) of a simulated recording's target alone, as radartwin.features.processed defines them."""
    config, nominal = campaign.config, campaign.log(case, TWIN)
    radar = replace(build_radar(config.radar), frame_rate_hz=nominal.frame_rate_hz, num_chirps=1)
    drawn = randomise.target(with_other_reflectors()[case.object].surfaces(contents=config.contents), strengths, seed)
    turned = np.repeat(nominal.target_poses, nominal.frames // len(nominal.target_poses), axis=0)
    motion = {case.object: randomise.poses(turned, strengths, seed)}
    simulator = MitsubaSimulator() if isinstance(config.simulator, AutoSimulator) else config.simulator
    made = simulate(Scene(drawn), radar, nominal.sensor_poses, motion=motion, **simulator_options(simulator))
    return process(made, doppler=False).channels
