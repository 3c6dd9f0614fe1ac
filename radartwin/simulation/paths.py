"""Propagation paths, the interface between tracers and synthesis, without antennas, waveform timing or noise.

Traced paths are stored in the shared array cache (radartwin/store/array_cache.py), so that each room is traced only once.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from radartwin.store import array_cache
from radartwin.store.digest import array_digest, source_digest, spec_digest


@dataclass(frozen=True, eq=False)
class Paths:
    """Hold the propagation paths of F poses in the sensor frame. Do not write to the arrays, because caches share them.

    Attributes:
        poses: number of poses, F.
        pose: (N,) index of the pose, ascending.
        bounces: (N,) number of reflections.
        amplitude: (N, Q) complex at Q frequency nodes, without the propagation phase. Between isotropic antennas the path adds
            amplitude(f) exp(+j 2 pi f L/c); |amplitude|^2 is received over transmitted power.
        frequencies_hz: (Q,) nodes; between the nodes the amplitude is the interpolating polynomial.
        length_in_m, length_out_m: (N,) metres from the transmitter to the last hit (unfolded), and from there to the receiver.
        departure, arrival: (N, 3) unit vectors in the sensor frame from the sensor towards first and last hit.
        rate_mps: (N,) rate of change of length_in_m + length_out_m, m/s.
        mirror: (N, 3, 3) in the sensor frame, or None. With a mirror, the path is a straight line from the transmitter's image. Its length
            between antenna elements at t and r is then |L arrival + mirror t - r|, where L is the total length. Without a mirror, the hits
            are fixed points.
    """

    poses: int
    pose: np.ndarray
    bounces: np.ndarray
    amplitude: np.ndarray
    frequencies_hz: np.ndarray
    length_in_m: np.ndarray
    length_out_m: np.ndarray
    departure: np.ndarray
    arrival: np.ndarray
    rate_mps: np.ndarray
    mirror: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.pose)

    @property
    def length_m(self) -> np.ndarray:
        """Return the total lengths (N,) of the paths in metres."""
        return self.length_in_m + self.length_out_m

    def where(self, keep: np.ndarray | slice) -> "Paths":
        """Return the paths selected by a mask, indices or a slice."""
        chosen = {f.name: getattr(self, f.name) for f in fields(self)}
        for name, value in chosen.items():
            if name not in ("poses", "frequencies_hz") and value is not None:
                chosen[name] = value[keep]
        return Paths(**chosen)

    def frames(self, start: int, stop: int) -> "Paths":
        """Return the paths of poses `start` to `stop` - 1, with poses renumbered from zero."""
        low, high = np.searchsorted(self.pose, (start, stop))
        chosen = self.where(slice(low, high))
        return replace(chosen, poses=stop - start, pose=chosen.pose - start)

    @staticmethod
    def concatenate(parts: Sequence["Paths"]) -> "Paths":
        """Join paths that have the same poses and frequency nodes, and order them by pose."""
        first = parts[0]
        names = [f.name for f in fields(first) if f.name not in ("poses", "frequencies_hz") and getattr(first, f.name) is not None]
        joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        order = np.argsort(joined["pose"], kind="stable")
        return Paths(poses=first.poses, frequencies_hz=first.frequencies_hz, **{k: v[order] for k, v in joined.items()})


def traced_once(spec: Mapping[str, Any], arrays: Mapping[str, np.ndarray], trace: Callable[[], list[Paths]]) -> list[Paths]:
    """Return the cached paths, or call `trace` and cache its paths. Do not write to the returned arrays, because callers share them.

    Args:
        spec: settings that affect the paths. arrays: geometry, reflection tables and poses that affect the paths.
    """
    digests = {name: array_digest(array) for name, array in arrays.items()}
    key = spec_digest({"spec": spec, "arrays": digests, "source": source_digest(["radartwin.simulation"])})
    cache = array_cache.shared()
    found = cache.get(key, from_arrays)
    if found is None:
        found = trace()
        cache.put(key, to_arrays(found))
    return found


def to_arrays(parts: Sequence[Paths]) -> dict[str, np.ndarray]:
    """Return the fields of all parts as named arrays."""
    arrays = {"parts": np.array(len(parts))}
    for i, part in enumerate(parts):
        values = {field.name: getattr(part, field.name) for field in fields(Paths)}
        arrays |= {f"{i}.{name}": np.asarray(value) for name, value in values.items() if value is not None}
    return arrays


def from_arrays(arrays: array_cache.Arrays) -> list[Paths]:
    """Rebuild the parts from the arrays of `to_arrays`. Raises ValueError, LookupError or TypeError for arrays that do not fit together."""
    parts = []
    for i in range(int(arrays["parts"])):
        values: dict[str, Any] = {f.name: arrays[f"{i}.{f.name}"] for f in fields(Paths) if f"{i}.{f.name}" in arrays}
        for name, value in values.items():
            if name not in ("poses", "frequencies_hz") and len(value) != len(values["pose"]):
                raise ValueError(f"{name} has {len(value)} entries, not {len(values['pose'])}")
        values["poses"] = int(values["poses"])
        parts.append(Paths(**values))
    return parts
