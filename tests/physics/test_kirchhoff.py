"""Compare the lobe of Kirchhoff scattering with energy balances and with the scattering integral."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import j0

from radartwin.materials import Layered, reflection
from radartwin.materials.scatter_lobe import ANGLES, backscatter_lobe, cross_section, lobe_width, scattered_lobe
from radartwin.simulation import diffuse

FREQUENCY_HZ = 77e9
K = 2 * np.pi * FREQUENCY_HZ / 299_792_458.0


def half_space(steps: int = 400):
    """Return directions (N, 3) and solid angles (N,) of the half-space z > 0, by the midpoint rule in polar angle and azimuth."""
    polar = np.pi / 2 * (np.arange(steps) + 0.5) / steps
    azimuth = 2 * np.pi * (np.arange(steps) + 0.5) / steps
    polar, azimuth = (a.ravel() for a in np.meshgrid(polar, azimuth, indexing="ij"))
    away = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1)
    return away, np.sin(polar) * np.pi**2 / steps**2


def back(angle_deg: float) -> np.ndarray:
    return np.array([-np.sin(np.radians(angle_deg)), 0.0, np.cos(np.radians(angle_deg))])


def scattering_integral(height: float, length: float, angle_deg: float) -> float:
    """Return the monostatic cross-section of a rough conductor per area from the integral over the correlation function, by quadrature."""
    cosine, sine = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    g = (2 * K * height * cosine) ** 2

    def integrand(r: float) -> float:
        return (np.exp(-g * (1 - np.exp(-((r / length) ** 2)))) - np.exp(-g)) * j0(2 * K * sine * r) * 2 * np.pi * r

    reach = length * np.sqrt(np.log(max(g, 1.0)) + 40)
    return K**2 / (np.pi * cosine**2) * quad(integrand, 0, reach, limit=1000, epsabs=1e-18, epsrel=1e-9)[0]


def removed(height: float, angle_deg: float) -> float:
    return 1 - np.exp(-4 * (K * height * np.cos(np.radians(angle_deg))) ** 2)


@pytest.mark.parametrize("angle_deg", [0.0, 60.0])
@pytest.mark.parametrize(("height", "length"), [(0.05e-3, 20e-3), (0.4e-3, 20e-3), (0.05e-3, 2e-3), (2e-3, 5e-3), (5e-3, 50e-3)])
def test_removed_power_reappears_in_the_half_space(height, length, angle_deg):
    """The lobe has a unit integral for every roughness, and Kirchhoff's own pattern holds the power that long waves of metal remove."""
    away, solid = half_space()
    cosine = np.cos(np.radians(angle_deg))
    assert (scattered_lobe(height, length, K, cosine, away) * solid).sum() == pytest.approx(1.0, rel=0.01)
    if length == 20e-3:
        power = (cross_section(height, length, K, cosine, away) * solid).sum() / (4 * np.pi * cosine)
        assert power == pytest.approx(removed(height, angle_deg), rel=0.01)


@pytest.mark.parametrize(
    ("material", "angle_deg"), [("metal", 0.0), ("metal", 60.0), ("concrete", 0.0), (Layered([("plasterboard", 0.0125)]), 0.0)]
)
def test_half_space_gets_the_fresnel_power_of_layered_faces(material, angle_deg):
    """A dielectric meets this at normal incidence only, because facets that scatter back reflect as at normal incidence."""
    height, length, frequency = 0.3e-3, 5e-3, np.linspace(77e9, 80e9, 5)
    away, solid = half_space()
    cosine = np.array([np.cos(np.radians(angle_deg))])
    lobe = scattered_lobe(height, length, K, float(cosine[0]), away)
    share = diffuse.scattered_share(material, height, cosine, frequency)
    smooth, rough = (np.abs(np.stack(reflection(material, cosine, frequency, s))) ** 2 for s in (0.0, height))
    assert share * (lobe * solid).sum() + rough.mean(axis=1)[:, None] == pytest.approx(smooth.mean(axis=1)[:, None], rel=0.01)


@pytest.mark.parametrize("height", [0.05e-3, 0.3e-3, 0.6e-3])
@pytest.mark.parametrize("length", [2e-3, 5e-3])
def test_backscatter_follows_the_scattering_integral(height, length):
    """The table differs most at the step that restores the energy, at the shortest length and the largest height."""
    table = backscatter_lobe(height, length, K)
    for angle_deg in (0.0, 10.0, 20.0, 30.0):
        expected = scattering_integral(height, length, angle_deg)
        if expected < 1e-6:  # 60 dB below a Lambert lobe; the quadrature cancels there
            continue
        cosine = np.cos(np.radians(angle_deg))
        assert float(cross_section(height, length, K, cosine, back(angle_deg))) == pytest.approx(expected, rel=1e-6)
        lobe = float(np.interp(angle_deg, np.linspace(0, 90, ANGLES), table))
        found = 4 * np.pi * cosine * removed(height, angle_deg) * lobe
        assert abs(10 * np.log10(found / expected)) < 1.0


def test_very_rough_surfaces_reach_the_limit_of_geometrical_optics():
    """At g = 260 the sum is finite and follows the distribution of slopes: sigma_0 = exp(-tan^2 t/(2 m^2))/(2 m^2 cos^4 t), with the rms
    slope m = sqrt(2) sigma_h/l.
    """
    height, length = 5e-3, 50e-3
    slope2 = 2 * (height / length) ** 2
    for angle_deg in (0.0, 10.0, 20.0):
        cosine, tangent = np.cos(np.radians(angle_deg)), np.tan(np.radians(angle_deg))
        expected = np.exp(-(tangent**2) / (2 * slope2)) / (2 * slope2 * cosine**4)
        assert float(cross_section(height, length, K, cosine, back(angle_deg))) == pytest.approx(expected, rel=0.03)
    assert lobe_width(height, length, K) == pytest.approx(2 * height / length, rel=1e-3)
    huge = cross_section(0.1, 1.0, K, 1.0, back(0.0))
    assert float(huge) == pytest.approx(1 / (4 * 0.1**2), rel=0.01)


def test_vanishing_roughness_scatters_its_share():
    """The lobe of a nearly smooth surface is the lobe of the first-order term."""
    assert backscatter_lobe(1e-7, 3e-3, K)[:300] == pytest.approx(backscatter_lobe(1e-5, 3e-3, K)[:300], rel=2e-3)
