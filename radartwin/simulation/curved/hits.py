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
    """Describe transmit or receive antennas, one per pose, in the geometry's frame."""

    position: np.ndarray  # (F, 3) metres; for a plane wave a point far away, of which only the direction matters
    axis: np.ndarray  # (F, 3) unit vectors; the polarisation is the normalised component perpendicular to the ray
    cross: bool = False  # whether the polarisation is turned by 90 degrees about the ray (H instead of V)


@dataclass(frozen=True)
class Occluder:
    """Describe static geometry that can block the line between sensor and object."""

    geometry: Geometry
    rotation: np.ndarray  # (F, 3, 3), from the object's frame to the occluder's frame at each pose
    translation: np.ndarray  # (F, 3)


@dataclass(frozen=True)
class TraceOptions:
    """Set how a grid of tubes is traced."""

    max_bounces: int  # largest number of reflections
    # (faces,) cluster of each face, or None. Only tubes whose first hit is on a face of cluster `first_cluster` contribute, so that grids
    # of different density do not count a path twice.
    cluster: np.ndarray | None = None
    first_cluster: int = 0
    labels: np.ndarray | None = None  # (faces,) numbers below 4095, packed into `Hits.sequence`. None: not recorded
    occluder: Occluder | None = None  # may block the lines from the sensor to the first hit and from the last hit to the sensor
    prune: float = 0.0  # drop hits weaker than this times the strongest amplitude of their pose in the same block (`division.blocks`)
    hats: bool = False  # whether all tubes have hat weights, as rooms need; if False, only tubes on curved facets have hat weights
    # odd number of pieces, along each grid axis, of a tube that straddles two smooth patches or that a curved surface spreads onto another
    pieces: int = 1


@dataclass(frozen=True)
class Hits:
    """Hold the N contributing hits of a grid of tubes."""

    pose: np.ndarray  # (N,) index
    bounce: np.ndarray  # (N,) number of reflections, from 1
    amplitude: np.ndarray  # (N, Q) complex, for signals exp(+j k L), without the propagation phase
    length_in_m: np.ndarray  # (N,) float64, unfolded length from source to hit
    length_out_m: np.ndarray  # (N,) float64, distance from hit to receiver
    departure: np.ndarray  # (N, 3) unit vectors from the source towards the path
    arrival: np.ndarray  # (N, 3) unit vectors from the receiver towards the path
    first_m: np.ndarray  # (N,) float64, distance from source to first hit
    sequence: np.ndarray  # (N,) uint64, labels of the faces met, see `unpack_labels`

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
