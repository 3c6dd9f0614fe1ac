"""Tests of the stability table: its safe regions follow from the errors, its figure shows them, and the tracer stays accurate."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from experiments.speed.methods import Method, tracer
from experiments.stability import stability, sweeps
from experiments.stability.sweeps import METHODS, SWEEPS, Sweep
from experiments.validation.oracles import fullwave, furnished_sweeps, moments_2d
from radartwin.runs.experiment import check_rows

BY_NAME = {sweep.name: sweep for sweep in SWEEPS}
PEER = Method("points", "table", "points")


def rows(mine: list[float], peer: list[float]) -> list[dict]:
    values = tuple(float(10 * (i + 1)) for i in range(len(mine)))
    sweep = Sweep("made up", "a made-up sweep", "m", "physical", values, lambda method, value: 0.0, "because")
    table = stability.sweep_rows(sweep, [(tracer("default"), mine), (PEER, peer)])
    check_rows("stability", table)
    return table


def test_safe_region_ends_before_the_first_error_above_the_limit() -> None:
    first, second = rows([0.1, 3.0, 3.1, 0.1], [5.0, 0.1, 0.1, 0.1])
    assert (first["value"], first["safe"], first["fails at"]) == (2, "10 to 20 m", "30 m")
    assert (second["value"], second["safe"], second["fails at"]) == (0, "none", "10 m")
    assert (first["verdict"], second["verdict"]) == ("holds", "")
    assert rows([0.1, math.nan, 0.1], [5.0, 5.0, 5.0])[0]["value"] == 1  # nan is not a safe value


def test_claim_holds_for_the_largest_or_an_equal_safe_region() -> None:
    assert [rows([0.1, 9.0], [0.2, 9.0])[0]["verdict"], rows([9.0, 0.1], [0.2, 9.0])[0]["verdict"]] == ["holds", "misses"]


def test_samples_that_are_not_finite_give_nan(monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken:
        iq = np.full((1, 1, 1, 1, 256), np.nan + 0j)

    monkeypatch.setattr(sweeps, "simulate", lambda *given, **options: Broken)
    assert math.isnan(stability.errors_of(BY_NAME["gap"], METHODS[0])[0])


# {parameter: (value, limit of the error in dB)} at which the tracer must stay accurate
STANDS = {
    "rays": (256, 0.6), "grid": (2.5, 0.3), "facets": (16, 0.5), "holes": (5, 0.6), "noise": (0.1, 0.8),
    "near": (0.3, 1.5), "fold": (10.0, 0.2), "speed": (7.0, 0.5), "thickness": (0.0, 0.1), "gap": (0.03, 0.1), "snr": (20, 0.2),
    "panel": (0, 1.0), "edge": (100, 1.0),
}  # fmt: skip


@pytest.mark.parametrize("name", STANDS)
def test_errors_of_this_tracer_stay_below_known_values(name: str) -> None:
    value, limit_db = STANDS[name]
    assert BY_NAME[name].error_db(METHODS[0], value) < limit_db


def test_method_without_absolute_level_is_calibrated_on_the_sphere() -> None:
    naive = next(method for method in METHODS if method.backend == "rfgenesis")
    iq = sweeps.samples(naive, *sweeps.alone(sweeps.objects.sphere(sweeps.BALL_M, 4), 1.0))
    assert sweeps.off(naive, iq, sweeps.sphere_echo(sweeps.BALL_M, 1.0, sweeps.MIDDLE_HZ)[0]) == pytest.approx(0, abs=1e-6)
    assert sweeps.gain_db(METHODS[0]) == 0


def test_full_wave_scenes_of_the_sweeps_are_stored() -> None:
    """Every value of the four sweeps with full-wave truth has its stored scene and field, and one field is the solution of its scene."""
    stored = json.loads((furnished_sweeps.FOLDER / "scenes.json").read_text())["scenes"]
    scenes = furnished_sweeps.scenes()
    assert stored == {name: {part: strips.tolist() for part, strips in surfaces.items()} for name, surfaces in scenes.items()}
    for sweep in furnished_sweeps.SWEEPS:
        assert {furnished_sweeps.name(sweep, value) for value in BY_NAME[sweep].values} <= set(stored)
    frequency, field = fullwave.field(furnished_sweeps.FOLDER, "edge_-10")
    nodes = moments_2d.nodes(scenes["edge_-10"].values(), float(frequency[-1]))
    origin = np.zeros(2)
    assert np.abs(moments_2d.sweep(nodes, frequency[:3], origin, origin) - field[:3]).max() < 1e-4 * np.abs(field).max()
    assert all((furnished_sweeps.FOLDER / f"{name}.csv").is_file() for name in stored)
