"""Define propagation paths, which the ray tracers compute and from which the synthesis computes radar samples.

A path does not depend on the antenna pattern, the chirp timing or the noise of the radar. The shared array cache
(radartwin/store/array_cache.py) stores traced paths, so that each room is traced only once.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np

from radartwin.store import array_cache
from radartwin.store.digest import array_digest, source_digest, spec_digest

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Paths:
    """Hold N propagation paths of a radar at F sensor poses, in the sensor frame.

    Do not write to the arrays, because caches return the same arrays to several callers.

    Attributes:
        poses: number of sensor poses, F.
        pose: (N,) index of the sensor pose of each path, in ascending order.
        bounces: (N,) number of reflections of each path.
        amplitude: (N, Q) complex amplitude of each path at Q frequency nodes, without the propagation phase. Between isotropic antennas,
            a path of length L adds the signal amplitude(f) exp(+j 2 pi f L/c), and |amplitude|^2 is received over transmitted power.
        frequencies_hz: (Q,) frequency nodes in Hz. Between the nodes, the amplitude follows the polynomial through the node values.
        length_in_m: (N,) length of each path from the transmitter over all hits to the last hit, in metres.
        length_out_m: (N,) distance from the last hit of each path to the receiver, in metres.
        departure: (N, 3) unit vectors in the sensor frame, from the sensor towards the first hit of each path.
        arrival: (N, 3) unit vectors in the sensor frame, from the sensor towards the last hit of each path.
        rate_mps: (N,) rate of change of the path length length_in_m + length_out_m, in m/s.
        mirror: (N, 3, 3) reflection matrices of mirror paths in the sensor frame, or None if each hit is a fixed point of its surface.
            A mirror path is a straight line from the transmitter's mirror image to the receiver. Its length between a transmit element
            at position t and a receive element at position r is |L arrival + mirror t - r|, where L is length_in_m + length_out_m.
        gain: (N, T R) factor on the amplitude for each pair of a transmit and a receive element, receivers fastest; None: 1 for all.
        points: (N, V, 3) points in the world at which each path is reflected or diffracted, nan beyond the last; None if not stored.
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
    gain: np.ndarray | None = None
    points: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.pose)

    @property
    def length_m(self) -> np.ndarray:
        """Return the total lengths (N,) of the paths in metres."""
        return self.length_in_m + self.length_out_m

    def reversed(self) -> "Paths":
        """Return the paths with departure and arrival exchanged."""
        return replace(
            self, departure=self.arrival, arrival=self.departure, length_in_m=self.length_out_m, length_out_m=self.length_in_m
        )  # fmt: skip

    def where(self, keep: np.ndarray | slice) -> "Paths":
        """Return the paths selected by a mask, indices or a slice."""
        if isinstance(keep, np.ndarray) and keep.dtype == bool:
            if keep.all():
                return self
            keep = np.flatnonzero(keep)
        columns = {f.name: getattr(self, f.name) for f in fields(self)}
        for name, value in columns.items():
            if name not in ("poses", "frequencies_hz") and value is not None:
                columns[name] = value[keep] if isinstance(keep, slice) else np.take(value, keep, axis=0)
        return Paths(**columns)

    def frames(self, start: int, stop: int) -> "Paths":
        """Return the paths of the sensor poses `start` to `stop` - 1, and number these poses from zero."""
        low, high = np.searchsorted(self.pose, (start, stop))
        part = self.where(slice(low, high))
        return replace(part, poses=stop - start, pose=part.pose - start)

    @staticmethod
    def concatenate(parts: Sequence["Paths"]) -> "Paths":
        """Join `Paths` objects that have the same sensor poses and frequency nodes, and sort the joined paths by pose."""
        first = parts[0]
        names = [f.name for f in fields(first) if f.name not in ("poses", "frequencies_hz") and getattr(first, f.name) is not None]
        order = slice(None) if first.poses == 1 else np.argsort(np.concatenate([part.pose for part in parts]), kind="stable")
        joined = {name: np.concatenate([getattr(part, name) for part in parts])[order] for name in names}
        return Paths(poses=first.poses, frequencies_hz=first.frequencies_hz, **joined)


def traced_once(
    spec: Mapping[str, Any], arrays: Mapping[str, np.ndarray], trace: Callable[[], list[Paths]], on_disk: bool = True
) -> list[Paths]:
    """Return the paths from the array cache; if the cache does not have the paths, call `trace` and store its result in the cache.

    The arguments are those of `made_once`.
    """
    return made_once(spec, arrays, trace, to_arrays, from_arrays, on_disk)


def made_once(
    spec: Mapping[str, Any],
    arrays: Mapping[str, np.ndarray],
    make: Callable[[], T],
    write: Callable[[T], array_cache.Arrays],
    read: Callable[[array_cache.Arrays], T],
    on_disk: bool = True,
) -> T:
    """Return a result from the array cache; if the cache does not have the result, call `make` and store what it returns.

    Do not write to the returned arrays, because the cache returns the same arrays to several callers.

    Args:
        spec: settings that affect the result, as part of the cache key.
        arrays: geometry, reflection tables and poses that affect the result, as part of the cache key.
        make: function that computes the result.
        write, read: functions that convert the result to named arrays and back.
        on_disk: False stores the result only in memory.
    """
    digests = {name: array_digest(array) for name, array in arrays.items()}
    key = spec_digest({"spec": spec, "arrays": digests, "source": source_digest(["radartwin.simulation"])})
    cache = array_cache.shared()
    result = cache.get(key, read)
    if result is None:
        result = make()
        cache.put(key, write(result), on_disk)
    return result


def to_arrays(parts: Sequence[Paths]) -> dict[str, np.ndarray]:
    """Return the fields of all `Paths` objects in `parts` as one mapping of named arrays, which the array cache can store."""
    arrays = {"parts": np.array(len(parts))}
    for i, part in enumerate(parts):
        values = {field.name: getattr(part, field.name) for field in fields(Paths)}
        arrays |= {f"{i}.{name}": np.asarray(value) for name, value in values.items() if value is not None}
    return arrays


def from_arrays(arrays: array_cache.Arrays) -> list[Paths]:
    """Rebuild the list of `Paths` objects from the mapping of named arrays that `to_arrays` returned.

    The function raises ValueError, LookupError or TypeError if the arrays do not fit together.
    """
    parts = []
    for i in range(int(arrays["parts"])):
        values: dict[str, Any] = {f.name: arrays[f"{i}.{f.name}"] for f in fields(Paths) if f"{i}.{f.name}" in arrays}
        for name, value in values.items():
            if name not in ("poses", "frequencies_hz") and len(value) != len(values["pose"]):
                raise ValueError(f"{name} has {len(value)} entries, not {len(values['pose'])}")
        values["poses"] = int(values["poses"])
        parts.append(Paths(**values))
    return parts
