"""Replace the virtual measurement campaign by a class that needs no simulator. A test knows which properties of an object are equal in both
domains: the measured recordings differ in gain, noise, room echoes and slightly in the echo pattern of each object.
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from typing import Any

import numpy as np

from experiments.campaign import frame
from experiments.campaign.cases import MEASURED, REFLECTOR, TWIN, Case, Motion
from experiments.campaign.frame import Frame, RecordingSource
from radartwin.config.compose import compose
from radartwin.config.config import Config
from radartwin.features.log import Nominal
from radartwin.features.processed import MAX_RANGE_M, Processed
from radartwin.io.progress import Progress
from radartwin.radar.chirp import Radar
from radartwin.radar.processing import range_axis, velocity_axis
from radartwin.runs.experiment import Result
from radartwin.scene.objects.assortment import every_object
from radartwin.scene.objects.catalogue import catalogue, entry
from radartwin.store.digest import spec_digest

# A fake campaign has no target that a turntable turns, so its copies draw the receiver only.
STILL = tuple(f"supervision.randomise.{name}=0" for name in ("wobble", "eccentricity", "start", "speed", "distance", "wall", "mesh"))
LEVEL = {"metal": 1.0, "ceramic": 0.3, "plastic": 0.12}
MODULATION = {"symmetric": 0.05, "faceted": 0.9, "asymmetric": 0.5}
OFFSETS_M = (-0.6, -0.3, 0.35, 0.5, 0.8)  # range differences between the room's echoes and the target


class FakeCampaign:
    """This class returns synthetic recordings and has the interface experiments.campaign.frame.RecordingSource.

    Args:
        frames: number of frames of a drive, or of one revolution.
        signature: relative strength of the differences between the echoes of different objects; 0 makes all objects equal.
        gap: relative size of the difference between the measured and the simulated echo pattern of the same object.
        turns: number of revolutions in a measured turntable recording.
        materials: material source of the simulated room.
        offset_m: range of the target beyond the distance of its case.
        keep: function that decides whether the measured or the simulated domain contains a recording.
    """

    def __init__(
        self, motions: Sequence[Motion] = ("turntable",), rooms: Sequence[str] = ("lab",), distances: Sequence[float] = (0.5, 1.0),
        repetitions: int = 3, frames: int = 40, signature: float = 1.0, gap: float = 0.1, objects: Sequence[str] = (),
        turns: int = 1, materials: str = "vlm", offset_m: float = 0.3, keep: Callable[[str, Case], bool] = lambda domain, case: True,
    ) -> None:  # fmt: skip
        self.motions, self.rooms, self.distances, self.repetitions = motions, rooms, distances, repetitions
        self.frames, self.signature, self.gap, self.turns, self.materials, self.keep = frames, signature, gap, turns, materials, keep
        self.offset_m = offset_m
        self.made: dict[tuple[str, Case], tuple[str, Processed]] = {}
        self.objects = tuple(objects) or tuple(catalogue())
        self.radar = Radar.iwr1843()
        self.range_m = range_axis(self.radar, self.radar.num_samples)
        self.range_m = self.range_m[self.range_m <= MAX_RANGE_M]

    def with_materials(self, materials: Any) -> FakeCampaign:
        """Return the campaign with a simulated room of another material source."""
        other = copy.copy(self)
        other.materials, other.made = materials.source, {}
        return other

    def cases(self, domain: str, **chosen) -> list[Case]:
        found = [
            Case(name, room, motion, distance, repetition)
            for room in self.rooms for motion in self.motions for name in self.objects for distance in self.distances
            for repetition in range(self.repetitions if domain == "measured" else 1)
            if motion == "turntable" or catalogue()[name].rover
        ]  # fmt: skip
        found = [case for case in found if self.keep(domain, case)]
        return [case for case in found if all(getattr(case, name) == value for name, value in chosen.items() if value is not None)]

    def log(self, case: Case, domain: str = "measured") -> Nominal:
        frames = self.frames * (self.turns if domain == "measured" and case.motion == "turntable" else 1)
        angle = 2 * np.pi * np.arange(frames) / self.frames
        distance = np.full(frames, case.distance_m + self.offset_m)
        if case.motion != "turntable":
            return Nominal(10.0, distance + 0.05 * np.linspace(-1, 1, self.frames) ** 2, None)
        return Nominal(self.frames / 25.0, distance, angle)

    def prepare(self, wanted) -> None: ...

    def processed(self, domain: str, case: Case) -> tuple[str, Processed]:
        if (domain, case) not in self.made:
            self.made[domain, case] = self._made(domain, case)
        return self.made[domain, case]

    def _made(self, domain: str, case: Case) -> tuple[str, Processed]:
        kind = every_object()[case.object]
        own = np.random.default_rng([catalogue_number(case.object), 1])
        log = self.log(case, domain)
        frames = len(log.distance_m)
        phase = 2 * np.pi * np.arange(frames) / self.frames
        strength = MODULATION[kind.shape] * self.signature
        lines = own.normal(size=6) * self.signature
        room = own.uniform(0.2, 1.0, len(OFFSETS_M)) ** self.signature
        level = (LEVEL[kind.material_class] * own.uniform(0.7, 1.4)) ** self.signature
        width = 0.03 + 0.1 * self.signature * own.uniform()
        rng = np.random.default_rng([catalogue_number(case.object), int(1000 * case.distance_m), case.repetition, len(domain)])
        if domain == "measured":
            truth = np.random.default_rng([catalogue_number(case.object), 2])
            lines = lines + self.gap * truth.normal(size=6)
            room = room * np.exp(self.gap * truth.normal(size=len(room)))
            level = 2.0 * level * np.exp(0.1 * rng.normal())
        room = room * (0.0 if domain == "void" or self.materials == "void" else 1.0)
        if self.materials in ("uniform", "random"):
            room = room[::-1]
        envelope = 1 + strength * sum(lines[m] * np.cos((m + 1) * phase) for m in range(6)) / np.abs(lines).sum().clip(1)
        amplitude = 1e-4 * np.sqrt(level) * envelope / log.distance_m**2
        channels = np.zeros((frames, 8, len(self.range_m)), complex)
        antenna = np.arange(8)
        size = (kind.aim_m / entry(REFLECTOR).aim_m) ** 2 if case.object.startswith(REFLECTOR) else 1.0  # amplitude of a reflector's echo
        for offset, gain, angle in [
            (0.0, size, 0.0),
            (0.0, 0.4 * size, width),
            *((o, 0.3 * g, 0.2) for o, g in zip(OFFSETS_M, room, strict=True)),
        ]:
            spread = np.exp(-0.5 * ((self.range_m - log.distance_m[:, None] - offset) / 0.05) ** 2)
            channels += gain * amplitude[:, None, None] * spread[:, None, :] * np.exp(1j * np.pi * np.sin(angle) * antenna)[:, None]
        noise = 4e-14 if domain == "measured" else 1e-14
        draw = rng.normal(size=channels.shape) + 1j * rng.normal(size=channels.shape)
        channels = (channels + np.sqrt(noise / 2) * draw).astype(np.complex64)
        power = (np.abs(channels) ** 2).mean(axis=1).astype(np.float32)
        floor = np.full(len(self.range_m), noise, np.float32)
        made = Processed(self.radar, self.range_m, power, channels, None, velocity_axis(self.radar, self.radar.num_chirps), floor)
        return spec_digest([domain, case, self.materials, self.signature, self.gap, frames])[:32], made


@functools.cache
def _read(source: RecordingSource, wanted: tuple[tuple[str, Case], ...]) -> Frame:
    return frame.read(source, wanted, Progress(quiet=True))


def frame_of(source: RecordingSource, *motions: str, several: bool = False) -> Frame:
    """Read the frame of a campaign, without a store."""
    return _read(source, tuple(frame.shared(source, motions or ("turntable",), several=several))).copy()


def sides_of(sides: Mapping[str, RecordingSource], *motions: str) -> Frame:
    """Read the frame of the measurements of the first campaign and of the simulations of all campaigns, by their name."""
    import pandas as pd

    first, *_ = sides.values()
    wanted = frame.shared(first, motions or ("turntable",), several=True)
    measured, twins = (tuple(recording for recording in wanted if recording[0] == domain) for domain in (MEASURED, TWIN))
    parts = [_read(source, twins).assign(side=name) for name, source in sides.items()]
    return pd.concat([_read(first, measured), *parts], ignore_index=True)


@functools.cache
def _composed(*overrides: str) -> Config:
    return compose(list(overrides))


def config(name: str, *overrides: str) -> Config:
    """Return the configuration of a results table with few bootstrap resamples."""
    return deepcopy(_composed(f"experiment={name}", "output=/tmp/nowhere", "profile.resamples=200", *overrides))


def find(result: Result, **wanted) -> dict:
    """Return the only row of a table that has the given values."""
    found = [row for row in result.rows if all(row.get(name) == value for name, value in wanted.items())]
    assert len(found) == 1, (wanted, found)
    return found[0]


def draw_all(result: Result) -> set[str]:
    """Lay out every figure of a results table, and return the names of the figures."""
    for draw in result.figures.values():
        assert callable(draw)
        draw().draw_without_rendering()
    return set(result.figures)


def catalogue_number(name: str) -> int:
    return list(every_object()).index(REFLECTOR if name.startswith(REFLECTOR) else name)
