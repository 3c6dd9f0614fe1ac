"""The table of the resolution of two targets: Sparrow's limit for Bartlett, the order of the methods, and the rows."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import root_scalar

from experiments import statistics
from experiments.angles import angle_resolution
from experiments.angles.angle_resolution import ERROR, HALF, PROBABILITY, half_resolved, resolved
from radartwin.config.compose import compose
from radartwin.io.progress import Progress
from radartwin.runs.experiment import check_rows
from radartwin.store.products import Store

CONFIG = compose(["experiment=angle_resolution", "profile.resamples=200"])


def test_bartlett_resolves_from_sparrows_limit_on() -> None:
    """The sum of two patterns (sin x / x)^2 has a minimum in the middle if their distance exceeds twice the inflection of a pattern."""

    def second_derivative(x: float) -> float:
        step = 1e-4
        low, middle, high = ((np.sin(at) / at) ** 2 for at in (x - step, x, x + step))
        return (low - 2 * middle + high) / step**2

    limit = 2 * root_scalar(second_derivative, bracket=(0.5, 2.0)).root / np.pi  # x = pi d (M / lambda) sin(azimuth), 0.83 Rayleigh widths
    assert limit == pytest.approx(0.83, abs=0.01)
    # At 20 dB and 16 snapshots, the random correlation of the targets of 1/4 moves the limit by about a tenth in either direction.
    shares = [resolved(8, 20.0, factor * limit, 100, 0)["bartlett"] / 100 for factor in (0.8, 1.25)]
    assert shares[0] < 0.15
    assert shares[1] > 0.85


def test_half_resolved_separation_is_interpolated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(angle_resolution, "SEPARATIONS", (0.2, 0.4, 0.6))
    separation = half_resolved([statistics.share(count, 100) for count in (0, 25, 75)], CONFIG)
    assert separation.value == pytest.approx(0.5)
    # The slope is 2.5 per Rayleigh width and the binomial deviation at one half, from two points, 0.04 / sqrt(2): 0.012.
    assert 0.46 < separation.low < 0.49
    assert 0.51 < separation.high < 0.54
    assert np.isnan(half_resolved([statistics.share(0, 100)] * 3, CONFIG).value)


def test_table_has_its_rows_and_finds_the_traced_spheres(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    monkeypatch.setattr(angle_resolution, "SEPARATIONS", (0.1, 0.2, 0.25, 0.8, 1.2))
    monkeypatch.setattr(angle_resolution, "SNR_DB", (20.0,))
    result = angle_resolution.run(CONFIG, Store(tmp_path), Progress(quiet=True))
    check_rows("angle_resolution", result.rows)
    assert [sum(row["metric"] == metric for row in result.rows) for metric in (PROBABILITY, HALF, ERROR)] == [15, 3, 3]
    assert {row["verdict"] for row in result.rows if row["metric"] == HALF and row["method"] != "bartlett"} == {"holds"}
    error = {row["method"]: row["value"] for row in result.rows if row["metric"] == ERROR}
    assert error["bartlett"] > 3
    assert max(error["capon"], error["music"]) < 1
    (drawn,) = result.figures.values()
    assert callable(drawn)
    assert len(drawn().axes) == 2
