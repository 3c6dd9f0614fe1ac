"""Materials from 57 to 64 GHz: the fits of ITU-R P.2040-4 that cover this band, the substitutes that do not, and one line for refusals."""

import dataclasses

import numpy as np
import panes
import pytest
from posing import placed

import radartwin as rt
from experiments.validation.oracles import stack
from radartwin.builders.radar import named_radar
from radartwin.errors import MaterialError
from radartwin.materials import containers
from radartwin.materials.itu import P2040, STAND_INS, permittivity
from radartwin.scene import objects

BAND_HZ = np.linspace(57e9, 64e9, 15)


def test_covered_materials_have_the_fits_of_the_recommendation():
    """No material warns of a substitute, which would be an error."""
    for name in panes.FITS:
        found, expected = permittivity(name, BAND_HZ), panes.permittivity(name, BAND_HZ)
        np.testing.assert_allclose(np.real(found), np.real(expected), rtol=1e-12)
        np.testing.assert_allclose(np.imag(found), np.imag(expected), rtol=1e-3)


def test_every_other_material_has_a_substitute():
    """Marble is fitted to 60 GHz, so that it has its own fit below and a substitute above."""
    assert set(P2040) == set(panes.FITS) | set(STAND_INS)
    assert complex(permittivity("marble", 58e9)).real == pytest.approx(7.074)


def test_substitutes_of_77_ghz_are_the_closest_at_62_ghz_too():
    """The original reflection at normal incidence is interpolated in log frequency between the fits beside 62 GHz, or taken from the end of
    the last fit below. The fits of moist ground end at 10 GHz, below the relaxation of water, so that these two have no such value.
    """

    def reflection(eta):
        return abs((1 - np.sqrt(eta)) / (1 + np.sqrt(eta)))

    there = {name: reflection(complex(permittivity(name, 62e9))) for name in panes.FITS}
    for name in sorted(set(STAND_INS) - {"medium_dry_ground", "wet_ground"}):
        ends = sorted({end for fit in P2040[name] for end in (fit.low_ghz, fit.high_ghz)})
        sides = [*[end for end in ends if end < 62][-1:], *[end for end in ends if end > 62][:1]]
        original = np.interp(np.log(62), np.log(sides), [reflection(complex(permittivity(name, end * 1e9))) for end in sides])
        apart_db = {row: 20 * abs(np.log10(value / original)) for row, value in there.items()}
        assert min(apart_db, key=lambda row: apart_db[row]) == STAND_INS[name], name
        assert apart_db[STAND_INS[name]] < 0.8


def test_water_at_60_ghz_has_the_permittivity_of_the_double_debye_model():
    assert abs(complex(containers.water(60e9)) - stack.permittivity("water", 60e9)) < 0.05


@pytest.mark.parametrize("material", ["metal", "floorboard"])
def test_wall_at_60_ghz_has_the_level_of_its_image(material):
    """A large wall at the distance R returns the amplitude lambda |Gamma| / (8 pi R) of the mirror image at 2 R. The edges of the wall of
    8 m x 8 m change single samples by up to 3 %; their mean power is within 0.15 dB.
    """
    radar = dataclasses.replace(named_radar("iwr6843"), num_chirps=1, tx_positions_m=((0.0, 0.0, 0.0),), rx_positions_m=((0.0, 0.0, 0.0),))
    recording = rt.simulate(rt.Scene([rt.Surface(objects.plate(8.0, 8.0), material, "wall")]), radar, placed([(-2.0, 0, 0)]))
    index = np.sqrt(panes.permittivity(material, radar.center_frequency_hz))
    expected = panes.C / radar.center_frequency_hz * abs((1 - index) / (1 + index)) / (8 * np.pi * 2.0)
    assert material not in rt.MATERIAL_THICKNESS  # the name means a half-space
    assert 10 * np.log10((np.abs(recording.iq) ** 2).mean()) == pytest.approx(20 * np.log10(expected), abs=0.15)


def test_frequency_without_data_is_refused_in_one_line(inside, tmp_path):
    radar = dataclasses.replace(named_radar("iwr6843"), start_frequency_hz=24e9)
    with pytest.raises(MaterialError, match=r"floorboard.*50 to 100 GHz.*no substitute at 25.7") as caught:
        rt.simulate(rt.Scene([rt.Surface(objects.plate(1.0, 1.0), "floorboard", "board")]), radar, placed([(-2.0, 0, 0)]))
    assert "\n" not in str(caught.value)
    rt.Scene([rt.Surface(objects.plate(1.0, 1.0), "floorboard", "board")]).save(tmp_path / "room")
    words = ("scene=scan", f"scene.path={tmp_path / 'room'}", "scene.target=none", "trajectory=static", "radar=iwr6843")
    done = inside("simulate", *words, "trajectory.position_m=[-2.0,0.0,0.0]", "radar.start_frequency_hz=24e9", "--out", tmp_path / "r")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "floorboard" in done.stderr
