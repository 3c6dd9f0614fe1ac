"""Tests of the experiment `growth`: flats of rooms, fitted slopes, rows and claims."""

from __future__ import annotations

from pathlib import Path

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
    surfaces = sum(len(surface.mesh.facets) for surface in scene.surfaces)
    assert count <= surfaces <= count + 36, "the last piece of furniture has up to 36 surfaces"
    scene.check_sensor(place[None])


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
