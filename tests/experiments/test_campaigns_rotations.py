"""The revolutions of one simulated measurement differ by modelled causes, by more than the receiver noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from experiments.campaign.campaign import Campaign, load_clean
from radartwin.config.compose import compose
from radartwin.features.processed import process
from radartwin.io.progress import Progress
from radartwin.store.products import Store

pytestmark = pytest.mark.slow
TURN = 20  # frames per revolution
GATE_M, ROOM_M = (0.87, 1.13), (2.3, 5.5)


def changes_db(folder: Path, name: str, *more: str) -> dict[tuple[float, float], float]:
    """Return, by range window, the mean power in decibels over the noise of the change between two revolutions without noise."""
    config = compose([
        "experiment=campaign", "measured.gap.solver=0", f"profile.campaign.turntable_objects=[{name}]", f"output={folder}",
        "profile.campaign.reflector_distances_m=[1.0]", f"profile.campaign.frames_per_turn={TURN}", *more,
    ])  # fmt: skip
    campaign = Campaign(config, Store(folder / "cache"), Progress(quiet=True), draw=0)
    (case,) = campaign.cases("measured", motion="turntable", repetition=0)
    clean = process(load_clean(campaign.clean("measured", case)), doppler=False)
    noise = campaign.processed("measured", case)[1].noise
    assert noise is not None
    change = (np.abs(clean.channels[:TURN] - clean.channels[TURN:]) ** 2).mean(axis=(0, 1)) / 2
    windows = {(low, high): (clean.range_m >= low) & (clean.range_m <= high) for low, high in (GATE_M, ROOM_M)}
    return {bounds: float(10 * np.log10(max(change[inside].mean(), 1e-30) / noise[inside].mean())) for bounds, inside in windows.items()}


def test_revolutions_differ_by_more_than_noise(tmp_path: Path) -> None:
    """Speed error, ripple and jitter shift the samples of a revolution, and without them the turntable still creeps."""
    reflector = changes_db(tmp_path, "corner_reflector")
    assert reflector[GATE_M] > 20
    assert reflector[ROOM_M] > 10
    can = changes_db(tmp_path, "can_211_400")
    assert can[ROOM_M] > 10
    assert can[GATE_M] > 0  # the motor below the disc moves slowly (creeps) while it warms up
    creeping = changes_db(tmp_path, "can_211_400", "measured.gap.trajectory=0", "measured.gap.person=0")
    assert creeping[ROOM_M] > 3
    alike = changes_db(tmp_path, "can_211_400", "measured.gap.trajectory=0", "measured.gap.person=0", "measured.gap.clutter=0")
    assert max(alike.values()) < -6  # the remaining change is rounding in the tracer and in the 16-bit samples
    assert alike[ROOM_M] < creeping[ROOM_M] - 20
    print({"reflector": reflector, "can": can, "creeping alone": creeping, "nothing": alike})
