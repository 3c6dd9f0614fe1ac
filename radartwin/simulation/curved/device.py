"""Arrays, geometry and reflection on the device, for the tracer's kernels. Import only once a Mitsuba variant is active.

Arrays are Dr.Jit's. Numbers that change from call to call are made opaque, for a literal in a kernel means compiling it again.
"""

from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from radartwin.simulation.geometry import Geometry
from radartwin.simulation.reflection_table import COSINES, ReflectionTable

_ALIGNED = 64  # bytes; the widest vector of any CPU
_KINDS = {"Float": np.float32, "UInt": np.uint32, "UInt64": np.uint64, "Bool": np.bool_}


def upload(kind: Any, values: np.ndarray) -> Any:
    """An array on the device whose kernels do not depend on where its values came from. On the CPU, Dr.Jit uses NumPy's memory as it is and
    compiles for its alignment, which changes from call to call; and a single value would be compiled into the kernel."""
    if np.size(values) == 1:
        return dr.opaque(kind, np.asarray(values).reshape(-1)[0].item())
    itemsize = dr.itemsize_v(kind)
    flat = np.asarray(values).ravel()
    room = np.empty(flat.size * itemsize + _ALIGNED, np.uint8)
    start = -room.ctypes.data % _ALIGNED
    aligned = room[start : start + flat.size * itemsize].view(_KINDS[kind.__name__])
    aligned[:] = flat
    return kind(aligned)


def rows(values: np.ndarray) -> Callable[..., Any]:
    """(F, 3) on the device, as a function that gathers vectors by index."""
    columns = [upload(mi.Float, values[:, i]) for i in range(3)]
    return lambda index, active=True: mi.Vector3f(*(dr.gather(mi.Float, column, index, active) for column in columns))


def scalars(values: np.ndarray) -> Callable[[Any], Any]:
    """(F,) on the device, as a function that gathers by index."""
    column = upload(mi.Float, values)
    return lambda index: dr.gather(mi.Float, column, index)


class Device:
    """A geometry and its reflection on the device, with the gathers the kernels make."""

    def __init__(self, geometry: Geometry, table: ReflectionTable, cluster: np.ndarray | None, labels: np.ndarray | None, hats: bool):
        self.scene = geometry.scene()
        self.hats = dr.opaque(mi.Bool, hats)
        self.corner = upload(mi.Float, geometry.corners)
        self.normal = upload(mi.Float, geometry.normals)
        self.surface = upload(mi.UInt32, geometry.surface)
        self.cluster = None if cluster is None else upload(mi.UInt32, cluster)
        self.labels = None if labels is None else upload(mi.UInt64, labels + 1)
        self.nodes = len(table.frequencies_hz)
        self.coefficients = self.tabulated(table.te, table.tm)
        # rays leave a surface this far above it: well over the float32 resolution of its coordinates
        self.lift = dr.opaque(mi.Float, max(2e-6 * geometry.extent_m, 1e-7))
        self.curved = geometry.curved
        self.patch = upload(mi.UInt32, geometry.patch + 1)

    @staticmethod
    def corners(source: Any, face: Any, active: Any) -> list[Any]:
        """The three corner vectors of a face from one of the per-corner arrays."""
        return [mi.Vector3f(*(dr.gather(mi.Float, source, face * 9 + 3 * c + i, active) for i in range(3))) for c in range(3)]

    @staticmethod
    def tabulated(te: np.ndarray, tm: np.ndarray) -> list[Any]:
        """Coefficients (S, COSINES, Q) as `lookup` takes them."""
        return [upload(mi.Float, part) for c in (te, tm) for part in (np.real(c), np.imag(c))]

    def reflection(self, face: Any, cosine: Any, node: int, active: Any) -> list[Any]:
        """[te.re, te.im, tm.re, tm.im] at one frequency node."""
        return self.lookup(self.coefficients, face, cosine, node, active)

    def lookup(self, coefficients: list[Any], face: Any, cosine: Any, node: int, active: Any) -> list[Any]:
        """[te.re, te.im, tm.re, tm.im] of tabulated coefficients, linear in the cosine."""
        x = dr.clip(cosine, 0, 1) * (COSINES - 1)
        low = dr.minimum(mi.UInt32(x), COSINES - 2)
        weight = x - mi.Float(low)
        index = (dr.gather(mi.UInt32, self.surface, face, active) * COSINES + low) * self.nodes + node
        return [
            dr.lerp(dr.gather(mi.Float, c, index, active), dr.gather(mi.Float, c, index + self.nodes, active), weight) for c in coefficients
        ]
