"""The estimates of cells on a synthetic frame equal direct computations, over draws and twins, and unusable cells are refused."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd
import pytest
from fake_campaign import FakeCampaign, config, frame_of
from scipy.spatial.distance import pdist
from scipy.stats import rankdata

from experiments import cells, statistics
from experiments.campaign import frame as frames
from experiments.campaign.frame import Frame
from experiments.cells import Cell, difference, gap, mantel, mean, per, rank_correlation, using
from experiments.verdicts import Claim
from radartwin.errors import ConfigError, InputError

OBJECTS = {"a": "metal", "b": "metal", "c": "plastic", "d": "plastic"}


def synthetic() -> Frame:
    """Two draws of four objects at two distances; at 1 m with two measured repetitions. One twin has a name and half the levels."""
    rng, rows = np.random.default_rng(0), []
    for name, kind in OBJECTS.items():
        for distance in (1.0, 2.0):
            shared = {"object": name, "material_class": kind, "room": "lab", "motion": "turntable", "distance_m": distance}
            measured = [(draw, repetition) for draw in (0, 1) for repetition in range(2 if distance == 1 else 1)]
            for domain, twin, known in (("measured", "", measured), ("twin", "", [(0, 0)]), ("twin", "other", [(0, 0)])):
                for draw, repetition in known:
                    level, ratio = rng.uniform(1, 2, 2) * (0.5 if twin else 1)
                    row = {
                        "domain": domain,
                        "twin": twin,
                        "truth": "",
                        "draw": draw,
                        "repetition": repetition,
                        "level": level,
                        "ratio": ratio,
                    }
                    rows.append({**shared, **row, "key": f"{domain}{twin}{name}{distance}{draw}{repetition}"})
    return pd.DataFrame(rows)


def by_hand(frame: Frame, column: str, domain: str, draw: int = 0) -> np.ndarray:
    """Return the mean of each object over repetitions, then over distances."""
    of = [
        [frame[column][(frame.object == name) & (frame.distance_m == at) & (frame.domain == domain) & (frame.draw == draw)].mean()
         for at in (1.0, 2.0)]
        for name in OBJECTS
    ]  # fmt: skip
    return np.mean(of, axis=1)


def distances(frame: Frame, domain: str) -> np.ndarray:
    points = np.stack([by_hand(frame, column, domain) for column in ("level", "ratio")], axis=1)
    return pdist((points - points.mean(axis=0)) / points.std(axis=0))


def test_each_estimate_equals_a_direct_computation() -> None:
    frame = cells.first_draw(synthetic())
    measured, twin = (by_hand(frame, "level", domain) for domain in ("measured", "twin"))
    order = np.corrcoef(rankdata(measured), rankdata(twin))[0, 1]
    expected = [
        (mean("level"), frame.level.mean()),
        (mean(np.array([1.0, 5.0])), 3.0),
        (mean(per("level", "measured")), measured.mean()),
        (mean(gap("level", "twin", "measured")), (twin - measured).mean()),
        (difference(per("level", "measured"), "material_class", "metal", "plastic"), measured[:2].mean() - measured[2:].mean()),
        (rank_correlation(per("level", "measured"), per("level", "twin")), order),
        (using(statistics.coefficient_of_variation, per("level", "twin")), twin.std(ddof=1) / twin.mean()),
        (mantel(["level", "ratio"]), np.corrcoef(distances(frame, "measured"), distances(frame, "twin"))[0, 1]),
    ]
    for estimate, value in expected:
        computed = estimate(frame, 50, 0)
        assert computed.value == pytest.approx(value, abs=1e-12)
        assert computed.low <= computed.value <= computed.high


def test_rows_join_draws_and_show_a_named_twin_without_a_claim_where_it_differs() -> None:
    frame = synthetic()

    def table(part: Frame) -> Iterator[Cell]:
        for domain in ("measured", "twin"):
            yield Cell({"of": domain}, "level", part[part.domain == domain], mean(per("level")), Claim("high", "2", bound=0.1))

    measured, twin, other = cells.table_rows(config("turntable_shape"), frame, table)
    assert measured["value"] == pytest.approx(np.mean([by_hand(frame, "level", "measured", draw) for draw in (0, 1)]))
    assert (measured["draws"], measured["n"], measured["items"], measured["verdict"]) == (2, 24, 4, "supported")
    assert (twin["n"], twin.get("twin")) == (8, None)
    assert (other["twin"], other["claim"], other["paper"], other["n"]) == ("other", "", "2", 8)
    assert other["value"] < twin["value"]


def test_rows_of_another_truth_use_its_measurements_and_are_chosen() -> None:
    frame = synthetic()
    frame = frame[frame.twin == ""]
    exact = frame[(frame.domain == "measured") & (frame.draw == 0)].assign(truth="exact")
    exact["level"] *= 3

    def table(part: Frame) -> Iterator[Cell]:
        for domain in ("measured", "twin"):
            yield Cell({"of": domain}, "level", part[part.domain == domain], mean(per("level")), Claim("high", bound=0.1))

    both = pd.concat([frame, exact], ignore_index=True)
    measured, twin, other = cells.table_rows(config("turntable_shape"), both, table, lambda row: row["of"] == "measured")
    assert (measured["draws"], twin["verdict"]) == (2, "supported")
    assert (other["truth"], other["of"], other["claim"], other["draws"]) == ("exact", "measured", "", 1)
    assert other["value"] == pytest.approx(3 * by_hand(frame, "level", "measured").mean())


def test_a_cell_that_cannot_be_computed_is_refused() -> None:
    frame = synthetic()
    with pytest.raises(ConfigError, match=r"cell 'level' \(of nothing\) selects no recordings; add them"):
        cells.table_rows(config("turntable_shape"), frame, lambda part: [Cell({"of": "nothing"}, "level", part[:0], mean("level"))])
    with pytest.raises(ConfigError, match="reads 'entropy', which its recordings lack"):
        cells.table_rows(config("turntable_shape"), frame, lambda part: [Cell({"of": "all"}, "level", part, mean("entropy"))])


def test_recordings_of_less_than_a_revolution_are_refused_by_name() -> None:
    with pytest.raises(InputError, match="no whole revolution of more than 12 frames; record one"):
        frames.check_revolutions(synthetic())


def test_a_saved_frame_is_read_unchanged(tmp_path) -> None:
    frame = frame_of(FakeCampaign(repetitions=2, objects=("mug", "mustard")))
    frames.save(frame, tmp_path)
    with np.load(tmp_path / "arrays.npz") as stored:
        again = frames.load(dict(stored))
    pd.testing.assert_frame_equal(frame, again, check_like=True)
    assert list(zip(frame.domain, frame.object, strict=True))[::4] == [("measured", "mug"), ("measured", "mustard"), ("twin", "mug")]
