"""Settings that an experiment does not have, or sets itself, are refused in one line before any simulation."""

from __future__ import annotations

from pathlib import Path

import pytest

from radartwin.config.compose import compose
from radartwin.errors import ConfigError
from radartwin.io.progress import Progress
from radartwin.runs.experiment import load
from radartwin.store.products import Store

REFUSED: list[tuple[str, str, str]] = [
    ("turntable_shape", "measured.draw=1", "measured.draw=1 does not exist: the draws of profile=quick are 0 to 0"),
    ("turntable_shape", "measured.draw=-1", "measured.draw=-1 must be zero or above"),
    ("turntable_shape", "measured.gap.object_shape=-0.5", "object_shape"),
    ("turntable_shape", "measured.gap.antennas=1", "antennas"),
    *(("turntable_shape", f"measured.gap.clutter={value}", "must be from 0 to 4") for value in ("4.5", "nan")),
    ("rover_fidelity", "profile.campaign.draws=3 measured.draw=2", "measured.draw=2: the draws of drives are 0 to 0"),
    *(("environment", override, "not read by experiment=environment")
      for override in ("scene=atrium", "scene.target=plate", "trajectory=static")),
    *((name, "measured.gap.clutter=0", "leave measured.gap out") for name in ("gaps", "gap_attribution")),
    ("gaps", "materials=vlm", "leave materials=vlm out"),
    ("gap_attribution", "materials=void", "leave materials=void out"),
    ("scan", "profile.scan_strengths=[0]", "scan_strengths"),
    ("campaign_part", "experiment.part=4 experiment.parts=4", "experiment.part=4 does not exist; parts are 0 to 3"),
    ("headline", "profile.strengths=[0]", "strengths"),
    ("headline", "measured.gap.person=2.5 profile.strengths=[1,2]",
     "profile.strengths=2 multiplies measured.gap: measured.gap.person=5 must be from 0 to 4"),
    ("headline", "profile.strength_campaign.draws=0", "profile.strength_campaign.draws"),
    ("headline", "profile.strength_campaign.rover_rooms=[cellar]", "profile.strength_campaign.rover_rooms=cellar"),
    *(("headline", f"profile.strength_campaign.{kind}_objects=[teapot]", f"strength_campaign.{kind}_objects: unknown object 'teapot'")
      for kind in ("turntable", "rail", "rover")),
]  # fmt: skip


def run(folder: Path, experiment: str, *overrides: str) -> None:
    settings = compose([f"experiment={experiment}", f"output={folder}", *overrides])
    load(settings.experiment).run(settings, Store(folder), Progress(quiet=True))


@pytest.mark.parametrize(("experiment", "overrides", "words"), REFUSED)
def test_a_setting_that_an_experiment_refuses_is_one_line(experiment: str, overrides: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        run(tmp_path, experiment, *overrides.split())
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
