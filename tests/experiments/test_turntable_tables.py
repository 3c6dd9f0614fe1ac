"""Tests of the turntable tables on synthetic recordings with known results."""

from __future__ import annotations

import numpy as np
import pytest
from fake_campaign import FakeCampaign, config, draw_all, find, frame_of

from experiments.turntable import facet_ripple, turntable_material, turntable_shape, turntable_size
from radartwin.errors import ConfigError
from radartwin.features.envelope import harmonic_ratio
from radartwin.runs.experiment import Result


@pytest.fixture(scope="module")
def shape() -> Result:
    campaign = FakeCampaign(distances=(0.5, 1.0), repetitions=2, gap=0.05)
    return turntable_shape.score(config("turntable_shape"), frame_of(campaign), ripple=False)


def test_a_nearly_exact_twin_keeps_order_distances_and_signatures(shape: Result) -> None:
    for metric in ("order of objects", "distances between objects"):
        row = find(shape, metric=metric, case="all objects")
        assert row["value"] > 0.8
        assert row["verdict"] == "supported"
        assert row["p"] < 0.01
        assert row["items"] == 12
        assert row["n"] == 12 * 2 * (2 + 1)  # 12 objects times 2 distances times (2 measured + 1 simulated) repetitions
    assert find(shape, metric="own signature less others'", case="all objects")["verdict"] == "supported"
    assert find(shape, metric="signatures", case="all objects")["verdict"] == ""  # the paper states no limit for this value


def test_equal_objects_have_no_order() -> None:
    campaign = FakeCampaign(distances=(1.0,), repetitions=2, signature=0.0)
    result = turntable_shape.score(config("turntable_shape"), frame_of(campaign), ripple=False)
    assert find(result, metric="order of objects", case="all objects")["verdict"] == "undecided"
    assert find(result, metric="distances between objects", case="all objects")["verdict"] == "undecided"
    assert find(result, metric="own signature less others'", case="all objects")["verdict"] == "contradicted"
    assert not [row for row in result.rows if row["metric"] == "variation over distance"]  # the recordings have a single distance


def test_rows_have_interval_n_seed_and_keys_and_figures_are_drawn(shape: Result) -> None:
    for row in shape.rows:
        assert row["low"] <= row["value"] <= row["high"]
        assert row["seed"] == 0
        assert row["run_keys"]
    cans = [row for row in shape.rows if row["case"] == "drink can" and row["metric"] == "angular harmonic ratio"]
    assert {row["n"] for row in cans} == {4, 2}  # two distances, with and without repetitions
    assert draw_all(shape) == {"turntable_ranking", "turntable_ssim"}


def test_harmonic_ratios_follow_the_modulation_of_the_objects(shape: Result) -> None:
    """The synthetic recordings modulate cans by 0.05 and the corner reflector by 0.9. The modulation is the sum of six harmonics that
    differ between objects.
    """
    ratio = {row["case"]: row["value"] for row in shape.rows if row["metric"] == "angular harmonic ratio" and row["of"] == "simulated"}
    assert ratio["trihedral corner reflector"] > 10 * max(value for case, value in ratio.items() if "can" in case)
    assert find(shape, metric="ratio of harmonic ratios", case="peaked over cans", of="measured")["verdict"] == "supported"


def test_a_campaign_without_turntable_is_refused() -> None:
    with pytest.raises(ConfigError, match="no turntable recordings"):
        turntable_shape.score(config("turntable_shape"), frame_of(FakeCampaign(motions=("depth",))))


def test_flat_facets_ripple_at_their_number_and_curved_facets_do_not() -> None:
    flat, curved = (facet_ripple.envelope(facet_ripple.can(flat), None, 1) for flat in (True, False))
    assert len(flat) == 2048
    spectrum = np.abs(np.fft.rfft(flat))[1:200]
    assert int(spectrum.argmax()) + 1 == facet_ripple.FACETS
    # 64 tubes per square wavelength give a ratio of 106, and the default of one tube gives 73
    assert harmonic_ratio(flat, 120, 136) > 50 * harmonic_ratio(curved, 120, 136)


def test_brightness_follows_the_material_class() -> None:
    """In measurement and simulation, plastic returns 0.12 of the power of metal (-9.2 dB). Objects of one material
    differ by up to 1.5 dB.
    """
    campaign = FakeCampaign(distances=(0.5, 1.0), repetitions=2, gap=0.02)
    result = turntable_material.score(config("turntable_material"), frame_of(campaign))
    for distance in (0.5, 1.0):
        here = {
            (row["metric"], row["of"]): row for row in result.rows if row["distance_m"] == distance and row["case"] == "all of similar size"
        }
        for of in ("measured", "simulated"):
            assert here["metal less plastic (dB)", of]["value"] == pytest.approx(9.2, abs=2.5)
            assert here["metal less plastic (dB)", of]["verdict"] == "supported"
        # The gain of 3 dB between the domains does not change the contrast.
        assert here["excess of contrast (dB)", "simulated less measured"]["value"] == pytest.approx(0, abs=1.0)
        assert here["excess of contrast (dB)", "simulated less measured"]["verdict"] in ("undecided", "contradicted")
        mug = here["mug, relative to the cans (dB)", "simulated less measured"]
        assert (mug["verdict"], mug["items"], mug["low"]) == ("undecided", 1, None)
    reflector = [row for row in result.rows if "reflector" in row["case"]]
    assert not reflector
    assert result.metrics["metal_less_plastic_measured_1m_db"] > 0


def test_a_trend_with_height_is_distinguished_from_no_trend() -> None:
    heights, none = np.array([76.0, 83, 102, 122, 124, 157]), np.array([0.0, 1, -1, 0.5, -0.5, 0.2])
    flat, rising = (turntable_size.slope_db(heights, level, 500, 0) for level in (none, 6 * np.log2(heights) + 0.2 * none))
    assert flat.low < 0 < flat.high
    assert rising.value == pytest.approx(6, abs=1)
    assert rising.low > 3
    result = turntable_size.score(config("turntable_size"), frame_of(FakeCampaign(distances=(0.5, 1.0), repetitions=2)))
    claimed = [row for row in result.rows if row["claim"]]
    assert [(row["of"], row["distance_m"], row["metric"]) for row in claimed] == [("measured", None, "order by height")]
    assert claimed[0]["verdict"] == "undecided"  # six cans are too few
    assert turntable_size.NO_TREND.margin == 0.5
    assert {row["distance_m"] for row in result.rows} == {0.5, 1.0, None}
    with pytest.raises(ConfigError, match="three cans"):
        turntable_size.score(config("turntable_size"), frame_of(FakeCampaign(objects=("mug", "mustard"))))


def test_a_distance_with_the_reflector_alone_has_no_panel_and_no_row() -> None:
    campaign = FakeCampaign(
        distances=(0.5, 1.0, 2.0), repetitions=1, keep=lambda domain, case: case.distance_m == 1.0 or case.object == "corner_reflector"
    )
    for module, name in ((turntable_material, "turntable_material"), (turntable_size, "turntable_size")):
        result = module.score(config(name), frame_of(campaign))
        assert {row["distance_m"] for row in result.rows} <= {1.0, None}
        assert [len(draw().axes) for draw in result.figures.values()] == [1]
    shape = turntable_shape.score(config("turntable_shape"), frame_of(campaign), ripple=False)
    assert {row["case"] for row in shape.rows if row["metric"] == "variation over distance"} == {
        "reflector, 0.6-2.1 m", "reflector, all distances", "mean of objects",
    }  # fmt: skip
    with pytest.raises(ConfigError, match="two material classes"):
        turntable_material.score(config("turntable_material"), frame_of(FakeCampaign(objects=("mug",), distances=(1.0,))))
