"""A recording with more frames per revolution than the model's training is reduced to the frames of the training."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from made_files import recogniser

from radartwin.errors import InputError
from radartwin.features import families
from radartwin.features.log import Nominal
from radartwin.features.processed import Processed
from radartwin.radar.chirp import Radar
from radartwin.recognize.classify import thinned
from radartwin.recognize.model import Recogniser


def model(frames: Any) -> Recogniser:
    made = recogniser()
    return Recogniser(
        made.encoder, made.classes, made.prototypes, made.temperature, made.names, {**made.features, "frames_per_turn": frames},
        made.centre, made.spread,
    )  # fmt: skip


def turning(frames: int, turns: float = 1.0) -> tuple[Processed, Nominal]:
    """Return a recording of an echo at 1 m whose power depends smoothly on the angle, with `frames` frames per revolution."""
    radar = Radar.iwr1843()
    angle = 2 * np.pi * np.arange(round(frames * turns)) / frames
    range_m = np.arange(100, dtype=np.float64) * radar.range_resolution_m
    power = np.zeros((len(angle), 100), np.float32)
    power[:, np.abs(range_m - 1).argmin()] = 2 + np.cos(angle) + 0.5 * np.cos(3 * angle + 1)
    channels = np.repeat(np.sqrt(power)[:, None].astype(np.complex64), 8, axis=1)
    processed = Processed(radar, range_m, power, channels, None, np.zeros(16))
    return processed, Nominal(10.0, np.full(len(angle), 1.0), angle)


@pytest.mark.parametrize(("frames", "turns"), [(250, 1.0), (100, 2.0), (251, 3.3)])
def test_features_equal_those_of_a_recording_with_the_frames_of_the_training(frames: int, turns: float) -> None:
    """The tolerance is the change of the echo within half a frame, which is the largest error of a frame's angle."""
    processed, log = thinned(*turning(frames, turns), model(24))
    assert processed.num_frames == int(24 * turns + 1e-6)
    assert log.angle_rad is not None
    np.testing.assert_allclose(np.diff(log.angle_rad), 2 * np.pi / 24)
    _, expected = families.vector(*turning(24), "rotation", ["brightness"])
    _, features = families.vector(processed, log, "rotation", ["brightness"])
    np.testing.assert_allclose(features, expected, atol=2 * np.pi / frames)


@pytest.mark.parametrize("frames", [None, 250, 300])
def test_a_recording_with_as_many_frames_or_slightly_fewer_stays_as_it_is(frames: int | None) -> None:
    processed, log = turning(250)
    same, same_log = thinned(processed, log, model(frames) if frames else recogniser())
    assert same is processed
    assert same_log is log


def test_too_few_frames_are_refused_with_the_remedy() -> None:
    with pytest.raises(InputError, match=r"24 frames per revolution, but the model was trained with 250; .*--frames 24"):
        thinned(*turning(24), model(250))
    for wrong in (0, 2.5, "many"):
        with pytest.raises(InputError, match="is not a whole number above zero"):
            thinned(*turning(24), model(wrong))
