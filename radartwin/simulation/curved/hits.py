"""Input and output of the tube tracer: antennas, options, hits, and the face labels packed into one number per hit."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from radartwin.simulation.geometry import Geometry

LABEL_BITS = 12  # per bounce: five bounces fit in 64 bits
OTHER_LABEL = (1 << LABEL_BITS) - 2  # the largest label, for faces without a label of their own


def unpack_labels(sequence: int, bounces: int) -> tuple[int, ...]:
    """Labels of the faces that a path met, first to last. `sequence` holds 1 + label per bounce, the last in the lowest bits.

    >>> unpack_labels((3 << LABEL_BITS) + 8, 2)
    (2, 7)
    """
    return tuple(((sequence >> (LABEL_BITS * (bounces - 1 - i))) & (1 << LABEL_BITS) - 1) - 1 for i in range(bounces))


@dataclass(frozen=True)
class Antennas:
    """Transmit or receive antennas, one per pose, in the geometry's frame.

    Attributes:
        position: (F, 3) metres. A plane wave uses only its direction (a point far away).
        axis: (F, 3) unit vectors; the polarisation is the normalised projection of the axis across the ray.
        cross: use the perpendicular of this projection instead (H instead of V).
    """

    position: np.ndarray
    axis: np.ndarray
    cross: bool = False


@dataclass(frozen=True)
class Occluder:
    """Static geometry that can block the line between sensor and object.

    Attributes:
        geometry: the blocking surfaces.
        rotation, translation: (F, 3, 3) and (F, 3), map from the object's frame to the occluder's frame per pose.
    """

    geometry: Geometry
    rotation: np.ndarray
    translation: np.ndarray


@dataclass(frozen=True)
class TraceOptions:
    """How to trace a grid of tubes.

    Attributes:
        max_bounces: largest number of reflections.
        cluster: (faces,) cluster of each face, or None. Only tubes whose first hit lies on a face of cluster `first_cluster` count, so that
            grids of different density divide the scene between them.
        labels: (faces,) below 4095, packed into `Hits.sequence`; None: not recorded.
        occluder: tested between the sensor and the first and last hit.
        prune: drop hits below this share of the strongest hit of their pose in the same block (`division.blocks`).
        hats: weight all tubes by hats, as rooms need; otherwise only tubes on curved facets.
        pieces: odd. A tube that straddles two smooth patches, or that a curved surface spreads onto another, is traced in this many pieces
            along each grid axis.
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
    """The contributing hits of a grid of tubes.

    Attributes:
        pose, tube: (N,) index of the pose and of the tube in its grid. bounce: (N,) number of reflections, from 1.
        amplitude: (N, Q) complex, for signals exp(+j k L), without the propagation phase.
        length_in_m, length_out_m: (N,) float64, source to hit (unfolded) and hit to receiver.
        departure, arrival: (N, 3) unit vectors from source and receiver towards the path.
        first_m: (N,) float64, source to first hit.
        sequence: (N,) uint64, labels of the faces met, see `unpack_labels`.
    """

    pose: np.ndarray
    tube: np.ndarray
    bounce: np.ndarray
    amplitude: np.ndarray
    length_in_m: np.ndarray
    length_out_m: np.ndarray
    departure: np.ndarray
    arrival: np.ndarray
    first_m: np.ndarray
    sequence: np.ndarray

    def where(self, keep: np.ndarray) -> "Hits":
        """The hits selected by a mask or by indices."""
        return Hits(*(getattr(self, field.name)[keep] for field in fields(Hits)))

    @staticmethod
    def concatenate(parts: Sequence["Hits"]) -> "Hits":
        if len(parts) == 1:
            return parts[0]
        return Hits(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Hits)))

    @staticmethod
    def none(nodes: int) -> "Hits":
        """No hits, at `nodes` frequencies."""
        index, length, vectors = np.zeros(0, int), np.zeros(0), np.zeros((0, 3))
        amplitude, sequence = np.zeros((0, nodes), complex), np.zeros(0, np.uint64)
        return Hits(index, index, index, amplitude, length, length, vectors, vectors, length, sequence)
