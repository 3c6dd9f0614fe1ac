"""Compute the feature set of a motion, as one vector per recording or one row per frame.

A set is a list of families (paper, motion-specific feature design):
- rotation (on a turntable at fixed distance): harmonics, envelope, extent, brightness
- depth (a drive towards the target): track, multipath, window, extent, brightness
- lateral (a drive past the target): harmonics and envelope of the pass, multipath, window, extent, brightness
- raw (a baseline for any motion): profile, the unprocessed range profile
To test the shape alone, exclude the signal level with `without=["brightness"]`. The families harmonics and envelope describe a whole
motion, so all rows per frame repeat their values.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from radartwin.features import envelope, extent, log, track, window
from radartwin.features.families import families
from radartwin.features.processed import Processed
from radartwin.features.profile import FAR_M, NEAR_M, gate_energies, multipath_share

Real = NDArray[np.floating]
_TURNTABLE = "rotation"  # this set takes the target at its nominal range; the other sets track the target


class _Recording:
    """Hold one recording with the intermediate results that several families need."""

    def __init__(self, processed: Processed, motion_log: log.Log, turntable: bool) -> None:
        self.processed, self.log, self.turntable = processed, motion_log, turntable
        self.nominal_m = log.distances(motion_log, processed.num_frames)

    @cached_property
    def track_m(self) -> Real:
        return track.around(self.processed, self.nominal_m, self.log.frame_rate_hz)

    @cached_property
    def target_m(self) -> Real:
        return self.nominal_m if self.turntable else self.track_m

    @cached_property
    def energy(self) -> Real:
        """Target energy minus noise, (F,). If its mean is not above zero, the noise is not subtracted, so that all features exist."""
        energy = envelope.target_energy(self.processed, self.target_m)
        return energy if energy.mean() > 0 else energy + self.gate_floor

    @cached_property
    def envelope(self) -> Real:
        """Envelope over one revolution, or over a pass with the loss by distance removed."""
        if self.turntable:
            return envelope.revolution(self.energy, log.angles(self.log, self.processed.num_frames))
        return envelope.without_range_law(self.energy, self.nominal_m)

    @cached_property
    def gate_floor(self) -> Real:
        """Noise energy in the target gate, (F,); it limits the brightness of a frame from below."""
        floor = np.broadcast_to(self.processed.noise_floor, self.processed.power.shape)
        return gate_energies(floor, self.processed.range_m, self.target_m)[0]


NamedValues = tuple[Sequence[str], NDArray]


def _harmonics(recording: _Recording, per_frame: bool) -> NamedValues:
    parts = envelope.harmonics(recording.envelope)
    names = ["harmonic_ratio", *(f"harmonic_{m + 1}" for m in range(len(parts)))]
    return names, np.concatenate([[np.sum(parts**2)], parts])


def _envelope(recording: _Recording, per_frame: bool) -> NamedValues:
    return ["crest_factor", "entropy"], np.array([envelope.crest_factor(recording.envelope), envelope.entropy(recording.envelope)])


def _track(recording: _Recording, per_frame: bool) -> NamedValues:
    """Return the difference of tracked and nominal range, which shows the object's depth, wheel slip, and other echoes near the peak."""
    offset = recording.track_m - recording.nominal_m
    if per_frame:
        return ["track_offset_m"], offset[:, None]
    return ["excursion_m", "track_offset_m", "track_spread_m"], np.array([track.excursion(recording.track_m), offset.mean(), offset.std()])


def _multipath(recording: _Recording, per_frame: bool) -> NamedValues:
    if per_frame:
        inside, whole = gate_energies(recording.processed.power, recording.processed.range_m, recording.target_m)
        return ["multipath_share"], (1 - inside / np.maximum(whole, np.finfo(float).tiny))[:, None]
    return ["multipath_share"], np.array([multipath_share(recording.processed.power, recording.processed.range_m, recording.target_m)])


def _window(recording: _Recording, per_frame: bool) -> NamedValues:
    names = [f"window_{centre:+.2f}m_db" for centre in window.CENTRES_M]
    levels = window.window_db(recording.processed, recording.track_m)
    return names, levels if per_frame else 10 * np.log10(np.mean(10 ** (levels / 10), axis=0))


def _extent(recording: _Recording, per_frame: bool) -> NamedValues:
    values = extent.angular_extent(recording.processed, recording.target_m)
    return ["azimuth_extent_rad"], values[:, None] if per_frame else np.array([values.mean()])


def _brightness(recording: _Recording, per_frame: bool) -> NamedValues:
    if not per_frame:
        return ["brightness_db"], np.array([envelope.brightness_db(recording.energy, recording.nominal_m)])
    lower_limit = np.maximum(recording.gate_floor, np.finfo(float).tiny)
    energy = np.maximum(recording.energy, lower_limit)
    return ["brightness_db"], 10 * np.log10(envelope.without_range_law(energy, recording.nominal_m))[:, None]


def _profile(recording: _Recording, per_frame: bool) -> NamedValues:
    near = (recording.processed.range_m >= NEAR_M) & (recording.processed.range_m <= FAR_M)
    names = [f"profile_{centre:.2f}m_db" for centre in recording.processed.range_m[near]]
    power = recording.processed.power[:, near] if per_frame else recording.processed.power[:, near].mean(axis=0, dtype=np.float64)
    return names, 10 * np.log10(np.maximum(power, np.finfo(np.float32).tiny))


_FAMILIES: dict[str, Callable[[_Recording, bool], NamedValues]] = {
    "harmonics": _harmonics, "envelope": _envelope, "track": _track, "multipath": _multipath, "window": _window, "extent": _extent,
    "brightness": _brightness, "profile": _profile,
}  # fmt: skip


def vector(processed: Processed, motion_log: log.Log, name: str, without: Sequence[str] = ()) -> tuple[list[str], Real]:
    """Compute the features of one recording.

    Args:
        motion_log: nominal motion of the recording.
        name: name of the set.
        without: excluded families.
    Returns:
        names: the feature names.
        values: (features,), all finite.
    Raises:
        ConfigError: the set or a family is unknown.
        InputError: the log does not fit the recording, or the target is outside the range window.
    """
    return read(processed, motion_log, families(name, without), turns=name == _TURNTABLE)


def read(processed: Processed, motion_log: log.Log, families_read: Sequence[str], turns: bool) -> tuple[list[str], Real]:
    """Compute the features of one recording from a list of families. Results and errors are those of `vector`.

    Args:
        turns: whether the target is on a turntable; its nominal range then replaces the tracked range.
    """
    recording = _Recording(processed, motion_log, turns)
    parts = [_FAMILIES[family](recording, False) for family in families_read]
    values = np.concatenate([np.asarray(values, dtype=np.float64) for _, values in parts])
    return [name for names, _ in parts for name in names], values


def frames(processed: Processed, motion_log: log.Log, name: str) -> tuple[list[str], Real]:
    """Compute the features of each frame. Arguments and errors are those of `vector`.

    Returns:
        names: the feature names.
        values: (F, features).
    """
    recording = _Recording(processed, motion_log, name == _TURNTABLE)
    parts = [_FAMILIES[family](recording, True) for family in families(name)]
    blocks = [np.broadcast_to(values, (processed.num_frames, len(names))) for names, values in parts]
    return [feature for names, _ in parts for feature in names], np.concatenate(blocks, axis=1).astype(np.float64)
