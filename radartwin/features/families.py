"""Compute the feature families of a motion, as one vector per recording or as one row per frame.

The module radartwin.features.sets lists the families of each feature set. To compare only the shapes of targets, exclude the signal level
with `without=["brightness"]`. The families harmonics and envelope describe a whole motion, so all rows per frame contain the same values of
these families.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from radartwin import plugins
from radartwin.features import envelope, extent, log, peak_track, window
from radartwin.features.processed import Processed
from radartwin.features.profile import FAR_M, NEAR_M, gate_energies, multipath_share
from radartwin.features.sets import SETS, families, plugged_in

Real = NDArray[np.floating]
BRIGHTNESS = "brightness_db"  # name of the feature of the family brightness
_TURNTABLE = "rotation"  # feature set that uses the nominal range of the target; all other feature sets track the target


class _Recording:
    """Hold one recording with the intermediate results that several families need."""

    def __init__(self, processed: Processed, motion_log: log.Log, turntable: bool) -> None:
        self.processed, self.log, self.turntable = processed, motion_log, turntable
        self.nominal_m = log.distances(motion_log, processed.num_frames)

    @cached_property
    def track_m(self) -> Real:
        return peak_track.around(self.processed, self.nominal_m, self.log.frame_rate_hz)

    @cached_property
    def target_m(self) -> Real:
        return self.nominal_m if self.turntable else self.track_m

    @cached_property
    def energy(self) -> Real:
        """Return the energy (F,) in the target gate minus the noise energy.

        If the mean of this difference is not above zero, the property returns the energy in the gate without the subtraction.
        """
        energy = envelope.target_energy(self.processed, self.target_m)
        return energy if energy.mean() > 0 else energy + self.gate_floor

    @cached_property
    def envelope(self) -> Real:
        """Return the envelope: the energy over one revolution, or the energy times distance^4 over the frames of a drive."""
        if self.turntable:
            return envelope.revolution(self.energy, log.angles(self.log, self.processed.num_frames))
        return envelope.without_range_law(self.energy, self.nominal_m)

    @cached_property
    def gate_floor(self) -> Real:
        """Return the noise energy in the target gate of each frame, (F,), which is the lower limit for the brightness of a frame."""
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
    """Return features of tracked minus nominal range, which depend on the object's depth, on wheel slip and on echoes near the peak."""
    offset = recording.track_m - recording.nominal_m
    if per_frame:
        return ["track_offset_m"], offset[:, None]
    excursion_m = peak_track.excursion(recording.track_m)
    return ["excursion_m", "track_offset_m", "track_spread_m"], np.array([excursion_m, offset.mean(), offset.std()])


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
        return [BRIGHTNESS], np.array([envelope.brightness_db(recording.energy, recording.nominal_m)])
    lower_limit = np.maximum(recording.gate_floor, np.finfo(float).tiny)
    energy = np.maximum(recording.energy, lower_limit)
    return [BRIGHTNESS], 10 * np.log10(envelope.without_range_law(energy, recording.nominal_m))[:, None]


def _profile(recording: _Recording, per_frame: bool) -> NamedValues:
    near = (recording.processed.range_m >= NEAR_M) & (recording.processed.range_m <= FAR_M)
    names = [f"profile_{centre:.2f}m_db" for centre in recording.processed.range_m[near]]
    power = recording.processed.power[:, near] if per_frame else recording.processed.power[:, near].mean(axis=0, dtype=np.float64)
    return names, 10 * np.log10(np.maximum(power, np.finfo(np.float32).tiny))


_FAMILIES: dict[str, Callable[[_Recording, bool], NamedValues]] = {
    "harmonics": _harmonics, "envelope": _envelope, "track": _track, "multipath": _multipath, "window": _window, "extent": _extent,
    "brightness": _brightness, "profile": _profile,
}  # fmt: skip


def _turns(name: str) -> bool:
    """Return whether a feature set uses the nominal range of a target on a turntable."""
    plugin = plugins.find(plugins.FEATURES, name, SETS)
    return name == _TURNTABLE if plugin is None else plugged_in(plugin).turntable


def _family(name: str) -> Callable[[_Recording, bool], NamedValues]:
    """Return the function of a family. A family SET/FAMILY belongs to the feature set of a plug-in."""
    set_name, separator, family = name.partition("/")
    plugin = plugins.find(plugins.FEATURES, set_name, SETS) if separator else None
    if plugin is None:
        return _FAMILIES[name]

    def plugged(recording: _Recording, per_frame: bool) -> NamedValues:
        frames = recording.processed.num_frames
        with plugins.calling(plugin, family):
            named = plugged_in(plugin).functions[family](recording.processed, recording.target_m)
            rows = np.stack([np.broadcast_to(np.asarray(value, float), (frames,)) for value in named.values()], axis=1)
        if not np.isfinite(rows).all():
            raise plugins.refusal(plugin, f"{family} returned a value that is not finite")
        return list(named), rows if per_frame else rows.mean(axis=0)

    return plugged


def vector(processed: Processed, motion_log: log.Log, name: str, without: Sequence[str] = ()) -> tuple[list[str], Real]:
    """Compute the features of one recording.

    Returns:
        names: names of the features.
        values: feature values (features,), all finite.
    Raises:
        ConfigError: the feature set or a family is unknown.
        InputError: the motion log does not fit the recording, or the target is not between NEAR_M and FAR_M.
    """
    return read(processed, motion_log, families(name, without), turns=_turns(name))


def read(processed: Processed, motion_log: log.Log, families_read: Sequence[str], turns: bool) -> tuple[list[str], Real]:
    """Compute the features of one recording for a list of feature families. Results and errors are those of `vector`.

    Args:
        turns: whether the target is on a turntable. If so, its nominal range replaces the tracked range.
    """
    recording = _Recording(processed, motion_log, turns)
    parts = [_family(family)(recording, False) for family in families_read]
    values = np.concatenate([np.asarray(values, dtype=np.float64) for _, values in parts])
    return [name for names, _ in parts for name in names], values


def frames(processed: Processed, motion_log: log.Log, name: str) -> tuple[list[str], Real]:
    """Compute the features of each frame. Arguments and errors are those of `vector`.

    Returns:
        names: names of the features.
        values: feature values (F, features) of F frames.
    """
    recording = _Recording(processed, motion_log, _turns(name))
    parts = [_family(family)(recording, True) for family in families(name)]
    blocks = [np.broadcast_to(values, (processed.num_frames, len(names))) for names, values in parts]
    return [feature for names, _ in parts for feature in names], np.concatenate(blocks, axis=1).astype(np.float64)
