"""Feature sets: what each motion exposes, as one vector per recording or one row per frame.

A set is a list of families (paper, motion-specific feature design):
- rotation, the distance-controlled rotation vector: harmonics, envelope, extent, brightness
- depth: track, multipath, window, extent, brightness
- lateral: harmonics and envelope of the pass-by, multipath, window, extent, brightness
- raw: profile, the received range profile as it is, the baseline without features
Where a claim is about shape, `without=["brightness"]` leaves out what depends on level. In a row per frame, families that belong to a
whole motion (harmonics, envelope) repeat its values.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from radartwin.features import brightness, envelope, extent, gate, log, track, window
from radartwin.features.names import families
from radartwin.features.processed import Processed
from radartwin.features.profile import FAR_M, NEAR_M

Real = NDArray[np.floating]
# Where the target is sought: nominally on a turntable, by its tracked peak where the radar moves.
_TURNS = "rotation"


class _Recording:
    """One recording with what several families share."""

    def __init__(self, processed: Processed, log_of_it: log.Log, turns: bool) -> None:
        self.processed, self.log, self.turns = processed, log_of_it, turns
        self.nominal_m = log.distances(log_of_it, processed.num_frames)

    @cached_property
    def track_m(self) -> Real:
        return track.around(self.processed, self.nominal_m, self.log.frame_rate_hz)

    @cached_property
    def target_m(self) -> Real:
        return self.nominal_m if self.turns else self.track_m

    @cached_property
    def energy(self) -> Real:
        """Less the noise; a target that drowns in it reads as the noise does, so that every recording has features."""
        energy = envelope.target_energy(self.processed, self.target_m)
        return energy if energy.mean() > 0 else energy + self.gate_floor

    @cached_property
    def envelope(self) -> Real:
        """Over a revolution, or over a pass with the range law taken out."""
        if self.turns:
            return envelope.revolution(self.energy, log.angles(self.log, self.processed.num_frames))
        return brightness.without_range_law(self.energy, self.nominal_m)

    @cached_property
    def gate_floor(self) -> Real:
        """Noise energy in the gate, (F,): a frame's brightness reads no less."""
        floor = np.broadcast_to(self.processed.noise_floor, self.processed.power.shape)
        return gate.gate_energies(floor, self.processed.range_m, self.target_m)[0]


Named = tuple[Sequence[str], NDArray]


def _harmonics(of: _Recording, per_frame: bool) -> Named:
    parts = envelope.harmonics(of.envelope)
    names = ["harmonic_ratio", *(f"harmonic_{m + 1}" for m in range(len(parts)))]
    return names, np.concatenate([[np.sum(parts**2)], parts])


def _envelope(of: _Recording, per_frame: bool) -> Named:
    return ["crest_factor", "entropy"], np.array([envelope.crest_factor(of.envelope), envelope.entropy(of.envelope)])


def _track(of: _Recording, per_frame: bool) -> Named:
    """Against the nominal motion: the object's depth, slip and the echoes that draw the peak away."""
    offset = of.track_m - of.nominal_m
    if per_frame:
        return ["track_offset_m"], offset[:, None]
    return ["excursion_m", "track_offset_m", "track_spread_m"], np.array([track.excursion(of.track_m), offset.mean(), offset.std()])


def _multipath(of: _Recording, per_frame: bool) -> Named:
    if per_frame:
        inside, whole = gate.gate_energies(of.processed.power, of.processed.range_m, of.target_m)
        return ["multipath_share"], (1 - inside / np.maximum(whole, np.finfo(float).tiny))[:, None]
    return ["multipath_share"], np.array([gate.multipath_share(of.processed.power, of.processed.range_m, of.target_m)])


def _window(of: _Recording, per_frame: bool) -> Named:
    names = [f"window_{centre:+.2f}m_db" for centre in window.CENTRES_M]
    levels = window.window_db(of.processed, of.track_m)
    return names, levels if per_frame else 10 * np.log10(np.mean(10 ** (levels / 10), axis=0))


def _extent(of: _Recording, per_frame: bool) -> Named:
    values = extent.angular_extent(of.processed, of.target_m)
    return ["azimuth_extent_rad"], values[:, None] if per_frame else np.array([values.mean()])


def _brightness(of: _Recording, per_frame: bool) -> Named:
    if not per_frame:
        return ["brightness_db"], np.array([brightness.brightness_db(of.energy, of.nominal_m)])
    least = np.maximum(of.gate_floor, np.finfo(float).tiny)
    return ["brightness_db"], 10 * np.log10(brightness.without_range_law(np.maximum(of.energy, least), of.nominal_m))[:, None]


def _profile(of: _Recording, per_frame: bool) -> Named:
    near = (of.processed.range_m >= NEAR_M) & (of.processed.range_m <= FAR_M)
    names = [f"profile_{centre:.2f}m_db" for centre in of.processed.range_m[near]]
    power = of.processed.power[:, near] if per_frame else of.processed.power[:, near].mean(axis=0, dtype=np.float64)
    return names, 10 * np.log10(np.maximum(power, np.finfo(np.float32).tiny))


_READ: dict[str, Callable[[_Recording, bool], Named]] = {
    "harmonics": _harmonics, "envelope": _envelope, "track": _track, "multipath": _multipath, "window": _window, "extent": _extent,
    "brightness": _brightness, "profile": _profile,
}  # fmt: skip


def vector(processed: Processed, log_of_it: log.Log, name: str, without: Sequence[str] = ()) -> tuple[list[str], Real]:
    """The features of one recording.

    Args:
        log_of_it: its nominal motion. name: of the set. without: families left out.
    Returns:
        names, and values (features,), all finite.
    Raises:
        ConfigError: an unknown set or family.
        InputError: a log that does not fit, or a target that is not there.
    """
    return read(processed, log_of_it, families(name, without), turns=name == _TURNS)


def read(processed: Processed, log_of_it: log.Log, wanted: Sequence[str], turns: bool) -> tuple[list[str], Real]:
    """The features of one recording by families, of whatever sets; as `vector`.

    Args:
        turns: the target turns where it nominally is, rather than being tracked.
    """
    of = _Recording(processed, log_of_it, turns)
    found = [_READ[family](of, False) for family in wanted]
    return [one for names, _ in found for one in names], np.concatenate([np.asarray(values, dtype=np.float64) for _, values in found])


def frames(processed: Processed, log_of_it: log.Log, name: str, without: Sequence[str] = ()) -> tuple[list[str], Real]:
    """The features of each frame: names, and a matrix (F, features); arguments and errors as `vector`."""
    of = _Recording(processed, log_of_it, name == _TURNS)
    found = [_READ[family](of, True) for family in families(name, without)]
    blocks = [np.broadcast_to(values, (processed.num_frames, len(names))) for names, values in found]
    return [one for names, _ in found for one in names], np.concatenate(blocks, axis=1).astype(np.float64)
