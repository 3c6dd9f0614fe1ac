"""Propagation paths, the interface between tracers and synthesis, without antennas, waveform timing or noise."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np


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
