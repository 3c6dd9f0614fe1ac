"""Hold geometries as Dr.Jit arrays on the device that computes (GPU or CPU).

Import this module only after a Mitsuba variant is active.
"""

from collections.abc import Callable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from radartwin.simulation.drjit_arrays import upload
from radartwin.simulation.geometry import Geometry


def rows(values: np.ndarray) -> Callable[..., Any]:
    """Return a function that reads rows of `values` (F, 3) by index, as 3-vectors."""
    columns = [upload(mi.Float, values[:, i]) for i in range(3)]
    return lambda index, active=True: mi.Vector3f(*(dr.gather(mi.Float, column, index, active) for column in columns))


def scalars(values: np.ndarray) -> Callable[[Any], Any]:
    """Return a function that reads entries of `values` (F,) by index."""
    column = upload(mi.Float, values)
    return lambda index: dr.gather(mi.Float, column, index)


class Device:
    """Hold the triangles of a geometry on the GPU or CPU that traces the tubes."""

    def __init__(self, geometry: Geometry, cluster: np.ndarray | None, labels: np.ndarray | None, hats: bool):
        self.scene = geometry.scene()
        self.hats = dr.opaque(mi.Bool, hats)
        self.corner = upload(mi.Float, geometry.corners)
        self.normal = upload(mi.Float, geometry.normals)
        self.surface = upload(mi.UInt32, geometry.surface)
        self.cluster = None if cluster is None else upload(mi.UInt32, cluster)
        self.labels = None if labels is None else upload(mi.UInt64, labels + 1)
        # Rays start this many metres above a surface. The height is well above the float32 resolution of the surface's coordinates.
        self.lift = dr.opaque(mi.Float, max(2e-6 * geometry.extent_m, 1e-7))
        self.curved = geometry.curved
        self.patch = upload(mi.UInt32, geometry.patch + 1)

    def in_cluster(self, face: Any, cluster: int, active: Any) -> Any:
        """Return a mask of the active tubes whose facet belongs to the object cluster `cluster`; without clusters, all active tubes."""
        if self.cluster is None:
            return active
        return active & (dr.gather(mi.UInt32, self.cluster, face, active) == dr.opaque(mi.UInt32, cluster))

    @staticmethod
    def corners(source: Any, face: Any, active: Any) -> list[Any]:
        """Read the three corner positions or the three vertex normals of a facet from the array `source` (`corner` or `normal`)."""
        return [mi.Vector3f(*(dr.gather(mi.Float, source, face * 9 + 3 * c + i, active) for i in range(3))) for c in range(3)]
