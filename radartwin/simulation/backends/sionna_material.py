"""Define a material for Sionna RT whose reflection coefficients come from a table over mesh face and angle of incidence.

Sionna's own material is one homogeneous slab in air, but the walls of radartwin's scenes are stacks of layers. The table holds the
coefficients of `radartwin.materials.reflection` at 4096 or more equally spaced cosines of incidence, with linear interpolation between
them. The interpolation error is below 3e-3 of the incident field for all wall, floor and ceiling materials of the rooms, at angles of
incidence up to 89.7 degrees. For a slab in air, the table agrees with Sionna's own material. Tests check both statements. Sionna's own code
computes polarisation, diffuse pattern and sampling probabilities. A single material object serves all surfaces, because Dr.Jit processes
the code of every material object on each call. Import this module only in the worker process, after the process has activated its Mitsuba
variant.
"""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from sionna.rt import RadioMaterial


class TabulatedMaterial(RadioMaterial):
    """Reflect waves at each mesh face with the tabulated coefficients of the face's material.

    Args:
        row: (F,) index of the table row that holds the coefficients of each of F faces.
        scattering: (F,) Sionna's scattering coefficient of each face, from 0 to 1. Its square is the scattered fraction of the reflected
            power.
    """

    def __init__(self, row: np.ndarray, scattering: np.ndarray) -> None:
        # Sionna uses the conductivity to choose between reflection and transmission. With the conductivity of a metal, it always reflects.
        super().__init__(name="tabulated", conductivity=1e7)
        self._rows = mi.UInt(np.ascontiguousarray(row, np.uint32))
        self._scattering = mi.Float(np.ascontiguousarray(scattering, np.float32))
        self._table: list[Any] = []
        self._cosines = 0
        self._row: Any = None
        dr.make_opaque(self._rows, self._scattering)

    def use(self, te: np.ndarray, tm: np.ndarray) -> None:
        """Set the complex TE and TM reflection tables (D materials, C equally spaced cosines of incidence from 0 to 1)."""
        self._cosines = te.shape[1]
        parts = (np.real(te), np.imag(te), np.real(tm), np.imag(tm))
        self._table = [mi.Float(np.ascontiguousarray(part, np.float32).ravel()) for part in parts]
        dr.make_opaque(self._table)

    def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
        self._select(si)
        return super().sample(ctx, si, sample1, sample2, active)

    def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        self._select(si)
        return super().eval(ctx, si, wo, active)

    def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        self._select(si)
        return super().pdf(ctx, si, wo, active)

    def _select(self, si: Any) -> None:
        """Select the table rows of the faces that the rays hit, and set the scattering coefficients that Sionna reads."""
        self._row = dr.gather(mi.UInt, self._rows, si.prim_index)
        self._s = dr.gather(mi.Float, self._scattering, si.prim_index)

    def _specular_reflection_transmission_matrix(
        self, to_world: Any, ki_local: Any, ko_local: Any, reflection: Any, r_te: Any, r_tm: Any, t_te: Any, t_tm: Any
    ) -> Any:
        """Return Sionna's Jones matrix of the reflection, computed with the tabulated coefficients instead of Sionna's r_te and r_tm."""
        place = dr.clip(-ki_local.z, 0, 1) * (self._cosines - 1)
        below = dr.minimum(mi.UInt(place), self._cosines - 2)
        share, index = place - mi.Float(below), below + self._row * self._cosines
        values = [dr.lerp(dr.gather(mi.Float, part, index), dr.gather(mi.Float, part, index + 1), share) for part in self._table]
        pair: Any = mi.Complex2f
        te, tm = pair(values[0], values[1]), pair(values[2], values[3])
        return super()._specular_reflection_transmission_matrix(to_world, ki_local, ko_local, reflection, te, tm, t_te, t_tm)
