"""Materials from 57 to 64 GHz: the fits of ITU-R P.2040-4 that cover this band, the substitutes that do not, and one line for refusals."""

import dataclasses

import numpy as np
import pytest

import radartwin as rt
from radartwin.builders.radar import named_radar
from radartwin.errors import MaterialError
from radartwin.materials import containers
from radartwin.materials.itu import P2040, STAND_INS, StandInWarning, permittivity
from radartwin.scene import objects

C = 299_792_458.0
BAND_HZ = np.linspace(57e9, 64e9, 15)
# Coefficients a, c and d of table 3 (b is 0) for the rows whose frequency range includes 57 to 64 GHz.
COVERED = {
    "concrete": (5.24, 0.0462, 0.7822), "plasterboard": (2.73, 0.0085, 0.9395), "wood": (1.99, 0.0047, 1.0718),
    "glass": (6.31, 0.0036, 1.3394), "ceiling_board": (1.48, 0.0011, 1.0750), "chipboard": (2.58, 0.0217, 0.7800),
    "floorboard": (3.66, 0.0044, 1.3515), "metal": (1.0, 1e7, 0.0),
}  # fmt: skip


def test_covered_materials_have_the_fits_of_the_recommendation():
    """The recommendation gives the imaginary part as 17.98 sigma / f with f in GHz, a constant that is rounded to four digits."""
    ghz = BAND_HZ / 1e9
    for name, (real, c, d) in COVERED.items():
        eta = permittivity(name, BAND_HZ)  # without the warning of a substitute, which would be an error
        np.testing.assert_allclose(np.real(eta), real, rtol=1e-12)
        np.testing.assert_allclose(-np.imag(eta), 17.98 * c * ghz**d / ghz, rtol=1e-3)


def test_every_other_material_names_its_substitute():
    """Marble is fitted to 60 GHz, so that it has its own fit below and a substitute above."""
    assert set(P2040) == set(COVERED) | set(STAND_INS)
    for name, stand_in in STAND_INS.items():
        with pytest.warns(StandInWarning, match=f"{name}.*{stand_in}"):
            eta = permittivity(name, BAND_HZ)
        np.testing.assert_array_equal(eta, permittivity(stand_in, BAND_HZ))
    assert complex(permittivity("marble", 58e9)).real == pytest.approx(7.074)


def test_substitutes_of_77_ghz_are_the_closest_at_62_ghz_too():
    """The original reflection at normal incidence is interpolated in log frequency between the fits beside 62 GHz, or taken from the end of
    the last fit below. The fits of moist ground end at 10 GHz, below the relaxation of water, so that these two have no such value.
    """

    def reflection(eta):
        return abs((1 - np.sqrt(eta)) / (1 + np.sqrt(eta)))

    there = {name: reflection(complex(permittivity(name, 62e9))) for name in COVERED}
    for name in sorted(set(STAND_INS) - {"medium_dry_ground", "wet_ground"}):
        ends = sorted({end for fit in P2040[name] for end in (fit.low_ghz, fit.high_ghz)})
        sides = [*[end for end in ends if end < 62][-1:], *[end for end in ends if end > 62][:1]]
        original = np.interp(np.log(62), np.log(sides), [reflection(complex(permittivity(name, end * 1e9))) for end in sides])
        apart_db = {row: 20 * abs(np.log10(value / original)) for row, value in there.items()}
        assert min(apart_db, key=lambda row: apart_db[row]) == STAND_INS[name], name
        assert apart_db[STAND_INS[name]] < 0.8


def test_contents_and_walls_of_containers_are_defined():
    for name in ("water", "ethanol", "oil", "pet", "hdpe", "mustard", "dressing", "skin"):
        eta = containers.permittivity(name, BAND_HZ)
        assert np.isfinite(eta).all()
        assert (np.imag(eta) < 0).all()


def test_water_at_60_ghz_has_the_tabulated_permittivity():
    """The double-Debye model of Liebe et al. (1991) at 20 C, evaluated by hand: eps0 = 77.66 - 103.3 t with t = 1 - 300/293.15,
    eps1 = 0.0671 eps0, eps2 = 3.52, gamma1 = 20.2 + 146.4 t + 316 t^2 and gamma2 = 39.8 gamma1, in GHz.
    """
    t = 1 - 300 / 293.15
    static, first = 77.66 - 103.3 * t, 20.20 + 146.4 * t + 316 * t**2
    middle, last, second = 0.0671 * static, 3.52, 39.8 * first
    by_hand = last + (static - middle) / (1 + 60j / first) + (middle - last) / (1 + 60j / second)
    assert abs(complex(containers.water(60e9)) - by_hand) < 0.05


def at(distance_m):
    pose = np.eye(4)
    pose[0, 3] = -distance_m
    return pose[None]


@pytest.mark.parametrize("material", ["metal", "floorboard"])
def test_wall_at_60_ghz_has_the_level_of_its_image(material):
    """A large wall at the distance R returns the amplitude lambda |Gamma| / (8 pi R) of the mirror image at 2 R. The edges of the wall of
    8 m x 8 m change single samples by up to 3 %; their mean power is within 0.15 dB.
    """
    radar = dataclasses.replace(named_radar("iwr6843"), num_chirps=1, tx_positions_m=((0.0, 0.0, 0.0),), rx_positions_m=((0.0, 0.0, 0.0),))
    recording = rt.simulate(rt.Scene([rt.Surface(objects.plate(8.0, 8.0), material, "wall")]), radar, at(2.0))
    ghz = radar.center_frequency_hz / 1e9
    real, c, d = COVERED[material]
    index = np.sqrt(real - 17.98j * c * ghz**d / ghz)
    expected = C / radar.center_frequency_hz * abs((1 - index) / (1 + index)) / (8 * np.pi * 2.0)
    assert material not in rt.MATERIAL_THICKNESS  # the name means a half-space
    assert 10 * np.log10((np.abs(recording.iq) ** 2).mean()) == pytest.approx(20 * np.log10(expected), abs=0.15)


def test_frequency_without_data_is_refused_in_one_line(inside, tmp_path):
    radar = dataclasses.replace(named_radar("iwr6843"), start_frequency_hz=24e9)
    with pytest.raises(MaterialError, match=r"floorboard.*50 to 100 GHz.*no substitute at 25.7") as caught:
        rt.simulate(rt.Scene([rt.Surface(objects.plate(1.0, 1.0), "floorboard", "board")]), radar, at(2.0))
    assert "\n" not in str(caught.value)
    rt.Scene([rt.Surface(objects.plate(1.0, 1.0), "floorboard", "board")]).save(tmp_path / "room")
    words = ("scene=scan", f"scene.path={tmp_path / 'room'}", "scene.target=none", "trajectory=static", "radar=iwr6843")
    done = inside("simulate", *words, "trajectory.position_m=[-2.0,0.0,0.0]", "radar.start_frequency_hz=24e9", "--out", tmp_path / "r")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "floorboard" in done.stderr
