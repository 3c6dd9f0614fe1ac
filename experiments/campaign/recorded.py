"""Read measured recordings from a recording set. Each row of the set's index becomes a case (object, room, motion, distance), and the
recorded motion of this row becomes a log.
"""

import math
from collections import Counter
from dataclasses import replace
from typing import get_args

import numpy as np

from experiments.campaign.cases import BENCH_ROOM, ROVER, TURN_S, Case, Log, Motion, course
from radartwin.builders.radar import build_radar
from radartwin.config.config import Config
from radartwin.config.scene import ROOMS
from radartwin.config.study import RecordingsConfig
from radartwin.errors import InputError
from radartwin.features.envelope import frames_per_revolution
from radartwin.io.one_line import plural
from radartwin.io.progress import Progress
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.recordings.examine import difference
from radartwin.recordings.index import INDEX, Row
from radartwin.recordings.recording_set import RecordingSet
from radartwin.scene.objects.catalogue import catalogue

TURN = "period_s"  # index column with the time of one turntable revolution in seconds
_MOTIONS = get_args(Motion)
# Fields in which the radar of a recording may differ from the simulated radar, because they do not change range bins and chirps.
_FREE = ("name", "frame_rate_hz", "element", "noise_figure_db", "transmit_power_dbm", "if_filter", "phase_noise")


class Recorded:
    """Read the recordings of a recording set on disk.

    `cases` are the recordings that can also be simulated, and `conditions` these without repetitions; a message counts the others. Raises
    UserError if the set cannot be used, has no such recording, or was made with another radar.
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
            parts = (f"{plural(number, 'recording')} of {reason}" for reason, number in left.items())
            progress.say(f"{folder}: left out {', '.join(parts)}")
        if not self._rows:
            raise InputError(f"{folder}: no recording of a known object on a turntable, rail or rover in a known room; check {INDEX}")
        radar, twin = self._set.radar, build_radar(config.radar)
        like = replace(twin, **{name: getattr(radar, name) for name in _FREE})
        if radar != like:
            raise InputError(f"{folder}: its radar differs from the simulated one: {difference(radar, like)}; choose a matching radar=")
        self.cases = list(self._rows)
        self.conditions = list(dict.fromkeys(case.condition for case in self.cases))

    def key(self, case: Case) -> str:
        return self._set.digest(self._row(case))

    def recording(self, case: Case) -> Recording:
        return self._set.read(self._row(case))

    def log(self, case: Case) -> Log:
        """Return the log of a recording. Turntable period and rover trajectory are nominal unless the recording set contains them."""
        row = self._row(case)
        radar, frames, driven = self._course(case)
        return course(case, radar.frame_rate_hz, frames, _turn_s(row), driven)

    def twin_log(self, condition: Case) -> Log:
        """Return the log for the simulation of a condition: that of the longest repetition, for a turntable cut to one revolution."""
        condition = condition.condition
        repetitions = [case for case in self.cases if case.condition == condition]
        if not repetitions:
            raise InputError(f"{self._set.folder}: no recording of {condition.name}; check {INDEX}")
        nominal = self.log(max(repetitions, key=lambda case: (self._course(case)[1], -case.repetition)))
        if nominal.angle_rad is None:
            return nominal
        turn_s = _turn_s(self._row(repetitions[0]))
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
            raise InputError(f"{self._set.folder}: no recording of {case.name}; check {INDEX}")
        return self._rows[case]


def _turn_s(row: Row) -> float:
    """Return the time of one turntable revolution in seconds. Raises InputError if the period is not finite and positive."""
    text = row.extra.get(TURN) or str(TURN_S)
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not 0 < seconds < math.inf:
        raise InputError(f"{INDEX}, recording {row.recording}: {TURN} is {text!r}; give the seconds of one revolution, such as 25")
    return seconds


def _reason(row: Row) -> str:
    """Return the reason why a recording cannot be simulated, or an empty text if it can be simulated."""
    if row.motion not in _MOTIONS or row.distance_m is None:
        return f"motion {row.motion}"
    if row.object not in catalogue():
        return f"object {row.object}, which is not in the catalogue"
    if row.room not in ROOMS:
        return f"room {row.room}, which has no scan"
    if row.motion not in ROVER and row.room != BENCH_ROOM:
        return f"motion {row.motion} in {row.room}, where the twin has no bench"
    return ""
