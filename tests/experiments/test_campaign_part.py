"""The parts of the campaign that the jobs of a sweep simulate."""

from __future__ import annotations

from pathlib import Path

import pytest

from experiments.campaign.campaign import Campaign
from experiments.campaign.part import part
from radartwin.config.compose import compose
from radartwin.errors import ConfigError
from radartwin.io.progress import Progress
from radartwin.store.products import Store


@pytest.mark.parametrize("parts", [1, 7, 100])
def test_parts_have_every_recording_once(tmp_path: Path, parts: int) -> None:
    plan = Campaign(compose(["experiment=campaign_part"]), Store(tmp_path), Progress(quiet=True)).plan()
    found = [part(plan, number, parts) for number in range(parts)]
    assert [one for some in found for one in some] == plan
    assert max(map(len, found)) - min(map(len, found)) <= 1


def test_a_part_beyond_the_last_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"experiment\.part=4 does not exist; parts are 0 to 3"):
        compose(["experiment=campaign_part", "experiment.part=4", "experiment.parts=4"])
