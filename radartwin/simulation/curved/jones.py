"""Compute the amplitudes of hits from the facets that their tubes met, for many frequencies at once (Jones calculus).

The tracer finds where tubes meet facets, which does not depend on frequency. This module then computes the fields. The field of a tube has
one component along a unit vector across its direction, and one component along the cross product of the direction with this vector. At each
facet, the two components turn by an angle to the TE and TM components of the facet's plane of incidence. Reflection or transmission then
multiplies each component by its coefficient. The receive polarisation vector passes through walls in the same way, because transmission is
reciprocal.
"""

from dataclasses import dataclass

import numpy as np

from radartwin.compiled import compiled, fixed, innermost, shared_out
from radartwin.simulation.flat.crossing import looked_up
from radartwin.simulation.reflection_table import ReflectionTable

FEW_NODES = 4  # number of frequency nodes whose amplitudes decide whether a hit is weak
GRAIN = 4000  # smallest number of amplitudes that one thread computes


@dataclass(frozen=True)
class Encounters:
    """Hold the K facets that each of N tubes met in turn. `code` is twice the number of the surface, plus 1 for transmission."""

    code: np.ndarray  # (K, N) uint32
    angles: np.ndarray  # (K, 3, N) float32: cosine of incidence, and cosine and sine of the angle by which the field's components turn

    def where(self, keep: np.ndarray) -> "Encounters":
        """Return the encounters of the tubes that the indices `keep` select."""
        return Encounters(np.ascontiguousarray(self.code[:, keep]), np.ascontiguousarray(self.angles[:, :, keep]))


class Coefficients:
    """Hold the reflection and transmission coefficients (S surfaces, C cosines, Q frequency nodes) by which fields are multiplied."""

    def __init__(self, reflecting: ReflectionTable, transmitting: ReflectionTable):
        values = reflecting.te, reflecting.tm, transmitting.through_te, transmitting.through_tm
        self.values = tuple(fixed(np.asarray(value, np.complex128)) for value in values)
        nodes = reflecting.te.shape[2]
        self.every = np.arange(nodes)
        self.few = np.unique(np.linspace(0, nodes - 1, min(nodes, FEW_NODES)).round().astype(int))

    def amplitudes(
        self, nodes: np.ndarray, before: Encounters, after: Encounters, received: np.ndarray, size: np.ndarray, least: np.ndarray
    ) -> np.ndarray:
        """Return the complex amplitudes (N, nodes) of N hits for signals with the phase factor exp(+j k L).

        Args:
            nodes: indices of the frequency nodes.
            before: encounters of the tubes; the last encounter reflects the tube to the receiver.
            after: encounters of the receive polarisation vector with the walls between the last reflection and the receiver.
            received: (8, N) factors from the last field to the received field. The first four belong to the receive polarisation vector
                without walls: for the incident TE and TM components, and for the reflected TE and TM components. The other four belong to
                the cross product of the direction with this vector, in the same order.
            size: (2, N) real and imaginary part of the factor of a footprint.
            least: (N,) amplitudes below which hits may have the amplitude zero.
        """
        out = np.empty((received.shape[1], len(nodes)), complex)
        received, size = np.ascontiguousarray(received), np.ascontiguousarray(size)  # so that the compiled function has one version only
        arguments = nodes, before.code, before.angles, after.code, after.angles, received, size, least, *self.values, out
        shared_out(_amplitudes, len(out), *arguments, grain=-(-GRAIN // len(nodes)))
        return out


@innermost
def _meet(a, b, nodes, code, cosine, turn_cos, turn_sin, te, tm, through_te, through_tm) -> None:  # fmt: skip
    """Turn the components `a`, `b` (Q,) of fields to the plane of incidence, and multiply them by the coefficients of the facet."""
    surface = code >> 1
    if code & 1:
        te, tm = through_te, through_tm
    for i in range(len(nodes)):
        q = nodes[i]
        s, p = a[i] * turn_cos + b[i] * turn_sin, b[i] * turn_cos - a[i] * turn_sin
        a[i], b[i] = s * looked_up(te, surface, cosine, q), p * looked_up(tm, surface, cosine, q)


@innermost
def _largest_power(a, b) -> float:
    """Return the largest power of fields with the components `a`, `b` (Q,)."""
    most = 0.0
    for i in range(len(a)):
        most = max(most, a[i].real ** 2 + a[i].imag ** 2 + b[i].real ** 2 + b[i].imag ** 2)
    return most


@compiled
def _amplitudes(
    first, last, nodes, code_before, before, code_after, after, received, size, least, te, tm, through_te, through_tm, out
) -> None:  # fmt: skip
    """Write the amplitudes of hits `first` to `last` - 1 to `out` (N, nodes); the arguments are those of `Coefficients.amplitudes`."""
    count, end = len(nodes), len(code_before) - 1
    work = np.empty((6, count), np.complex128)
    a, b, x, y, s, p = work[0], work[1], work[2], work[3], work[4], work[5]
    for n in range(first, last):
        a[:], b[:], x[:], y[:] = 1, 0, 1, 0
        back_cos, back_sin = 1.0, 0.0  # cosine and sine of the angle by which `x` and `y` have turned
        # No facet increases the power of a field, so the squared amplitude is at most `most` times the power of the field.
        most = 0.0
        for i in range(0, 8, 4):
            incident = np.sqrt(received[i, n] ** 2 + received[i + 1, n] ** 2)
            most += (incident + np.sqrt(received[i + 2, n] ** 2 + received[i + 3, n] ** 2)) ** 2
        most *= size[0, n] ** 2 + size[1, n] ** 2
        # outward: reflection and transmission on the way to the last facet
        power = 1.0
        for k in range(end):
            if most * power < least[n] ** 2:
                break
            code, angles = np.int64(code_before[k, n]), before[k, :, n]
            _meet(a, b, nodes, code, angles[0], angles[1], angles[2], te, tm, through_te, through_tm)
            power = _largest_power(a, b)
        if most * power < least[n] ** 2:
            out[n] = 0
            continue
        # back: the receive polarisation vector through the walls
        for k in range(len(code_after)):
            code, angles = np.int64(code_after[k, n]), after[k, :, n]
            _meet(x, y, nodes, code, angles[0], angles[1], angles[2], te, tm, through_te, through_tm)
            back_cos, back_sin = back_cos * angles[1] - back_sin * angles[2], back_sin * angles[1] + back_cos * angles[2]
        # at the last facet: TE and TM components of the incident field (s, p) and of the reflected field (a, b)
        angles = before[end, :, n]
        for i in range(count):
            s[i], p[i] = a[i] * angles[1] + b[i] * angles[2], b[i] * angles[1] - a[i] * angles[2]
            a[i], b[i] = s[i], p[i]
        _meet(a, b, nodes, np.int64(code_before[end, n]), angles[0], np.float32(1), np.float32(0), te, tm, through_te, through_tm)
        factor = complex(size[0, n], size[1, n])
        for i in range(count):
            # components that radiate along the polarisation vector without walls and across it, then both as seen through the walls
            along = received[0, n] * s[i] + received[1, n] * p[i] + received[2, n] * a[i] + received[3, n] * b[i]
            aside = received[4, n] * s[i] + received[5, n] * p[i] + received[6, n] * a[i] + received[7, n] * b[i]
            mine, other = x[i] * back_cos - y[i] * back_sin, x[i] * back_sin + y[i] * back_cos
            value = factor * (mine * along + other * aside)
            out[n, i] = complex(value.imag, value.real)
