"""Input and output of the tube tracer: antennas, options, hits, and the face labels packed into one number per hit."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from radartwin.simulation.geometry import Geometry

LABEL_BITS = 12  # per bounce: five bounces fit in 64 bits
OTHER_LABEL = (1 << LABEL_BITS) - 2  # the largest label, for faces without a label of their own


def unpack_labels(sequence: int, bounces: int) -> tuple[int, ...]:
    """Return the labels of the faces that a path met, first to last. `sequence` holds 1 + label per bounce, the last in the lowest bits.

    >>> unpack_labels((3 << LABEL_BITS) + 8, 2)
    (2, 7)
    """
    return tuple(((sequence >> (LABEL_BITS * (bounces - 1 - i))) & (1 << LABEL_BITS) - 1) - 1 for i in range(bounces))


@dataclass(frozen=True)
class Antennas:
    """Describe transmit or receive antennas, one per pose, in the geometry's frame.

    Attributes:
        position: (F, 3) metres. For a plane wave this is a point far away, and only its direction matters.
        axis: (F, 3) unit vectors. The polarisation is the normalised component of the axis perpendicular to the ray.
        cross: whether the polarisation is turned by 90 degrees about the ray (H instead of V).
    """

    position: np.ndarray
    axis: np.ndarray
    cross: bool = False


@dataclass(frozen=True)
class Occluder:
    """Describe static geometry that can block the line between sensor and object.

    Attributes:
        geometry: the blocking surfaces.
        rotation, translation: (F, 3, 3) and (F, 3), which map the object's frame to the occluder's frame at each pose.
    """

    geometry: Geometry
    rotation: np.ndarray
    translation: np.ndarray


@dataclass(frozen=True)
class TraceOptions:
    """Set how a grid of tubes is traced.

    Attributes:
        max_bounces: largest number of reflections.
        cluster: (faces,) cluster of each face, or None. Only tubes whose first hit is on a face of cluster `first_cluster` contribute, so
            that grids of different density do not count a path twice.
        labels: (faces,) numbers below 4095, packed into `Hits.sequence`. None: not recorded.
        occluder: geometry that may block the lines from the sensor to the first hit and from the last hit to the sensor.
        prune: drop hits whose amplitude is below this times the strongest hit of their pose in the same block (`division.blocks`).
        hats: whether all tubes have hat weights, as rooms need. If False, only tubes on curved facets have hat weights.
        pieces: odd number. A tube that straddles two smooth patches, or that a curved surface spreads onto another surface, is divided into
            this many pieces along each grid axis.
    """

    max_bounces: int
    cluster: np.ndarray | None = None
    first_cluster: int = 0
    labels: np.ndarray | None = None
    occluder: Occluder | None = None
    prune: float = 0.0
    hats: bool = False
    pieces: int = 1


@dataclass(frozen=True)
class Hits:
    """Hold the N contributing hits of a grid of tubes.

    Attributes:
        pose: (N,) index of the pose. bounce: (N,) number of reflections, from 1.
        amplitude: (N, Q) complex, for signals exp(+j k L), without the propagation phase.
        length_in_m, length_out_m: (N,) float64, unfolded length from source to hit, and distance from hit to receiver.
        departure, arrival: (N, 3) unit vectors from source and receiver towards the path.
        first_m: (N,) float64, distance from source to first hit.
        sequence: (N,) uint64, labels of the faces met, see `unpack_labels`.
    """

    pose: np.ndarray
    bounce: np.ndarray
    amplitude: np.ndarray
    length_in_m: np.ndarray
    length_out_m: np.ndarray
    departure: np.ndarray
    arrival: np.ndarray
    first_m: np.ndarray
    sequence: np.ndarray

    def where(self, keep: np.ndarray) -> "Hits":
        """Return the hits selected by a mask or by indices."""
        return Hits(*(getattr(self, field.name)[keep] for field in fields(Hits)))

    @staticmethod
    def concatenate(parts: Sequence["Hits"]) -> "Hits":
        if len(parts) == 1:
            return parts[0]
        return Hits(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Hits)))

    @staticmethod
    def none(nodes: int) -> "Hits":
        """Return an empty set of hits at `nodes` frequencies."""
        index, length, vectors = np.zeros(0, int), np.zeros(0), np.zeros((0, 3))
        amplitude, sequence = np.zeros((0, nodes), complex), np.zeros(0, np.uint64)
        return Hits(index, index, amplitude, length, length, vectors, vectors, length, sequence)
