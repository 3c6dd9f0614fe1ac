"""Compare three parts of the material table with closed forms: the MINC categories, the electromagnetic distance, and the conversion of
other material names.
"""

from __future__ import annotations

import numpy as np
import pytest

from radartwin.errors import MaterialError
from radartwin.materials import MATERIAL_NAMES, Layered, distance, half_space, itu, permittivity
from radartwin.materials.distance import FLOOR_DB, INCIDENCE_DEG, distance_db, reflectivity_db
from radartwin.materials.minc import CATEGORIES, COVERED, MINC, names_in, row
from radartwin.materials.names import PERMITTIVITY, SYNONYMS, known_names, mentioned, resolve

# The table contains rows whose fit ends below 77 GHz; the warning of their substitute material is tested elsewhere.
pytestmark = pytest.mark.filterwarnings("ignore::radartwin.materials.itu.StandInWarning")


def fresnel_db(permittivity_there: complex, incidence_deg: np.ndarray) -> np.ndarray:
    """Return the reflectivity of a half-space for unpolarised waves in decibels (Born and Wolf, section 1.5.2)."""
    n = np.sqrt(permittivity_there)
    inside = np.arcsin(np.sin(np.radians(incidence_deg)) / n + 0j)
    outside = np.radians(incidence_deg)
    te = (np.cos(outside) - n * np.cos(inside)) / (np.cos(outside) + n * np.cos(inside))
    tm = (n * np.cos(outside) - np.cos(inside)) / (n * np.cos(outside) + np.cos(inside))
    return 10 * np.log10((abs(te) ** 2 + abs(tm) ** 2) / 2)


def test_table_has_the_23_categories_each_with_material_roughness_and_source() -> None:
    assert len(CATEGORIES) == 23
    for category, entry in MINC.items():
        assert set(names_in(entry.material)) <= set(MATERIAL_NAMES), category
        assert entry.source, category
        assert 0 <= entry.roughness_m <= 3e-3, "the paper's range"
        assert np.isfinite(reflectivity_db(entry.material)).all(), f"{category} has no values over the sweep"


def test_substitutes_and_uncertain_build_ups_are_flagged() -> None:
    assert row("brick").stand_in(), "brick's fit ends at 40 GHz"
    assert not row("wood").stand_in()
    assert row("ceramic").stand_in(), "glass for porcelain"
    assert row("plastic").stand_in()
    assert not row("plastic").stand_in(exact=True), "only its thickness is uncertain"
    # For an uncertain category, another common layer structure has a reflectivity that differs from the table row by more than 2.5 dB.
    assert {name for name, entry in MINC.items() if entry.uncertain} == {*COVERED, "plastic"}
    for category, other in (("painted", "concrete"), ("wallpaper", "concrete"), ("plastic", Layered([("hdpe", 0.004)]))):
        assert distance_db(MINC[category].material, other) > 2.5, category


@pytest.mark.parametrize(
    ("words", "material"),
    [
        ("white acoustic ceiling tiles", "ceiling_board"), ("Mineral-fibre board, ceiling board", "ceiling_board"),
        ("painted concrete", "concrete"), ("lacquered sheet steel", "metal"), ("melamine-faced chipboard", "chipboard"),
        ("an unknown substance", None), ("", None),
    ],
)  # fmt: skip
def test_free_text_gives_the_most_specific_material_it_mentions(words: str, material: str | None) -> None:
    meaning = mentioned(words)
    assert (meaning and meaning.material) == material


def test_other_is_the_row_with_the_least_mean_distance() -> None:
    rows = [name for name, fits in itu.P2040.items() if any(fit.low_ghz <= 77 <= fit.high_ghz for fit in fits)]
    room = [category for category in CATEGORIES if category not in ("foliage", "food", "hair", "other", "skin", "sky", "water")]
    mean_db = {name: np.mean([distance_db(half_space(name), MINC[category].material) for category in room]) for name in rows}
    assert MINC["other"].material == min(rows, key=lambda name: mean_db[name])
    assert mean_db["concrete"] == pytest.approx(2.46, abs=0.05)
    assert len(room) == 16


def test_distance_is_the_textbook_difference_for_half_spaces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(distance, "SWEEP_HZ", np.array([77e9]))
    for first, second in (("glass", "wood"), ("concrete", "metal"), ("plasterboard", "water")):
        levels = [fresnel_db(complex(permittivity(name, 77e9)), INCIDENCE_DEG) for name in (first, second)]
        expected = pytest.approx(np.mean(np.abs(levels[0] - levels[1])), abs=1e-9)
        assert distance_db(half_space(first), half_space(second)) == expected
        assert distance_db(half_space(second), half_space(first)) == expected


def test_air_is_at_the_floor_and_thick_layers_equal_their_half_space() -> None:
    assert (reflectivity_db("air") == FLOOR_DB).all()
    assert distance_db(Layered([("wood", 0.5)]), half_space("wood")) < 0.01, "half a metre of wood is opaque"
    assert distance_db(Layered([("metal", 0.001)]), "metal") < 1e-6


@pytest.mark.parametrize(
    ("name", "material"),
    [
        ("porcelain", "glass"), ("drywall", MINC["painted"].material), ("granite", "concrete"), ("Stainless steel", "metal"),
        ("MDF", "chipboard"), ("foam", "air"), ("wood", MINC["wood"].material), ("ceiling_board", "ceiling_board"),
    ],
)  # fmt: skip
def test_names_resolve_to_their_row_or_the_closest_row(name: str, material: str | Layered) -> None:
    assert resolve(name).material == material


def test_every_declared_permittivity_resolves_to_the_row_of_closest_reflectivity() -> None:
    candidates = [n for n in itu.P2040 if any(f.low_ghz <= 77 and f.high_ghz >= 80.44 for f in itu.P2040[n])]
    for name, (real, loss) in PERMITTIVITY.items():
        substitute = resolve(name)
        assert substitute.stand_in
        wanted = fresnel_db(real * (1 - 1j * loss), INCIDENCE_DEG)
        errors = {c: np.mean(np.abs(fresnel_db(complex(permittivity(c, 78.7e9)), INCIDENCE_DEG) - wanted)) for c in candidates}
        if substitute.material == "air":
            assert min(errors.values()) > 10, name
        else:
            assert errors[str(substitute.material)] == pytest.approx(min(errors.values()), abs=0.02), name


def test_an_unknown_name_is_refused_with_the_known_names() -> None:
    with pytest.raises(MaterialError, match="unknown material 'unobtainium'") as caught:
        resolve("unobtainium")
    for name in ("metal", "porcelain", "drywall", "pet"):
        assert name in str(caught.value)
    with pytest.raises(MaterialError, match="not a MINC category"):
        row("porcelain")


def test_every_known_name_resolves_and_no_word_has_two_meanings() -> None:
    words = [word for line in SYNONYMS.values() for word in line.split()]
    assert len(words) == len(set(words))
    assert not set(words) & ({*CATEGORIES, *PERMITTIVITY, *MATERIAL_NAMES})
    for name in known_names():
        resolve(name)
