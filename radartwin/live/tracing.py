"""Answer a setting of the live page: a draft at once, and the complete answer, equal to `radartwin.simulate`, after a search.

Most of the time is the search for sequences of faces and edges of the room. A draft evaluates the strongest known sequences and those of a
short search, without paths between objects and the room (docs/decisions/025-live-view.md).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from radartwin.live.echoes import LivePath, Spectra, spectra, strongest_paths
from radartwin.live.setting import LiveSetting, Movable, with_materials
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene
from radartwin.simulation import pruning, variant
from radartwin.simulation.backends.mitsuba import MitsubaBackend
from radartwin.simulation.backends.static_scene import StaticScene, static_scene
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.flat.room import Searched
from radartwin.simulation.flat.search import Sequences
from radartwin.simulation.poses import check_poses, inverse
from radartwin.simulation.signal.synthesis import received

DRAFT_BOUNCES = 2  # largest number of bounces that the short search of a draft finds
DRAFT_SEQUENCES = 1000  # number of known sequences that a draft evaluates
DRAFT_RAYS = 300_000  # number of ray tubes of a draft in a room that is not flat
KEPT = 8  # number of complete searches that are kept


@dataclass(frozen=True, eq=False)
class LiveAnswer:
    """Hold the radar's answer to a setting. Radar and objects are at rest, so that all chirps of a transmitter are equal."""

    setting: LiveSetting
    iq: np.ndarray  # (1, T, R, N) samples of the first chirp of each transmitter, in amplitude units
    spectra: Spectra
    paths: list[LivePath]
    complete: bool  # whether the answer equals `radartwin.simulate`; False for a draft
    seconds: float  # time of the computation


class LiveTracer:
    """Trace one room with movable objects, to which `add` adds more. The radar has one chirp for each transmitter."""

    def __init__(self, room: Scene, radar: Radar, movables: Sequence[Movable] = ()) -> None:
        self.radar = replace(radar, num_chirps=1)
        self._room = with_materials(room)
        self._movables = {movable.name: movable for movable in movables}
        self._searches: dict[tuple, Searched] = {}  # oldest first
        self._strong: dict[int, Sequences] = {}  # by number of bounces; rooms of other materials have the same faces

    def add(self, movable: Movable) -> None:
        self._movables = {**self._movables, movable.name: movable}  # another thread may be reading the old dictionary

    def scene(self, setting: LiveSetting) -> Scene:
        """Return the room with the materials of the setting, and the objects at their places."""
        placed = [s.moved(setting.object_poses[m.name]) for m in self._present(setting) for s in m.surfaces]
        return Scene([*self._room(setting.materials), *placed])

    def check(self, setting: LiveSetting) -> None:
        """Check that the radar can stand at its pose. Raises PoseError for a wrong pose, and SceneError inside a solid."""
        pose = check_poses(setting.radar_pose, "radar_pose")
        self._room(setting.materials).check_sensor(pose[:, :3, 3])
        for movable in self._present(setting):
            local = inverse(check_poses(setting.object_poses[movable.name], movable.name)) @ pose
            Scene(movable.surfaces).check_sensor(local[:, :3, 3])

    def needs_search(self, setting: LiveSetting) -> bool:
        """Return whether a complete answer needs a search that has not been made. A room that is not flat needs no search."""
        static = self._static(setting)
        return static is not None and static.is_flat and self._key(setting) not in self._searches

    def search(self, setting: LiveSetting) -> None:
        """Search the sequences at the pose of a setting in a flat room, for its complete answer and, the strongest, for later drafts."""
        static, bounces = self._static(setting), setting.max_bounces
        assert static is not None
        searched = static.searched(setting.radar_pose[None], self.radar, bounces, pruning.PRUNE)
        self._strong[bounces] = self._strongest(static, searched.sequences, setting.radar_pose)
        self._searches[self._key(setting)] = searched
        while len(self._searches) > KEPT:
            self._searches.pop(next(iter(self._searches)))

    def sketch(self, setting: LiveSetting) -> None:
        """Search the strongest sequences with at most one diffraction at the pose of a setting in a flat room, for drafts."""
        static, bounces = self._static(setting), setting.max_bounces
        assert static is not None
        strong = self._strongest(static, self._single_diffractions(static, setting, bounces), setting.radar_pose)
        known = self._strong.get(bounces)
        self._strong[bounces] = strong if known is None else Sequences.union([known, strong])[0]

    def _single_diffractions(self, static: StaticScene, setting: LiveSetting, max_bounces: int) -> Sequences:
        return static.room.single_diffractions(setting.radar_pose, self.radar, max_bounces, pruning.PRUNE)

    def _strongest(self, static: StaticScene, sequences: Sequences, pose: np.ndarray) -> Sequences:
        levels = static.room.levels(sequences, pose, self.radar)
        return sequences.where(np.sort(np.argsort(-levels, kind="stable")[:DRAFT_SEQUENCES]))

    def answer(self, setting: LiveSetting, complete: bool = False) -> LiveAnswer:
        """Compute the radar's answer, after a search if `complete` and if it needs one. Raises PoseError or SceneError, see `check`."""
        start = time.perf_counter()
        self.check(setting)
        if complete and self.needs_search(setting):
            self.search(setting)
        static, settings = self._static(setting), TraceSettings(max_bounces=setting.max_bounces)
        searched, draft = None, not complete
        if static is None:
            draft = False
        elif static.is_flat:
            searched = self._searches.get(self._key(setting))
            draft = searched is None
            searched = searched or Searched.of_pose(setting.radar_pose, self._draft_sequences(static, setting))
        elif draft:
            settings = replace(settings, rays=DRAFT_RAYS)
        if draft:
            settings = replace(settings, coupling=False)
        room, movables = self._room(setting.materials), self._present(setting)
        scene = Scene([*room, *(surface for movable in movables for surface in movable.surfaces)])
        motion = {movable.name: setting.object_poses[movable.name][None] for movable in movables}
        pose = setting.radar_pose[None]
        traced = MitsubaBackend(settings).traced(scene, self.radar, pose, motion, searched=searched)
        iq = received(traced.parts(), self.radar, 1)[0]
        paths = strongest_paths(traced, self.radar, setting.radar_pose)
        return LiveAnswer(setting, iq, spectra(iq, self.radar), paths, not draft, time.perf_counter() - start)

    def _draft_sequences(self, static: StaticScene, setting: LiveSetting) -> Sequences:
        bounces = setting.max_bounces
        if bounces not in self._strong:
            self.sketch(setting)
            return self._strong[bounces]
        return Sequences.union([self._strong[bounces], self._single_diffractions(static, setting, min(DRAFT_BOUNCES, bounces))])[0]

    def _present(self, setting: LiveSetting) -> list[Movable]:
        return [movable for name, movable in self._movables.items() if name in setting.object_poses]

    def _static(self, setting: LiveSetting) -> StaticScene | None:
        room = self._room(setting.materials)
        if not len(room):
            return None
        variant.activate("auto")
        return static_scene(list(room.surfaces), self.radar)

    def _key(self, setting: LiveSetting) -> tuple:
        return setting.materials, setting.max_bounces, setting.radar_pose.tobytes()
