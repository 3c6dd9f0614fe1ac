"""Compute the reflection and transmission of layered walls and bottles for plane waves. Ref: ITU-R P.2040-4, section 2.2.2.

Symbols of the reference and their names in the code: R_e and T_e -> te (electric field perpendicular to the plane of incidence), R_m and
T_m -> tm (electric field parallel to the plane of incidence), theta_0 -> incidence, eta -> permittivity. The time convention is
exp(+j omega t), so a lossy medium has the permittivity eta' - j eta''. The reflection coefficient tm is the ratio of the reflected electric
field along e_r = k_r x s to the incident electric field along e_i = k_i x s. Here k_i and k_r are the directions of the incident and the
reflected wave, and s is the unit vector perpendicular to the plane of incidence. A perfect conductor therefore has te = -1 and tm = +1, and
at normal incidence tm = -te. For transmission, the incident and the transmitted field are along e_i, so that te and tm are 1 if there are
no layers.
"""

import numbers
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import MaterialError
from radartwin.materials.containers import EMPTY
from radartwin.materials.permittivity_by_name import check_name, permittivity, split
from radartwin.materials.roughness import ament, ament_transmitted
from radartwin.materials.sheets import MATERIAL_THICKNESS, SHEETS


@dataclass(frozen=True)
class Layered:
    """Describe a stack of homogeneous layers, on which a wave is incident from air.

    Attributes:
        layers: pairs (material name, thickness in metres). The first layer is the one that the wave meets first.
        backing: material name of the half-space behind the last layer. A wave passes through a stack only if its backing is "air".

    >>> double_glazing = Layered([("glass", 0.004), ("air", 0.016), ("glass", 0.004)])
    >>> bottle_of_water = Layered([("pet", 0.0005)], backing="water")
    """

    layers: tuple[tuple[str, float], ...]
    backing: str = "air"

    def __init__(self, layers: Sequence[tuple[str, float]], backing: str = "air"):
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


def layered(material: str | Layered) -> Layered:
    """Return the layers of a material: a `Layered` stack itself, the sheet of a name in MATERIAL_THICKNESS, or else a half-space.

    Raises:
        MaterialError: the name is unknown.

    >>> layered("glass"), layered("concrete").backing
    (Layered(layers=(('glass', 0.006),), backing='air'), 'concrete')
    """
    if isinstance(material, Layered):
        return material
    thickness = MATERIAL_THICKNESS.get(split(material)[0])
    return Layered([], backing=material) if thickness is None else Layered([(material, thickness)])


def half_space(material: str | Layered) -> Layered:
    """Return a half-space of the outermost layer of a material.

    >>> half_space("glass")
    Layered(layers=(), backing='glass')
    """
    stack = layered(material)
    return Layered([], backing=stack.layers[0][0] if stack.layers else stack.backing)


def common_sheet(name: str) -> Layered:
    """Return the layers of a row of `sheets.SHEETS`, such as "door" or "double glazing", with air behind the last layer."""
    return Layered(SHEETS[name].layers)


def reflection(
    material: str | Layered, cos_incidence: np.ndarray, frequency_hz: np.ndarray, roughness_m: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the complex reflection coefficients (te, tm) of a material for a wave from air.

    Args:
        material: name of a material or stack of layers; see `layered`.
        cos_incidence: cosine of the angle of incidence from the normal, broadcastable with `frequency_hz`.
        frequency_hz: frequencies in Hz.
        roughness_m: rms height of the surface in metres; Ament's roughness factor multiplies both coefficients.
    Returns:
        te, tm: complex TE and TM reflection coefficients, of the broadcast shape.
    Raises:
        MaterialError: unknown material, or a material without values at these frequencies.
    """
    stack = layered(material)
    frequency_hz = np.asarray(frequency_hz, float)
    eta, thicknesses_m = _layers(stack, frequency_hz)
    te, tm, *_ = stack_coefficients(eta, thicknesses_m, permittivity(stack.backing, frequency_hz), cos_incidence, frequency_hz)
    if roughness_m:
        loss = ament(roughness_m, cos_incidence, 2 * np.pi * frequency_hz / SPEED_OF_LIGHT)
        te, tm = te * loss, tm * loss
    return te, tm


def transmission(
    material: str | Layered, cos_incidence: np.ndarray, frequency_hz: np.ndarray, roughness_m: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Compute the complex transmission coefficients (te, tm) of a wall in air: field behind over field in front of the wall.

    The field in front of the wall is taken where the ray enters the wall. The field behind the wall is taken at the opposite point along
    the normal. For a wall of thickness d, the phase of the coefficient therefore replaces the phase k d cos_incidence of the path in air.

    Args:
        material: name of a material or stack of layers; see `layered`. Only the layers matter, because air replaces the backing. A
            half-space transmits nothing unless the material is air or vacuum.
        cos_incidence: cosine of the angle of incidence from the normal, broadcastable with `frequency_hz`.
        frequency_hz: frequencies in Hz.
        roughness_m: rms height of both faces of the wall in metres. The heights of the two faces are independent of each other; see
            `roughness.ament_transmitted`.
    Returns:
        te, tm: complex TE and TM transmission coefficients, of the broadcast shape; they are equal at normal incidence.
    Raises:
        MaterialError: unknown material, or a material without values at these frequencies.

    >>> te, tm = transmission(Layered([("pet", 0.5e-3)]), np.array(1.0), np.array(77e9))
    >>> bool(np.isclose(te, tm)), float(np.round(20 * np.log10(abs(te)), 1))
    (True, -1.2)
    """
    frequency_hz, cos_incidence = np.asarray(frequency_hz, float), np.asarray(cos_incidence, float)
    shape = np.broadcast_shapes(cos_incidence.shape, frequency_hz.shape)
    stack = layered(material)
    if not stack.layers and stack.backing not in EMPTY:
        permittivity(stack.backing, frequency_hz)  # raises the errors that `reflection` raises
        return np.zeros(shape, complex), np.zeros(shape, complex)
    eta, thicknesses_m = _layers(stack, frequency_hz)
    *_, te, tm = stack_coefficients(eta, thicknesses_m, np.array(1.0 + 0j), cos_incidence, frequency_hz)
    if roughness_m and stack.layers:
        wavenumber = 2 * np.pi * frequency_hz / SPEED_OF_LIGHT
        for face in (eta[0], eta[-1]):
            loss = ament_transmitted(roughness_m, cos_incidence, wavenumber, face)
            te, tm = te * loss, tm * loss
    return te, tm


def _layers(stack: Layered, frequency_hz: np.ndarray) -> tuple[list[np.ndarray], list[float]]:
    """Return the complex permittivity and the thickness in metres of every layer of a stack."""
    return [permittivity(name, frequency_hz) for name, _ in stack.layers], [thickness for _, thickness in stack.layers]


class Coefficients(NamedTuple):
    """Hold the reflection and transmission coefficients of a stack; all coefficients are ratios of electric fields."""

    reflected_te: np.ndarray
    reflected_tm: np.ndarray
    transmitted_te: np.ndarray
    transmitted_tm: np.ndarray


def stack_coefficients(
    permittivities: Sequence[np.ndarray],
    thicknesses_m: Sequence[float],
    backing: np.ndarray,
    cos_incidence: np.ndarray,
    frequency_hz: np.ndarray,
) -> Coefficients:
    """Compute the complex coefficients of a stack for a wave from air, interface by interface from the backing outwards.

    The recursion contains decaying exponentials only, so a thick lossy wall causes neither overflow nor loss of precision.

    Args:
        permittivities: one complex array per layer, outermost first, broadcastable with `cos_incidence`.
        thicknesses_m: thickness of each layer in metres.
        backing: complex permittivity of the half-space behind the last layer.
        cos_incidence: cosine (...,) of the angle of incidence from the normal in air, above 0 and at most 1.
        frequency_hz: frequencies in Hz, broadcastable with `cos_incidence`.
    Returns:
        Coefficients of the broadcast shape. A transmission coefficient is the field just behind the stack over the field just in front.
    Raises:
        MaterialError: a permittivity has gain, that is, a positive imaginary part.

    >>> half_space = stack_coefficients([], [], np.array(4.0 + 0j), np.array(1.0), np.array(77e9))
    >>> complex(np.round(half_space.reflected_te, 6)), complex(np.round(half_space.reflected_tm, 6))
    ((-0.333333+0j), (0.333333+0j))
    >>> half_wave = stack_coefficients([np.array(4.0 + 0j)], [299792458 / 77e9 / 4], np.array(1.0 + 0j), np.array(1.0), np.array(77e9))
    >>> complex(np.round(half_wave.transmitted_te, 6) + 0)
    (-1+0j)
    """
    k0 = 2 * np.pi * np.asarray(frequency_hz, float) / SPEED_OF_LIGHT
    sin2 = 1 - np.asarray(cos_incidence, float) ** 2
    media = [np.ones_like(sin2) + 0j, *[np.asarray(p) + 0j for p in permittivities], np.asarray(backing) + 0j]
    if any(np.any(m.imag > 1e-9) for m in media):
        raise MaterialError("a permittivity has gain (positive imaginary part under exp(+j omega t)); give eta' - j eta'' with eta'' >= 0")
    # The principal root has Re > 0; with eta'' >= 0 its imaginary part is <= 0: the wave decays inwards.
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
        if inner == len(media) - 1:  # the last interface has no layer behind it
            te, tm, through_te, through_tm = r_te, r_tm, t_te, t_tm
            continue
        once = np.exp(-1j * k0 * kz[inner] * thicknesses_m[inner - 1])
        te, through_te = (r_te + te * once**2) / (1 + r_te * te * once**2), t_te * once * through_te / (1 + r_te * te * once**2)
        tm, through_tm = (r_tm + tm * once**2) / (1 + r_tm * tm * once**2), t_tm * once * through_tm / (1 + r_tm * tm * once**2)
    shape = np.broadcast_shapes(np.shape(te), np.shape(sin2), np.shape(k0))
    return Coefficients(*(np.broadcast_to(c, shape) for c in (te, tm, through_te, through_tm)))
