"""Define the input and output of the ray-tube tracer: antennas, trace options and hits."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np


@dataclass(frozen=True)
class Antennas:
    """Describe the transmit antenna or the receive antenna at each of F sensor poses, in the geometry's frame."""

    position: np.ndarray  # (F, 3) antenna positions in metres; for a plane wave, far points of which only the direction matters
    axis: np.ndarray  # (F, 3) unit vectors of the antenna axis; its normalised component perpendicular to a ray is the polarisation
    cross: bool = False  # whether the polarisation is turned by 90 degrees about the ray (horizontal instead of vertical)


@dataclass(frozen=True)
class TraceOptions:
    """Set how a grid of tubes is traced."""

    max_bounces: int  # largest number of reflections per path
    # (faces,) number of the object cluster of each face, or None. Only tubes whose first hit is on a face of cluster `first_cluster`
    # contribute, so that two grids of different tube density never count the same path twice.
    cluster: np.ndarray | None = None
    first_cluster: int = 0  # number of the object cluster that the first hit of a tube must belong to
    # The tracer drops hits whose amplitude is below this factor times the strongest amplitude of the same pose in the same block of tubes
    # (`division.blocks`).
    prune: float = 0.0
    bounces: np.ndarray | None = None  # (F,) largest number of reflections of each sensor pose; None: `max_bounces` for all poses
    least: np.ndarray | None = None  # (F,) amplitudes below which the tracer drops hits of each sensor pose; None drops no further hits
    hats: bool = False  # True gives all tubes hat weights, which rooms need; False gives hat weights only to tubes on curved facets


@dataclass(frozen=True)
class Hits:
    """Hold the N hits of a grid of tubes that contribute to the received signal."""

    pose: np.ndarray  # (N,) index of the sensor pose
    bounce: np.ndarray  # (N,) number of reflections of the path, at least 1
    # (N, Q) complex amplitudes at Q frequency nodes, without the propagation phase, for signals with the phase factor exp(+j k L)
    amplitude: np.ndarray
    length_in_m: np.ndarray  # (N,) float64 path length from the transmitter over all reflections to the hit, in metres
    length_out_m: np.ndarray  # (N,) float64 distance from the hit to the receiver, in metres
    departure: np.ndarray  # (N, 3) unit vectors from the transmitter towards the first hit of the path
    arrival: np.ndarray  # (N, 3) unit vectors from the receiver towards the last hit of the path
    first_m: np.ndarray  # (N,) float64 distance from the transmitter to the first hit of the path, in metres

    def where(self, keep: np.ndarray) -> "Hits":
        """Return the hits that the mask or the index array `keep` selects."""
        if keep.dtype == bool:
            if keep.all():
                return self
            keep = np.flatnonzero(keep)
        return Hits(*(np.take(getattr(self, field.name), keep, axis=0) for field in fields(Hits)))

    @staticmethod
    def concatenate(parts: Sequence["Hits"]) -> "Hits":
        if len(parts) == 1:
            return parts[0]
        return Hits(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Hits)))

    @staticmethod
    def none(nodes: int) -> "Hits":
        """Return a `Hits` object without hits, whose amplitude array has `nodes` frequency nodes."""
        index, length, vectors = np.zeros(0, int), np.zeros(0), np.zeros((0, 3))
        return Hits(index, index, np.zeros((0, nodes), complex), length, length, vectors, vectors, length)
