"""Hold geometries as Dr.Jit arrays on the device that computes (GPU or CPU).

Import this module only after a Mitsuba variant is active.
"""

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from radartwin.simulation.drjit_arrays import upload
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.hits import TraceOptions


@dataclass
class Device:
    """Hold the triangles of a geometry on the GPU or CPU that traces the tubes."""

    scene: Any  # Mitsuba scene of the triangles
    hats: Any  # whether all tubes have hat weights
    corner: Any  # (F x 9,) corners of the facets
    normal: Any  # (F x 9,) vertex normals of the facets
    surface: Any  # (F,) number of the surface of each facet
    cluster: Any  # (F,) number of the object cluster of each facet; None without clusters
    first_cluster: Any  # number of the object cluster of the first hit; None without clusters
    lift: Any  # rays start this many metres above a surface, as `Geometry.lift_m`
    curved: bool  # whether the geometry has curved facets
    patch: Any  # (F,) number of the smooth surface patch of each facet plus 1

    @staticmethod
    def of(geometry: Geometry, options: TraceOptions) -> "Device":
        """Copy a geometry to the device."""
        clusters = None if options.cluster is None else (upload(mi.UInt32, options.cluster), dr.opaque(mi.UInt32, options.first_cluster))
        return Device(
            geometry.scene, dr.opaque(mi.Bool, options.hats), upload(mi.Float, geometry.corners), upload(mi.Float, geometry.normals),
            upload(mi.UInt32, geometry.surface), *(clusters or (None, None)),
            dr.opaque(mi.Float, geometry.lift_m), geometry.curved, upload(mi.UInt32, geometry.patch + 1),
        )  # fmt: skip

    def in_cluster(self, face: Any, active: Any) -> Any:
        """Return a mask of the active tubes whose facet belongs to the first cluster; without clusters, all active tubes."""
        if self.cluster is None:
            return active
        return active & (dr.gather(mi.UInt32, self.cluster, face, active) == self.first_cluster)

    @staticmethod
    def corners(source: Any, face: Any, active: Any) -> list[Any]:
        """Read the three corner positions or the three vertex normals of a facet from the array `source` (`corner` or `normal`)."""
        return [mi.Vector3f(*(dr.gather(mi.Float, source, face * 9 + 3 * c + i, active) for i in range(3))) for c in range(3)]
