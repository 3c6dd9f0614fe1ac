"""Tests of the turntable tables on synthetic recordings with known results."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest
from fake_campaign import FakeCampaign, config, draw_all, find, frame_of

from experiments.campaign.cases import RAIL, ROVER
from experiments.campaign.frame import Frame
from experiments.rover import rover_fidelity
from experiments.turntable import facet_ripple, linear_rail, turntable_material, turntable_shape, turntable_size
from radartwin.errors import ConfigError
from radartwin.features.envelope import harmonic_ratio
from radartwin.runs.experiment import Result


@pytest.fixture(scope="module")
def frame() -> Frame:
    return frame_of(FakeCampaign(distances=(0.5, 1.0), repetitions=2, gap=0.02))


def shape_of(frame: Frame) -> Result:
    return turntable_shape.score(config("turntable_shape"), frame)


def test_a_nearly_exact_twin_keeps_order_distances_and_signatures(frame: Frame) -> None:
    """The synthetic recordings modulate cans by 0.05 and the corner reflector by 0.9, with six harmonics that differ between objects."""
    shape = shape_of(frame)
    for metric in ("order of objects", "distances between objects"):
        row = find(shape, metric=metric, case="all objects")
        assert row["value"] > 0.8
        assert row["p"] < 0.01
        # n: 12 objects times 2 distances times (2 measured + 1 simulated) repetitions
        assert (row["verdict"], row["items"], row["n"]) == ("supported", 12, 12 * 2 * (2 + 1))
    assert find(shape, metric="own signature less others'", case="all objects")["verdict"] == "supported"
    assert find(shape, metric="signatures", case="all objects")["verdict"] == ""  # the paper states no limit for this value
    ratios = {row["case"]: row for row in shape.rows if row["metric"] == "angular harmonic ratio" and row["of"] == "simulated"}
    assert ratios["trihedral corner reflector"]["value"] > 10 * max(row["value"] for case, row in ratios.items() if "can" in case)
    assert find(shape, metric="ratio of harmonic ratios", case="peaked over cans", of="measured")["verdict"] == "supported"
    for row in shape.rows:
        assert row["low"] <= row["value"] <= row["high"]
        assert row["seed"] == 0
        assert row["run_keys"]
    assert draw_all(shape) == {"turntable_ranking", "turntable_ssim"}


def test_equal_objects_have_no_order() -> None:
    shape = shape_of(frame_of(FakeCampaign(distances=(1.0,), repetitions=2, signature=0.0)))
    for metric, verdict in (
        ("order of objects", "undecided"), ("distances between objects", "undecided"), ("own signature less others'", "contradicted"),
    ):  # fmt: skip
        assert find(shape, metric=metric, case="all objects")["verdict"] == verdict
    assert not [row for row in shape.rows if row["metric"] == "variation over distance"]  # the recordings have a single distance


def test_flat_facets_ripple_at_their_number_and_curved_facets_do_not() -> None:
    flat, curved = (facet_ripple.envelope(facet_ripple.can(flat), None, 1) for flat in (True, False))
    spectrum = np.abs(np.fft.rfft(flat))[1:200]
    assert int(spectrum.argmax()) + 1 == facet_ripple.FACETS
    # 64 tubes per square wavelength give a ratio of 106, and the default of one tube gives 73
    assert harmonic_ratio(flat, 120, 136) > 50 * harmonic_ratio(curved, 120, 136)


def test_a_ratio_of_ripples_is_judged_by_the_logarithms_of_its_seeds() -> None:
    """Of ratios 10, 100 and 1000, the mean logarithm is 2 with a standard error of 0.577, times 4.303 by Student's t."""
    estimate = facet_ripple.ratio([10.0, 100.0, 1000.0], [1.0, 1.0, 1.0])
    assert (estimate.value, estimate.low, estimate.high) == pytest.approx((100.0, 10 ** (2 - 2.484), 10 ** (2 + 2.484)), rel=2e-3)
    assert (estimate.p(1.0) < 0.05) == (estimate.low > 1.0)


def test_brightness_follows_the_material_class(frame: Frame) -> None:
    """Plastic returns 0.12 of the power of metal (-9.2 dB). Objects of one material differ by up to 1.5 dB."""
    result = turntable_material.score(config("turntable_material"), frame)
    for distance in (0.5, 1.0):
        rows = [row for row in result.rows if row["distance_m"] == distance and row["case"] == "all of similar size"]
        here = {(row["metric"], row["of"]): row for row in rows}
        for of in ("measured", "simulated"):
            assert here["metal less plastic (dB)", of]["value"] == pytest.approx(9.2, abs=2.5)
            assert here["metal less plastic (dB)", of]["verdict"] == "supported"
        excess = here["excess of contrast (dB)", "simulated less measured"]  # which the gain of 3 dB between the domains does not change
        assert excess["value"] == pytest.approx(0, abs=1.0)
        assert excess["verdict"] in ("undecided", "contradicted")
        mug = here["mug, relative to the cans (dB)", "simulated less measured"]
        assert (mug["verdict"], mug["items"], mug["low"]) == ("undecided", 1, None)
    assert not [row for row in result.rows if "reflector" in row["case"]]
    assert result.metrics["metal_less_plastic_measured_1m_db"] > 0


def test_a_trend_with_height_is_distinguished_from_no_trend(frame: Frame) -> None:
    heights, none = np.array([76.0, 83, 102, 122, 124, 157]), np.array([0.0, 1, -1, 0.5, -0.5, 0.2])
    flat, rising = (turntable_size.slope_db(heights, level, 500, 0) for level in (none, 6 * np.log2(heights) + 0.2 * none))
    assert flat.low < 0 < flat.high
    assert rising.value == pytest.approx(6, abs=1)
    assert rising.low > 3
    rows = turntable_size.score(config("turntable_size"), frame).rows
    (claimed,) = [row for row in rows if row["claim"]]
    assert (claimed["of"], claimed["distance_m"], claimed["metric"]) == ("measured", None, "order by height")
    assert claimed["verdict"] == "undecided"  # six cans are too few
    assert {row["distance_m"] for row in rows} == {0.5, 1.0, None}


def test_a_distance_with_the_reflector_alone_has_no_panel_and_no_row() -> None:
    frame = frame_of(FakeCampaign(
        distances=(0.5, 1.0, 2.0), repetitions=1, keep=lambda domain, case: case.distance_m == 1.0 or case.object == "corner_reflector"
    ))  # fmt: skip
    for module in (turntable_material, turntable_size):
        result = module.score(config(module.TABLE.name), frame)
        assert {row["distance_m"] for row in result.rows} <= {1.0, None}
        assert [len(draw().axes) for draw in result.figures.values()] == [1]
    assert {row["case"] for row in shape_of(frame).rows if row["metric"] == "variation over distance"} == {
        "reflector, 0.6-2.1 m", "reflector, all distances", "mean of objects",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("module", "motions", "given", "lacking"),
    [
        (turntable_shape, (), {"motions": ("depth",)}, "no turntable recordings"),
        (linear_rail, RAIL, {"motions": ("turntable",)}, "no radial or diagonal recordings"),
        (rover_fidelity, ROVER, {"motions": ("turntable",)}, "no depth or lateral recordings"),
        (turntable_size, (), {"objects": ("mug", "mustard")}, "three cans"),
        (turntable_material, (), {"objects": ("mug",)}, "two material classes"),
    ],
)
def test_a_campaign_without_the_recordings_of_a_table_is_refused(module: ModuleType, motions: tuple, given: dict, lacking: str) -> None:
    with pytest.raises(ConfigError, match=lacking):
        module.score(config(module.TABLE.name), frame_of(FakeCampaign(distances=(1.0,), **given), *motions))
