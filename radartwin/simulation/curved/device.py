"""Dr.Jit arrays, geometry and reflection tables on the device. Import only after a Mitsuba variant is active.

Numbers that change from call to call become opaque Dr.Jit variables, because Dr.Jit compiles a kernel again for every new literal.
"""

from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from radartwin.simulation.geometry import Geometry
from radartwin.simulation.reflection_table import COSINES, ReflectionTable

_ALIGNMENT = 64  # bytes, the widest vector of any CPU
_DTYPES = {"Float": np.float32, "UInt": np.uint32, "UInt64": np.uint64, "Bool": np.bool_}


def upload(kind: Any, values: np.ndarray) -> Any:
    """Copy values to a device array of type `kind` in such a way that Dr.Jit does not compile kernels again.

    On the CPU, compiled kernels depend on the alignment of NumPy's memory, which changes from call to call. The values are therefore copied
    to aligned memory. A single value becomes opaque, because Dr.Jit would otherwise compile it into the kernel.
    """
    if np.size(values) == 1:
        return dr.opaque(kind, np.asarray(values).reshape(-1)[0].item())
    itemsize = dr.itemsize_v(kind)
    flat = np.asarray(values).ravel()
    buffer = np.empty(flat.size * itemsize + _ALIGNMENT, np.uint8)
    start = -buffer.ctypes.data % _ALIGNMENT
    aligned = buffer[start : start + flat.size * itemsize].view(_DTYPES[kind.__name__])
    aligned[:] = flat
    return kind(aligned)


def rows(values: np.ndarray) -> Callable[..., Any]:
    """Return a function that gathers vectors by index from values (F, 3)."""
    columns = [upload(mi.Float, values[:, i]) for i in range(3)]
    return lambda index, active=True: mi.Vector3f(*(dr.gather(mi.Float, column, index, active) for column in columns))


def scalars(values: np.ndarray) -> Callable[[Any], Any]:
    """Return a function that gathers scalars by index from values (F,)."""
    column = upload(mi.Float, values)
    return lambda index: dr.gather(mi.Float, column, index)


class Device:
    """Hold a geometry and its reflection table on the device."""

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
        # rays start at this height above a surface, well above the float32 resolution of its coordinates
        self.lift = dr.opaque(mi.Float, max(2e-6 * geometry.extent_m, 1e-7))
        self.curved = geometry.curved
        self.patch = upload(mi.UInt32, geometry.patch + 1)

    def in_cluster(self, face: Any, cluster: int, active: Any) -> Any:
        """Return the active lanes whose face is in the cluster; all active lanes if there are no clusters."""
        if self.cluster is None:
            return active
        return active & (dr.gather(mi.UInt32, self.cluster, face, active) == dr.opaque(mi.UInt32, cluster))

    @staticmethod
    def corners(source: Any, face: Any, active: Any) -> list[Any]:
        """Gather the three vectors of a face from `corner` or `normal`."""
        return [mi.Vector3f(*(dr.gather(mi.Float, source, face * 9 + 3 * c + i, active) for i in range(3))) for c in range(3)]

    @staticmethod
    def tabulated(te: np.ndarray, tm: np.ndarray) -> list[Any]:
        """Upload coefficients (S, COSINES, Q) in the form that `lookup` reads."""
        return [upload(mi.Float, part) for c in (te, tm) for part in (np.real(c), np.imag(c))]

    def lookup(self, coefficients: list[Any], face: Any, cosine: Any, node: int, active: Any) -> list[Any]:
        """Interpolate [te.re, te.im, tm.re, tm.im] at one frequency node from tabulated coefficients, linearly in the cosine."""
        x = dr.clip(cosine, 0, 1) * (COSINES - 1)
        low = dr.minimum(mi.UInt32(x), COSINES - 2)
        weight = x - mi.Float(low)
        index = (dr.gather(mi.UInt32, self.surface, face, active) * COSINES + low) * self.nodes + node
        return [
            dr.lerp(dr.gather(mi.Float, c, index, active), dr.gather(mi.Float, c, index + self.nodes, active), weight) for c in coefficients
        ]
