"""Compute the loss of the mirror-reflected (coherent) field at rough surfaces, and list the rms height of each class of surface.

Roughness multiplies the coherent reflected field by Ament's factor rho_s = exp(-2 (k sigma_h cos theta)^2), where k is the wavenumber,
sigma_h the rms surface height and theta the angle of incidence. The factor is the mean of exp(2 j k h cos theta) over Gaussian heights h
(W. S. Ament, Proc. IRE 41 (1953) 142).

Ament's factor is valid for Gaussian heights, for gentle slopes (correlation length above a wavelength), and away from grazing incidence,
where parts of the surface shadow each other. Up to an rms height of lambda/(16 cos theta), which is 0.24 mm at 77 GHz and normal incidence,
the loss for other height distributions differs from the loss by Ament's factor by at most 0.25 dB. At the Rayleigh criterion, which is an
rms height of lambda/(8 cos theta) or 0.49 mm, Ament's factor gives a loss of 10.7 dB. Other height distributions then give losses that
differ by several dB. At larger rms heights, nearly all reflected power is diffuse. At such rms heights, measured surfaces reflect more
coherent power than Ament's factor predicts (A. Miller, R. Brown, E. Vegh, IEE Proc. H 131 (1984) 114).
"""

from typing import NamedTuple

import numpy as np

from radartwin.errors import MaterialError


class Roughness(NamedTuple):
    """Hold the rms height and the correlation length of a surface in metres, and the source of these values."""

    height_m: float
    correlation_m: float
    source: str


class Finish(NamedTuple):
    """Hold the rms height in metres of a surface whose roughness is judged by its look, and the source of this height."""

    height_m: float
    source: str


_PAPER = "RadarTwin paper, section on the simulator: metal 0.1 mm, rougher dielectrics 0.3 to 3 mm"
_PLASTER = "plaster and wallpaper in R. Piesiewicz et al., IEEE Trans. AP 55 (2007) 3002: 0.05 to 0.15 mm high, about 2 mm long"
_FLOAT = "float glass and polished or glazed faces: micrometres at most (EN 572-2, EN 14411)"
_PLANED = "planed, sanded or coated board: 5 to 30 um (profiles by ISO 21920), rounded up for raised grain"
_MOULDED = "moulded or coated: texture of the mould, 5 to 25 um (VDI 3400)"
_WOVEN = "half of an upholstery yarn of 0.5 to 1 mm"
_PILE = "upper end of the paper's range: pile, leaves and strands of millimetres"

# Correlation length in metres of smooth classes, and of a surface whose correlation length is not given. The value is that of concrete.
CORRELATION_M = 5e-3
# Roughness of each class of surface. Published rms heights differ by a factor of two or three from most of these values, and the coherent
# loss in dB grows with the square of the rms height. A study whose result depends on an rms height must therefore vary this height.
CLASSES = {
    "metal": Roughness(0.1e-3, 20e-3, _PAPER),
    "concrete": Roughness(0.3e-3, 5e-3, _PAPER),
    "brick": Roughness(0.5e-3, 5e-3, _PAPER),
    "plasterboard": Roughness(0.05e-3, 2e-3, _PLASTER),
    "plaster": Roughness(0.1e-3, 2e-3, _PLASTER),
    "painted": Roughness(0.05e-3, 2e-3, _PLASTER),
    "wallpaper": Roughness(0.12e-3, 2e-3, _PLASTER),
    "ceiling_board": Roughness(0.3e-3, 3e-3, _PAPER),
    "wood": Roughness(0.03e-3, 2e-3, _PLANED),
    "plywood": Roughness(0.03e-3, 2e-3, _PLANED),
    "chipboard": Roughness(0.03e-3, 2e-3, _PLANED),
    "floorboard": Roughness(0.03e-3, 2e-3, _PLANED),
    "paper": Roughness(0.03e-3, 2e-3, _PLANED),
    "glass": Roughness(0.0, CORRELATION_M, _FLOAT),
    "mirror": Roughness(0.0, CORRELATION_M, _FLOAT),
    "ceramic": Roughness(0.0, CORRELATION_M, _FLOAT),
    "tile": Roughness(0.01e-3, 5e-3, _FLOAT),
    "marble": Roughness(0.0, CORRELATION_M, _FLOAT),
    "polishedstone": Roughness(0.0, CORRELATION_M, _FLOAT),
    "water": Roughness(0.0, CORRELATION_M, "a liquid at rest"),
    "stone": Roughness(1e-3, 10e-3, _PAPER),
    "plastic": Roughness(0.02e-3, 2e-3, _MOULDED),
    "pet": Roughness(0.0, CORRELATION_M, _MOULDED),
    "hdpe": Roughness(0.02e-3, 2e-3, _MOULDED),
    "clear_acrylic": Roughness(0.0, CORRELATION_M, _MOULDED),
    "vinyl_tile": Roughness(0.05e-3, 2e-3, _MOULDED),
    "leather": Roughness(0.1e-3, 1e-3, _MOULDED + "; grain of hide"),
    "skin": Roughness(0.03e-3, 0.5e-3, "furrows of 20 to 100 um depth"),
    "fabric": Roughness(0.3e-3, 1e-3, _WOVEN),
    "carpet": Roughness(2e-3, 3e-3, _PILE),
    "carpet_tile": Roughness(1e-3, 3e-3, _PILE),
    "hair": Roughness(1e-3, 3e-3, _PILE),
    "foliage": Roughness(3e-3, 20e-3, _PILE),
    "food": Roughness(1e-3, 5e-3, _PAPER),
    "asphalt_concrete": Roughness(0.6e-3, 5e-3, "mean profile depth of 0.5 to 1.2 mm of dense roads (ISO 13473-1)"),
    "very_dry_ground": Roughness(5e-3, 50e-3, "raked to rolled soil: 2.5 to 40 mm, F. Ulaby et al., Microwave Remote Sensing II (1982)"),
    "medium_dry_ground": Roughness(5e-3, 50e-3, "as very dry ground"),
    "wet_ground": Roughness(5e-3, 50e-3, "as very dry ground"),
}

# Finishes that a viewer can tell apart, from smooth to rough. Published rms heights of the same kind of surface differ by a factor of two
# or three. The heights of neighbouring finishes in this table therefore differ by a factor of about three. The depth of a grain is 4 to 6
# times the rms height.
FINISHES = {
    "polished": Finish(0.0, _FLOAT),
    "smooth": Finish(0.03e-3, f"{_PLANED}; {_MOULDED}; rolled sheet, Ra of 2 um at most (EN 10130)"),
    "fine": Finish(0.1e-3, _PLASTER),
    "sandy": Finish(0.3e-3, f"{_PAPER}; relief of coarse sand, grains of 0.63 to 2 mm (ISO 14688-1)"),
    "coarse": Finish(1e-3, f"{_PAPER}; relief of fine gravel, grains of 2 to 6.3 mm (ISO 14688-1)"),
    "loose": Finish(3e-3, _PILE),
}


def roughness_m(name: str) -> float:
    """Return the rms height of a class of surfaces in metres.

    Objects of the catalogue and scenes with material labels use these heights. A surface for which only a material name is given is smooth.

    Raises:
        MaterialError: the class does not exist.

    >>> roughness_m("metal")
    0.0001
    """
    return _class(name).height_m


def correlation_m(name: str) -> float:
    """Return the correlation length of the heights of a class of surfaces in metres, for the correlation function exp(-r^2/l^2).

    Raises:
        MaterialError: the class does not exist.

    >>> correlation_m("metal")
    0.02
    """
    return _class(name).correlation_m


def _class(name: str) -> Roughness:
    if name not in CLASSES:
        raise MaterialError(f"no roughness class {name!r}; choose from {', '.join(sorted(CLASSES))}")
    return CLASSES[name]


def ament(roughness_m: float, cos_incidence: np.ndarray, wavenumber: float | np.ndarray) -> np.ndarray:
    """Compute Ament's factor, by which roughness multiplies the coherent reflected field. The result has the shape of `cos_incidence`.

    >>> float(np.round(20 * np.log10(ament(0.05e-3, np.array(1.0), 2 * np.pi / 3.8934e-3)), 4))
    -0.1131
    """
    return np.exp(-2 * (wavenumber * roughness_m * np.asarray(cos_incidence)) ** 2)


def ament_transmitted(
    roughness_m: float, cos_incidence: np.ndarray, wavenumber: float | np.ndarray, permittivity: np.ndarray | complex
) -> np.ndarray:
    """Compute the factor by which one rough face of a medium multiplies the coherent transmitted field.

    The result has the shape of `cos_incidence`.
    A surface height h shifts the phase of a reflected wave by 2 h k_z, but the phase of a transmitted wave only by h (k_z' - k_z). Here k_z
    and k_z' are the wavenumbers along the normal outside and inside the medium. For transmission, Ament's factor therefore becomes
    exp(-(1/2) (sigma_h (k_z' - k_z))^2), which is a much smaller loss than for reflection.
    """
    cosine = np.asarray(cos_incidence, float)
    inside = np.real(np.sqrt(np.asarray(permittivity) + 0j - (1 - cosine**2)))
    return np.exp(-0.5 * (wavenumber * roughness_m * (inside - cosine)) ** 2)
