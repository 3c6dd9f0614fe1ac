"""The measured side of a campaign out of a recording set: its rows as cases, with logs from what was recorded."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from typing import get_args

import numpy as np

from experiments.campaign.cases import BENCH_ROOM, ROVER, TURN_S, Case, Log, Motion, course
from radartwin.build.radar import build_radar
from radartwin.config.config import Config
from radartwin.config.scene import ROOMS
from radartwin.config.study import RecordingsConfig
from radartwin.errors import InputError
from radartwin.features.envelope import frames_per_revolution
from radartwin.io.progress import Progress
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.recordings.checks import difference
from radartwin.recordings.index import INDEX, Row
from radartwin.recordings.recording_set import RecordingSet
from radartwin.scene.objects.catalogue import catalogue

TURN = "period_s"  # column of the index: of one revolution of the turntable
_MOTIONS = get_args(Motion)
# What may differ between a recording's radar and the twin's: the rest decides what a bin and a chirp are.
_OWN = ("name", "frame_rate_hz", "element", "noise_figure_db", "transmit_power_dbm", "if_filter", "phase_noise")


class Recorded:
    """Attributes:
    cases: of what was recorded, those that the twin can simulate; the rest is told once. conditions: each of theirs once.

    Raises:
        UserError: a set that cannot be used, has nothing for a campaign, or is of another radar than the twin would simulate.
    """

    def __init__(self, config: Config, progress: Progress):
        assert isinstance(config.measured, RecordingsConfig)
        folder = config.measured.folder
        self._set = RecordingSet.load(folder)
        self._rows: dict[Case, Row] = {}
        self._courses: dict[Case, tuple[Radar, int, np.ndarray | None]] = {}
        left: Counter[str] = Counter()
        for row in self._set:
            if reason := _reason(row):
                left[reason] += 1
            else:
                assert row.distance_m is not None
                self._rows[Case(row.object, row.room, row.motion, row.distance_m, row.repetition)] = row  # type: ignore[arg-type]
        if left:
            progress.say(f"{folder}: left out {', '.join(f'{number} of {reason}' for reason, number in left.items())}")
        if not self._rows:
            raise InputError(f"{folder}: it has no recording of an object of the catalogue on a turntable, rail or rover in a known room")
        radar, twin = self._set.radar, build_radar(config.radar)
        like = replace(twin, **{name: getattr(radar, name) for name in _OWN})
        if radar != like:
            raise InputError(f"{folder}: its radar is not the one that is simulated: {difference(radar, like)}; choose radar=... to match")
        self.cases = list(self._rows)
        self.conditions = list(dict.fromkeys(replace(case, repetition=0) for case in self.cases))

    def key(self, case: Case) -> str:
        return self._set.digest(self._row(case))

    def recording(self, case: Case) -> Recording:
        return self._set.read(self._row(case))

    def log(self, case: Case) -> Log:
        """From the recording's frames and rate, the turntable's period and the rover's trajectory where the index has them."""
        row = self._row(case)
        radar, frames, driven = self._course(case)
        return course(case, radar.frame_rate_hz, frames, _turn_s(row), driven)

    def twin_log(self, condition: Case) -> Log:
        """What the twin simulates for all repetitions of a condition: the course of the longest; a turntable turns once."""
        condition = replace(condition, repetition=0)
        some = [case for case in self.cases if replace(case, repetition=0) == condition]
        if not some:
            raise InputError(f"{self._set.folder}: it has no recording of {condition.name}")
        nominal = self.log(max(some, key=lambda case: (self._course(case)[1], -case.repetition)))
        if nominal.angle_rad is None:
            return nominal
        turn_s = _turn_s(self._row(some[0]))
        frames = max(3, math.ceil(nominal.frame_rate_hz * turn_s) + 1)
        angle_rad = course(condition, nominal.frame_rate_hz, frames, turn_s).angle_rad
        assert angle_rad is not None
        return course(condition, nominal.frame_rate_hz, frames_per_revolution(angle_rad), turn_s)

    def _course(self, case: Case) -> tuple[Radar, int, np.ndarray | None]:
        if case not in self._courses:
            self._courses[case] = self._set.course(self._row(case))
        return self._courses[case]

    def _row(self, case: Case) -> Row:
        if case not in self._rows:
            raise InputError(f"{self._set.folder}: it has no recording of {case.name}")
        return self._rows[case]


def _turn_s(row: Row) -> float:
    """Raises InputError for what is no duration."""
    text = row.extra.get(TURN) or str(TURN_S)
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not 0 < seconds < math.inf:
        raise InputError(f"{INDEX}, recording {row.recording}: {TURN} is {text!r}; give the seconds of one revolution, such as 25")
    return seconds


def _reason(row: Row) -> str:
    """Why the twin cannot simulate it, or nothing."""
    if row.motion not in _MOTIONS or row.distance_m is None:
        return f"motion {row.motion}"
    if row.object not in catalogue():
        return f"object {row.object}, which is not in the catalogue"
    if row.room not in ROOMS:
        return f"room {row.room}, which has no scan"
    if row.motion not in ROVER and row.room != BENCH_ROOM:
        return f"motion {row.motion} in {row.room}, where the twin has no bench"
    return ""
