"""Compare reflection and transmission of materials with transfer matrices, published values and reference tables."""

import subprocess
import sys
import warnings

import numpy as np
import pytest
from panes import C, tangential

from radartwin.errors import MaterialError
from radartwin.materials import (
    MATERIAL_NAMES,
    MATERIAL_THICKNESS,
    Layered,
    check_name,
    common_sheet,
    containers,
    half_space,
    permittivity,
    reflection,
    roughness_m,
    transmission,
    varied,
)  # fmt: skip
from radartwin.materials.itu import P2040, STAND_INS, StandInWarning
from radartwin.materials.roughness import CLASSES, ament, ament_transmitted
from radartwin.simulation.reflection_table import DispersionWarning, build, lagrange_basis


@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 60.0, 80.0])
@pytest.mark.parametrize("stack", [[("plasterboard", 0.0125)], [("glass", 0.004), ("air", 0.016), ("glass", 0.004)], [("pet", 0.001)], []])
@pytest.mark.parametrize("backing", ["air", "water", "concrete"])
def test_layers_match_characteristic_matrices(stack, backing, angle_deg):
    f, cosine = 78e9, np.cos(np.radians(angle_deg))
    layers, behind = [(complex(permittivity(name, f)), depth) for name, depth in stack], complex(permittivity(backing, f))
    exact = np.array([tangential(layers, behind, cosine, f, parallel) for parallel in (False, True)])
    # the parallel component along k_r x s has the opposite sign of the tangential field
    assert reflection(Layered(stack, backing), cosine, np.array(f)) == pytest.approx(exact[:, 0] * [1, -1], abs=1e-9)
    if stack and backing == "air":
        assert transmission(Layered(stack), cosine, np.array(f)) == pytest.approx(exact[:, 1], rel=1e-8)


@pytest.mark.filterwarnings("ignore::radartwin.materials.itu.StandInWarning")
def test_plain_names_of_sheets_reflect_and_transmit_as_their_stated_thickness():
    """A name in MATERIAL_THICKNESS means a sheet in air, also with factors on the permittivity. A `Layered` stack has priority."""
    cosine, f = np.cos(np.radians([0.0, 50.0])), np.array(77e9)
    for name, thickness in MATERIAL_THICKNESS.items():
        sheet = Layered([(name, thickness)])
        assert np.array_equal(reflection(name, cosine, f), reflection(sheet, cosine, f)), name
        assert np.array_equal(transmission(name, cosine, f), transmission(sheet, cosine, f)), name
        assert np.abs(transmission(name, cosine, f)).min() > 1e-3, name
        assert not np.any(transmission(half_space(name), cosine, f)), name
    changed, plain = (transmission(name, cosine, f)[0] for name in (varied("glass", 1.0, 2.0), "glass"))
    assert (np.abs(changed) < np.abs(plain)).all()
    for name in set(MATERIAL_NAMES) - set(MATERIAL_THICKNESS) - set(containers.EMPTY):
        assert not np.any(transmission(name, cosine, f)), name


@pytest.mark.parametrize(
    ("name", "loss_db"),
    [("hdpe", 1.4), ("fabric", 1.5), ("cardboard", 2.0), ("ceiling_board", 5.0), ("plasterboard", 14.0), ("double glazing", 22.0),
     ("wood", 24.0), ("stud wall", 27.0)],
)  # fmt: skip
def test_sheets_have_the_published_two_way_loss(name, loss_db):
    """At normal incidence, the mean two-way loss of the common sheets over the sweep agrees with the reference list within 0.6 dB."""
    te, _ = transmission(common_sheet(name), np.array(1.0), np.linspace(77e9, 80.44e9, 64))
    assert -20 * np.log10((np.abs(te) ** 2).mean()) == pytest.approx(loss_db, abs=0.6)


def test_bottle_walls_match_published_levels():
    """Of walls of PET before air and before water, averaged over the chirp."""
    f = np.linspace(77e9, 80.44e9, 64)
    for thickness, backing, expected in ((1e-3, "air", -15.0), (1e-3, "water", -3.6), (5e-4, "air", -6.4), (5e-4, "water", -11.3)):
        te, _ = reflection(Layered([("pet", thickness)], backing), np.array(1.0), f)
        assert 10 * np.log10((np.abs(te) ** 2).mean()) == pytest.approx(expected, abs=0.1)


def gaussian_mean(phase):
    """Return the mean of the cosine of a phase that is proportional to a Gaussian height, `phase` at one standard deviation."""
    z = np.linspace(-9, 9, 20_001)
    return (np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi) * (z[1] - z[0]) * np.cos(phase * z)).sum()


def test_ament_factor_is_the_mean_over_gaussian_heights():
    k = 2 * np.pi * 77e9 / C
    assert gaussian_mean(2 * k * 0.4e-3 * 0.7) == pytest.approx(ament(0.4e-3, np.array(0.7), k), abs=1e-9)
    assert 20 * np.log10(ament(C / 77e9 / 8, np.array(1.0), k)) == pytest.approx(-10.7, abs=0.05)  # the Rayleigh criterion


@pytest.mark.parametrize("angle_deg", [0.0, 40.0, 70.0])
def test_rough_transmission_is_the_mean_over_gaussian_heights(angle_deg):
    """A height of the surface replaces a path in air by a path inside the material, refracted by Snell's law."""
    k, sigma, index = 2 * np.pi * 77e9 / C, 0.3e-3, 2.0
    outside = np.radians(angle_deg)
    inside = np.arcsin(np.sin(outside) / index)
    expected = gaussian_mean(k * sigma * (index * np.cos(inside) - np.cos(outside)))
    assert ament_transmitted(sigma, np.cos(outside), k, index**2) == pytest.approx(expected, abs=1e-9)
    smooth, rough = (transmission(Layered([("glass", 3e-3)]), np.cos(outside), np.array(77e9), height)[0] for height in (0.0, sigma))
    glass = permittivity("glass", np.array(77e9))
    # the slab has two rough faces
    assert abs(rough / smooth) == pytest.approx(float(ament_transmitted(sigma, np.cos(outside), k, glass)) ** 2)


def test_every_material_has_a_roughness_class_with_a_source():
    minc = "brick carpet ceramic fabric foliage food glass hair leather metal mirror painted paper plastic polishedstone skin stone"
    for name in (*minc.split(), "tile", "wallpaper", "water", "wood", *P2040):
        assert 0 <= roughness_m(name) <= 5e-3
        assert CLASSES[name].source
        assert CLASSES[name].correlation_m > CLASSES[name].height_m
    with pytest.raises(MaterialError, match="marzipan"):
        roughness_m("marzipan")


def test_tabulated_rows_are_those_of_the_recommendation():
    """Real part of the permittivity and conductivity at the ends of the frequency ranges of table 3."""
    for name, ghz, real, conductivity in (
        ("concrete", 1, 5.24, 0.0462), ("brick", 10, 3.91, 0.0344), ("glass", 77, 6.31, 1.211), ("plasterboard", 100, 2.73, 0.6433),
        ("wood", 10, 1.99, 0.0555), ("metal", 77, 1.0, 1e7), ("marble", 60, 7.074, 0.2439), ("floorboard", 77, 3.66, 1.560),
        ("wet_ground", 10, 11.94, 2.993), ("carpet_tile", 40, 2.08, 0.01853), ("asphalt_concrete", 40, 4.83, 1.868),
        ("clear_acrylic", 200, 2.58, 0.6345), ("plywood", 300, 1.94, 1.989), ("glass", 400, 6.5767, 8.008),
    ):  # fmt: skip
        eta = complex(permittivity(name, ghz * 1e9))
        assert eta.real == pytest.approx(real, rel=1e-3)
        assert -eta.imag * 2 * np.pi * ghz * 1e9 * 8.8541878e-12 == pytest.approx(conductivity, rel=2e-3), name


@pytest.mark.parametrize(("name", "stand_in"), sorted(STAND_INS.items()))
def test_material_outside_its_fit_warns_with_both_names(name, stand_in):
    for frequencies in (77e9, np.linspace(57e9, 64e9, 15)):
        with pytest.warns(StandInWarning, match=f"{name}.*{stand_in}"):
            values = permittivity(name, frequencies)
        np.testing.assert_array_equal(values, permittivity(stand_in, frequencies))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        permittivity(name, 9e9 if name != "clear_acrylic" else 200e9)


def test_stand_in_warns_once_per_process():
    """It appears once, whatever the calling line, the frequency and the warning filters are."""
    code = (
        "import warnings, numpy as np\n"
        "from radartwin.materials import reflection, permittivity\n"
        "for f in (77e9, 78e9):\n"
        "    reflection('brick', np.array(1.0), np.array(f))\n"
        "    with warnings.catch_warnings():\n"
        "        warnings.simplefilter('ignore', ResourceWarning)\n"
        "permittivity('brick', 79e9)\n"
        "permittivity('marble', 79e9)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stderr.count("'brick' is fitted") == 1
    assert done.stderr.count("'marble' is fitted") == 1


def test_frequency_outside_every_fit_is_refused_with_the_range():
    with pytest.raises(MaterialError, match=r"concrete.*1 to 100 GHz"):
        permittivity("concrete", 105e9)
    with pytest.raises(MaterialError, match=r"ceiling_board.*1 to 100 GHz"):
        permittivity("ceiling_board", np.array([99e9, 101e9]))


def test_metal_reflects_at_every_frequency():
    for frequency in (1e7, 3e8, 1.36e9, 1e12):
        te, tm = reflection("metal", np.array(0.5), np.array(frequency))
        assert abs(te + 1) < 0.01
        assert abs(tm - 1) < 0.01


def test_mixtures_lie_between_their_phases_and_match_hanai():
    water = complex(permittivity("water", 77e9))
    for name in containers.RECIPES:
        eta = complex(permittivity(name, 77e9))
        assert 2.4 < eta.real < water.real
        assert 0 < -eta.imag < -water.imag
    assert containers.looyenga([(1.0, np.array(water))]) == pytest.approx(water)
    # Hanai's law for drops in water in its differential form: add the oil in small steps, each a dilute suspension.
    oil, steps = complex(permittivity("oil", 77e9)), 2000
    mixed = water
    for step in range(steps):
        added = 0.25 / steps / (1 - 0.25 * step / steps)
        mixed += added * 3 * mixed * (oil - mixed) / (oil + 2 * mixed)
    near = complex(containers.looyenga([(0.75, np.array(water)), (0.25, np.array(oil))]))
    level = [abs((1 - np.sqrt(e)) / (1 + np.sqrt(e))) for e in (near, mixed)]
    assert 20 * np.log10(level[0] / level[1]) == pytest.approx(0, abs=0.25)
    with pytest.raises(MaterialError, match="ethanol"):
        permittivity("ethanol", 2e12)


@pytest.mark.parametrize("name", ["plasterbord", "plasterbord~1.0~1.0"])
def test_an_unknown_material_suggests_the_most_similar_name(name):
    with pytest.raises(MaterialError, match=r"plasterbord.*plasterboard"):
        Layered([(name, 0.01)])


def test_no_tabulated_surface_reflects_more_than_all_power():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        table = build([(name, 0.0) for name in MATERIAL_NAMES], 77e9, 80.44e9)
    assert (np.abs(table.te) <= 1 + 1e-9).all()
    assert (np.abs(table.tm) <= 1 + 1e-9).all()


def cavity(depth_m):
    return Layered([("plasterboard", 0.0125), ("air", depth_m), ("plasterboard", 0.0125)])


@pytest.mark.parametrize("depth_m", [0.075, 0.3])
def test_tables_interpolate_the_cavity_of_a_stud_wall_over_sweep_and_angle(depth_m):
    wall = cavity(depth_m)
    table = build([(wall, 0.0)], 77e9, 80.44e9)
    f, cosines = np.linspace(77e9, 80.44e9, 211), np.linspace(0.07, 1, 977)
    basis = lagrange_basis(table.frequencies_hz, f)
    place = cosines * (table.te.shape[1] - 1)
    low = np.minimum(place.astype(int), table.te.shape[1] - 2)
    share = (place - low)[:, None]
    for values, truth in zip((table.te[0], table.tm[0]), reflection(wall, cosines[:, None], f), strict=True):
        assert np.abs((values[low] * (1 - share) + values[low + 1] * share) @ basis - truth).max() < 3e-3


def test_surfaces_without_delayed_echoes_need_a_small_table():
    table = build([("concrete", 0.0), ("metal", 0.0)], 77e9, 80.44e9)
    assert table.te.shape == (2, 1024, 1)


def test_cavity_that_no_table_can_hold_warns_with_surface_error_and_remedy():
    with pytest.warns(DispersionWarning, match=r"surface 'far wall'.*wrong by up to 0\.\d+ .*tolerance of 0\.003.*use thinner layers"):
        build([("metal", 0.0), (cavity(1.0), 0.0)], 77e9, 80.44e9, names=["door", "far wall"])


def test_factors_multiply_permittivity_and_loss():
    plain, off = permittivity("glass", 77e9), permittivity(varied("glass", 1.1, 0.5), 77e9)
    assert off.real == pytest.approx(1.1 * plain.real)
    assert off.imag == pytest.approx(0.5 * plain.imag)
    assert permittivity("glass~1.0000~1.0000", 77e9) == plain
    assert varied(varied("glass", 1.1, 0.5), 1 / 1.1, 2.0) == "glass~1.0000~1.0000"


@pytest.mark.parametrize("name", ["glass~1", "glass~a~1", "glass~0~1", "glass~1~-1"])
def test_invalid_factors_are_refused(name):
    with pytest.raises(MaterialError, match="two factors"):
        check_name(name)
