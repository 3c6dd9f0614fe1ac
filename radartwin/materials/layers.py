"""Layered slabs: what a plane wave sees of a wall or of a bottle, and what passes. Ref: ITU-R P.2040-4, section 2.2.2.

Symbols: R_e, R_m, T_e, T_m -> te, tm (electric field perpendicular / parallel to the plane of incidence), theta_0 -> incidence,
eta -> permittivity. Time convention exp(+j omega t), so that loss is eta' - j eta''. The sign of tm is that of the
electric field's component along the reflected parallel unit vector e_r = k_r x s, with e_i = k_i x s before: a perfect conductor
has te = -1, tm = +1, and at normal incidence tm = -te. Transmitted fields keep their unit vectors: without a stack, both are one.
"""

import numbers
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import MaterialError


@dataclass(frozen=True)
class Layered:
    """A stack of homogeneous layers seen from air.

    Attributes:
        layers: (material name, thickness in metres), the outermost first.
        backing: what lies behind without end: "air" or a material name.
    """

    layers: tuple[tuple[str, float], ...]
    backing: str = "air"

    def __init__(self, layers: Sequence[tuple[str, float]], backing: str = "air"):
        from radartwin.materials import check_name

        checked = []
        for entry in layers:
            if not isinstance(entry, Sequence) or isinstance(entry, str) or len(entry) != 2:
                raise MaterialError(f"Layered: a layer is (material, thickness_m), not {entry!r}")
            name, thickness = entry
            check_name(name)
            if isinstance(thickness, bool) or not isinstance(thickness, numbers.Real) or not 0 < thickness < np.inf:
                raise MaterialError(f"Layered: thickness of {name!r} must be positive metres, not {thickness!r}")
            checked.append((str(name), float(thickness)))
        check_name(backing)
        object.__setattr__(self, "layers", tuple(checked))
        object.__setattr__(self, "backing", backing)


def stack_reflection(
    permittivities: Sequence[np.ndarray],
    thicknesses_m: Sequence[float],
    backing: np.ndarray,
    cos_incidence: np.ndarray,
    frequency_hz: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Complex (te, tm) of a stack, seen from air.

    Evaluated from the backing outwards, one interface after the other, in terms that only ever contain decaying
    exponentials (a lossy 15 cm wall neither overflows nor loses digits).

    Args:
        permittivities: one complex array per layer, outermost first, broadcastable with `cos_incidence`.
        thicknesses_m: one per layer.
        backing: complex permittivity behind the last layer.
        cos_incidence: cosine of the angle from the normal in air, shape (...,), 0 < cos <= 1.
        frequency_hz: broadcastable with `cos_incidence`.
    Returns:
        (te, tm), complex, of the broadcast shape.
    Raises:
        MaterialError: a permittivity with gain.

    >>> te, tm = stack_reflection([], [], np.array(4.0 + 0j), np.array(1.0), np.array(77e9))
    >>> complex(np.round(te, 6)), complex(np.round(tm, 6))
    ((-0.333333+0j), (0.333333+0j))
    """
    te, tm, _, _ = _stack(permittivities, thicknesses_m, backing, cos_incidence, frequency_hz)
    return te, tm


def stack_transmission(
    permittivities: Sequence[np.ndarray],
    thicknesses_m: Sequence[float],
    cos_incidence: np.ndarray,
    frequency_hz: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Complex (te, tm) that a stack between air and air lets through: field just behind it over field just before it.

    Arguments and errors as for `stack_reflection`. A wave that goes straight through a stack of thickness d and on to L has the phase
    k (L - d cos_incidence) and the coefficient's own; without layers the coefficient is one.

    >>> te, _ = stack_transmission([np.array(4.0 + 0j)], [299792458 / 77e9 / 4], np.array(1.0), np.array(77e9))  # half a wave thick
    >>> complex(np.round(te, 6) + 0)
    (-1+0j)
    """
    _, _, te, tm = _stack(permittivities, thicknesses_m, np.array(1.0 + 0j), cos_incidence, frequency_hz)
    return te, tm


def _stack(
    permittivities: Sequence[np.ndarray],
    thicknesses_m: Sequence[float],
    backing: np.ndarray,
    cos_incidence: np.ndarray,
    frequency_hz: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Reflection (te, tm) and transmission (te, tm) of a stack; TM in ratios of the electric field's parallel component."""
    k0 = 2 * np.pi * np.asarray(frequency_hz, float) / SPEED_OF_LIGHT
    sin2 = 1 - np.asarray(cos_incidence, float) ** 2
    media = [np.ones_like(sin2) + 0j, *[np.asarray(p) + 0j for p in permittivities], np.asarray(backing) + 0j]
    if any(np.any(m.imag > 1e-9) for m in media):
        raise MaterialError("a permittivity with gain (positive imaginary part under exp(+j omega t))")
    # Principal root has Re > 0; with eta'' >= 0 its imaginary part is <= 0, a wave decaying inwards.
    kz = [np.asarray(cos_incidence) + 0j, *[np.sqrt(m - sin2) for m in media[1:]]]
    index = [np.sqrt(m) for m in media]
    te = tm = np.zeros(())
    through_te = through_tm = np.ones(())
    for outer in range(len(media) - 2, -1, -1):
        inner = outer + 1
        r_te = (kz[outer] - kz[inner]) / (kz[outer] + kz[inner])
        denominator = media[inner] * kz[outer] + media[outer] * kz[inner]
        r_tm = (media[inner] * kz[outer] - media[outer] * kz[inner]) / denominator
        t_te = 1 + r_te
        t_tm = 2 * index[inner] * index[outer] * kz[outer] / denominator
        if inner == len(media) - 1:  # the last interface has nothing behind it
            te, tm, through_te, through_tm = r_te, r_tm, t_te, t_tm
            continue
        once = np.exp(-1j * k0 * kz[inner] * thicknesses_m[inner - 1])
        te, through_te = (r_te + te * once**2) / (1 + r_te * te * once**2), t_te * once * through_te / (1 + r_te * te * once**2)
        tm, through_tm = (r_tm + tm * once**2) / (1 + r_tm * tm * once**2), t_tm * once * through_tm / (1 + r_tm * tm * once**2)
    shape = np.broadcast_shapes(np.shape(te), np.shape(sin2), np.shape(k0))
    te, tm, through_te, through_tm = (np.broadcast_to(c, shape) for c in (te, tm, through_te, through_tm))
    return te, tm, through_te, through_tm
