"""Tests of the gallery: its pairs of recordings, and range-Doppler maps on one colour scale with the logged target."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest

from experiments.campaign import gallery
from experiments.campaign.cases import Case, Motion, log
from radartwin.config.compose import compose
from radartwin.config.study import CampaignConfig
from radartwin.errors import ConfigError
from radartwin.features.processed import Processed, process
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording

RADAR = Radar.iwr1843()
C = 299_792_458.0


def recording(case: Case, amplitude: float = 1e-3) -> Recording:
    """Return the recording of a point echo at the logged range of the target, sampled by the definition of the beat signal."""
    course = log(case, CampaignConfig(frames_per_turn=20, turns=1), measured=False)
    azimuth, speed, distance = gallery.course(course, course.frames)
    time = RADAR.chirp_times()[None, :, :, None, None]
    sample = np.arange(RADAR.num_samples) / RADAR.sample_rate_hz
    direction = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)], axis=-1)
    path = 2 * distance[:, None, None, None, None] + 2 * speed[:, None, None, None, None] * time
    nearer = (RADAR.tx_positions @ direction.T).T[:, None, :, None, None] + (RADAR.rx_positions @ direction.T).T[:, None, None, :, None]
    iq = amplitude * np.exp(2j * np.pi * (RADAR.start_frequency_hz + RADAR.slope_hz_per_s * sample) * (path - nearer) / C)
    return Recording(iq.astype(np.complex64), RADAR)


def seen(case: Case) -> tuple[gallery.View, Processed]:
    made = recording(case)
    processed = process(made, doppler=False)
    course = log(case, CampaignConfig(frames_per_turn=20, turns=1), measured=False)
    return gallery.view(processed, course, lambda: made), processed


@pytest.mark.parametrize("motion", ["turntable", "diagonal", "depth", "lateral"])
def test_the_maps_peak_at_the_logged_target(motion: Motion) -> None:
    room = "squash_court" if motion in ("depth", "lateral") else "lab"
    view, _ = seen(Case("corner_reflector", room, motion, 1.0))
    for panel, tolerance in (("time", None), ("Doppler", 0.15), ("azimuth", 3.0)):
        power = view.maps[panel]
        across, range_m = view.truth[panel]
        if panel == "time":
            peaks = view.range_m[power.argmax(axis=1)]
            np.testing.assert_allclose(peaks, range_m, atol=RADAR.range_resolution_m)
            np.testing.assert_array_equal(across, view.across[panel])
            continue
        place, bin_of = np.unravel_index(power.argmax(), power.shape)
        assert view.range_m[bin_of] == pytest.approx(range_m[0], abs=RADAR.range_resolution_m)
        if not np.isnan(across[0]):
            assert view.across[panel][place] == pytest.approx(across[0], abs=tolerance)
        elif panel == "Doppler":
            assert view.across[panel][place] == 0  # at a turning point of the motion, the Doppler shift is zero


@pytest.mark.parametrize(
    ("pair", "message"),
    [
        ("mug/lab/turntable", "OBJECT/ROOM/MOTION/DISTANCE_M"),
        ("teapot/lab/turntable/1", "unknown object 'teapot'; choose corner_reflector"),
        ("mug/lab/spiral/1", "unknown motion 'spiral'; choose turntable"),
        ("mug/atrium/turntable/1", "motion turntable is not recorded in 'atrium'; choose lab"),
        ("mug/lab/lateral/1", "motion lateral is not recorded in 'lab'; choose atrium or squash_court"),
        ("mug/lab/turntable/near", "not a distance"),
        ("mug/lab/turntable/9", "0.5 to 2.5 m"),
        ("mug/lab/turntable/nan", "0.5 to 2.5 m"),
    ],
)
def test_unknown_pairs_give_a_one_line_error(pair: str, message: str) -> None:
    with pytest.raises(ConfigError, match=r"experiment.pairs") as error:
        gallery.parse(pair)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_pairs_are_chosen_by_configuration() -> None:
    made = compose(["experiment=gallery", "experiment.pairs=[mug/squash_court/lateral/1,mustard/lab/turntable/0.5]"])
    assert [gallery.parse(pair) for pair in made.experiment.pairs] == [
        Case("mug", "squash_court", "lateral", 1.0), Case("mustard", "lab", "turntable", 0.5),
    ]  # fmt: skip
    for profile, pairs in gallery.PAIRS.items():
        named = compose(["experiment=gallery", f"profile={profile}"])
        assert gallery.cases_to_draw(named, cast(Any, None)) == [gallery.parse(pair) for pair in pairs]
