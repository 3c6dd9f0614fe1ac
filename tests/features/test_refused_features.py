"""Wrong input to the features is refused. Each row is the error, a part of the message, and the call that is refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from echoes import RADAR, echoes
from test_features import AXIS_M, FRAMES, Log, angle, at_rest

from radartwin.errors import ConfigError, InputError, RecordingError
from radartwin.features import align, doppler, envelope, families, normalise, peak_track, profile, range_time, sets
from radartwin.features.processed import Processed, process

AXIS = np.arange(200) * 0.05  # 0 to 9.95 m
POWER = np.ones((3, len(AXIS)))
MADE = process(echoes(3, [(1.0, 1.0)]))
TURN = process(echoes(FRAMES, [(1.0, 1.0)]), doppler=False)
NAN = echoes(2, [(1.0, 1.0)])
NAN.iq[1, 0, 0, 0, 0] = np.nan
ENERGIES = {  # by defect
    "constant": np.ones(20), "zero": np.zeros(20), "negative": -np.ones(20), "nan": np.full(20, np.nan), "matrix": np.ones((4, 5)),
    "short": np.ones(2),
}  # fmt: skip


def vector(log: Log, name: str) -> Callable[[], object]:
    return lambda: families.vector(MADE, log, name)


def fitted(simulated: tuple[int, int], measured: tuple[int, int]) -> Callable[[], object]:
    return lambda: normalise.fit_map(np.zeros(simulated), np.zeros(measured))


ROWS: list[tuple[type[Exception], str, Callable[[], object]]] = [
    (InputError, "above the noise", lambda: envelope.harmonics(np.full(64, -1.0))),
    (InputError, "do not resolve 6 cycles", lambda: envelope.harmonics(np.ones(12))),
    (InputError, "not a revolution", lambda: envelope.revolution(np.ones(32), angle()[:32])),
    (InputError, "turn in one direction", lambda: envelope.revolution(np.ones(128), np.concatenate([angle(), angle()]))),
    (InputError, "not above the noise", lambda: envelope.brightness_db(-np.ones(60), np.full(60, AXIS_M))),
    (InputError, "frame 1 is searched", lambda: peak_track.track(MADE, np.array([0.5, 5.8, 0.5]), np.array([1.0, 6.0, 1.0]), 10.0)),
    (InputError, "three frames", lambda: doppler.range_rate(np.ones(2), 10.0)),
    (InputError, "without Doppler", lambda: doppler.radial_velocity(TURN, 1.0)),
    (ConfigError, r"features\.name=spin is unknown; options: rotation, depth, lateral, raw", vector(at_rest(3, 1.0), "spin")),
    (ConfigError, "track is not in features=rotation", lambda: sets.families("rotation", ["track"])),
    (ConfigError, "excludes every family", lambda: sets.families("raw", ["profile"])),
    (InputError, "3 frames", vector(at_rest(4, 1.0), "depth")),
    (InputError, "no turntable angle", vector(at_rest(3, 1.0), "rotation")),
    (InputError, "finite", lambda: normalise.rank_normalise(np.array([[np.nan]]), np.zeros(1))),
    (InputError, "2 rows", lambda: normalise.rank_normalise(np.zeros((2, 1)), np.array([0]))),
    (InputError, "not finite", lambda: normalise.fit_map(np.full((3, 2), np.nan), np.zeros((3, 2)))),
    (InputError, "same features", fitted((3, 2), (3, 1))),
    (InputError, "same features", fitted((0, 2), (3, 2))),
    (InputError, "not a revolution", lambda: range_time.picture(TURN, angle() / 2, 1.0)),
    (InputError, "no energy", lambda: range_time.picture(replace(TURN, channels=np.zeros_like(TURN.channels)), angle(), 1.0)),
    (InputError, "too few", lambda: range_time.picture(TURN, angle(), 1.0, rows=1)),
    *((InputError, r"0\.3 and 5\.5 m", lambda at=at: profile.gate_energies(POWER, AXIS, at)) for at in (0.2, 5.6, np.nan, [1.0, 1.0, 6.0])),
    (InputError, "do not fit", lambda: profile.gate_energies(POWER, AXIS, [1.0, 1.0])),
    (InputError, "do not fit", lambda: profile.gate_energies(POWER, AXIS[1:], 1.0)),
    (InputError, "no energy", lambda: profile.multipath_share(0 * POWER, AXIS, 1.0)),
    (InputError, "loudness", lambda: profile.profile_correlation(np.ones(3), np.ones(3), np.ones(3), "loudness")),
    (InputError, "channels", lambda: Processed(RADAR, MADE.range_m, MADE.power, MADE.channels[:, :4], None, MADE.velocity_mps)),
    (RecordingError, "NaN", lambda: process(NAN)),
    *((InputError, "start offset", lambda energy=energy: align.start_offset(energy, energy, 5)) for energy in ENERGIES.values()),
]


@pytest.mark.parametrize(("error", "message", "call"), ROWS)
def test_wrong_input_is_refused(error: type[Exception], message: str, call: Callable[[], object]) -> None:
    with pytest.raises(error, match=message):
        call()
