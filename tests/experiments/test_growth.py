"""Tests of the experiment `growth`: flats of rooms, fitted slopes, rows and claims."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from experiments.speed import growth
from experiments.speed.flat_of_rooms import flat
from radartwin.config.compose import compose
from radartwin.io.progress import Progress
from radartwin.runs.experiment import check_rows
from radartwin.store.products import Store


@pytest.mark.parametrize("count", [10, 30, 100, 1000, 3000])
def test_flat_has_the_given_number_of_surfaces(count: int) -> None:
    scene, place = flat(count)
    found = sum(len(one.mesh.facets) for one in scene.surfaces)
    assert count <= found <= count + 36, "the last piece of furniture has up to 36 surfaces"
    scene.check_sensor(place[None])


def test_flat_is_the_same_in_every_call() -> None:
    one, two = (np.concatenate([surface.mesh.vertices for surface in flat(300)[0].surfaces]) for _ in range(2))
    assert np.array_equal(one, two)


def test_slope_is_the_power_of_a_power_law() -> None:
    sizes = np.array([10.0, 100.0, 1000.0])
    fitted = growth.slope(sizes, 0.02 * sizes**1.5)
    assert (fitted.value, fitted.low, fitted.high) == pytest.approx((1.5, 1.5, 1.5))


def test_growth_above_the_limit_fails_its_claim(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sweep = growth.Sweep("surfaces", lambda n: {"set-up": (n, 1e-3 * n**1.2), "frame": (n, 1e-3 * n**0.2)}, (1, 10, 100), (), {
        "set-up": 1.0, "frame": 0.5,
    })  # fmt: skip
    monkeypatch.setattr(growth, "SWEEPS", (sweep,))
    config = compose(["experiment=growth", f"output={tmp_path}"])
    result = growth.run(config, Store(tmp_path / "cache"), Progress(quiet=True))
    check_rows(result.table, result.rows)
    verdicts = {row["part"]: row["verdict"] for row in result.rows if row["metric"] == growth.SLOPE}
    assert verdicts == {"set-up": "misses", "frame": "holds"}
    assert result.metrics["surfaces set-up"] == pytest.approx(1.2)
    growth.chart(result.rows)


def test_quick_sweeps_are_shorter_than_those_of_the_paper() -> None:
    for sweep in growth.SWEEPS:
        assert set(sweep.quick) <= set(sweep.paper)
