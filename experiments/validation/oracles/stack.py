"""Reflection of flat interfaces and stacks by 2x2 characteristic matrices, and permittivities from published formulas.

Refs: M. Born, E. Wolf, Principles of Optics, section 1.6 (matrices); ITU-R P.2040-4, table 3 (building materials, f in GHz); H. Liebe, G.
Hufford, T. Manabe, Int. J. Infrared and Millimeter Waves 12 (1991) 659 (water). Time convention exp(+j omega t), loss is eta' - j eta''.
In TE polarisation the electric field is along s = k x n, in TM polarisation along k x s. The reflection coefficients (te, tm) of a perfect
conductor are -1 and +1.
"""

from collections.abc import Sequence

import numpy as np

from experiments.validation.oracles.case import SPEED_OF_LIGHT

# eta' and the conductivity c f^d (S/m) of P.2040-4, where 77 GHz lies in the fitted range
BUILDING = {
    "concrete": (5.24, 0.0462, 0.7822),
    "plasterboard": (2.73, 0.0085, 0.9395),
    "wood": (1.99, 0.0047, 1.0718),
    "glass": (6.31, 0.0036, 1.3394),
    "metal": (1.0, 1e7, 0.0),
}


def permittivity(name: str, frequency_hz: float) -> complex:
    """Return the relative permittivity of a building material, water at 20 C or air; others come from RadarTwin's own tables."""
    ghz = frequency_hz / 1e9
    if name in BUILDING:
        real, c, d = BUILDING[name]
        return real - 17.98j * c * ghz**d / ghz  # 1/(2 pi eps_0) in GHz m/S
    if name == "water":
        inverse = 300.0 / 293.15
        static = 77.66 + 103.3 * (inverse - 1)
        high, top = 0.0671 * static, 3.52
        slow = 20.20 - 146.4 * (inverse - 1) + 316.0 * (inverse - 1) ** 2
        fast = 39.8 * slow
        return (static - high) / (1 + 1j * ghz / slow) + (high - top) / (1 + 1j * ghz / fast) + top
    if name == "air":
        return 1.0 + 0.0j
    from radartwin import materials

    return complex(materials.permittivity(name, frequency_hz))


def fresnel(permittivity_: complex, cosine: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
    """Return the reflection coefficients (te, tm) of a half-space with this relative permittivity, seen from air."""
    root = np.sqrt(permittivity_ - 1 + np.asarray(cosine) ** 2 + 0j)
    return (cosine - root) / (cosine + root), (permittivity_ * cosine - root) / (permittivity_ * cosine + root)


def stack(layers: Sequence[tuple[str, float]], backing: str, angle_rad: float, frequency_hz: float) -> tuple[complex, complex]:
    """Return the reflection (te, tm) of layers (material name, thickness in metres), outermost first, in front of a backing."""
    sine2 = np.sin(angle_rad) ** 2
    wavenumber = 2 * np.pi * frequency_hz / SPEED_OF_LIGHT
    out = []
    for parallel in (False, True):

        def admittance(eps: complex, parallel: bool = parallel) -> complex:
            root = np.sqrt(eps - sine2 + 0j)
            return complex(eps / root if parallel else root)

        total = np.eye(2, dtype=complex)
        for name, thickness in layers:
            eps = permittivity(name, frequency_hz)
            phase = wavenumber * np.sqrt(eps - sine2 + 0j) * thickness
            if phase.imag < -40:  # nothing returns through the layer, so it acts as a half-space
                back = admittance(eps)
                break
            y = admittance(eps)
            total = total @ np.array([[np.cos(phase), 1j * np.sin(phase) / y], [1j * y * np.sin(phase), np.cos(phase)]])
        else:
            back = admittance(permittivity(backing, frequency_hz))
        electric, magnetic = total @ np.array([1.0, back])
        outside = admittance(1.0)
        value = (outside * electric - magnetic) / (outside * electric + magnetic)
        out.append(complex(-value if parallel else value))
    return out[0], out[1]
