"""Range, angle and speed of a point for radars other than the IWR1843, from the exact two-way phases to every antenna."""

import dataclasses

import numpy as np
import pytest

import radartwin as rt
from radartwin.builders.radar import named_radar
from radartwin.radar.detection import detect

C = 299_792_458.0
RADARS = {
    "iwr6843": named_radar("iwr6843"),
    "awr2243_cascade": dataclasses.replace(named_radar("awr2243_cascade"), num_chirps=8, num_samples=128),  # a quarter of the run time
}


def point_echo(radar: rt.Radar, range_m: float, azimuth_deg: float, speed_mps: float, frames: int = 1) -> rt.Recording:
    """Return a point that moves radially, as seen by antennas at their own places."""
    towards = np.array([np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg)), 0.0])
    frame, chirp, tx = np.ogrid[:frames, : radar.num_chirps, : radar.num_tx]
    time = frame / radar.frame_rate_hz + (chirp * radar.num_tx + tx) * radar.chirp_interval
    place = (range_m + speed_mps * time)[..., None] * towards
    out = np.linalg.norm(place - radar.tx_positions, axis=-1)
    back = np.linalg.norm(place[..., None, :] - radar.rx_positions, axis=-1)
    frequency = radar.start_frequency_hz + radar.slope_hz_per_s * np.arange(radar.num_samples) / radar.sample_rate_hz
    phase = 2 * np.pi / C * frequency * (out[..., None] + back)[..., None]
    rng = np.random.default_rng(0)
    noise = 1e-3 * (rng.standard_normal(phase.shape) + 1j * rng.standard_normal(phase.shape))
    return rt.Recording((np.exp(1j * phase) + noise).astype(np.complex64), radar)


@pytest.mark.parametrize("name", RADARS)
def test_detected_peak_has_range_angle_and_speed(name):
    """A carrier of 77 GHz in place of 60 GHz would turn 35 degrees into 27 and change the speed by 21 %."""
    radar, azimuth_deg, speed_mps = RADARS[name], -35.0, 0.4
    recording = point_echo(radar, 5.0, azimuth_deg, speed_mps)
    peaks = detect(recording.iq, radar)
    middle_m = 5.0 + speed_mps * radar.frame_duration_s / 2
    assert peaks.range_m[0] == pytest.approx(middle_m, abs=0.05 * radar.range_resolution_m + 0.005)
    # At 5 m, the point is in the near field of the cascade, whose beam of 1.2 degrees blurs but stays centred.
    assert np.degrees(peaks.azimuth_rad[0]) == pytest.approx(azimuth_deg, abs=0.3)
    assert peaks.velocity_mps[0] == pytest.approx(speed_mps, abs=radar.velocity_resolution_mps / 10)
