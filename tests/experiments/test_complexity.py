"""Build the tables that compare model complexity and simulation methods from constructed results, without tracing rays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from experiments.complexity import complexity
from experiments.complexity.rows import AUTO, FIXED, REFLECTOR, SHIPPED, CaseResult, chart, table
from experiments.speed import campaign_methods, speed_accuracy
from radartwin.adaptive.choice import Choice, Step
from radartwin.adaptive.scene_settings import DEFAULT, FINEST, Model
from radartwin.config.compose import compose
from radartwin.recognize.samples import MEASURED, SIMULATED, Samples
from radartwin.runs.experiment import check_rows

CONFIG = compose(["experiment=complexity"])


def case_result(
    asked: str, parts: str, seconds: tuple[float, float, float], shipped_error: float = 0.2, auto_error: float = 0.6
) -> CaseResult:
    model = Model(parts, 3, True, False, 0.25, "planar")
    steps = (Step("parts", "none", 3.0, "multipath_share", False), Step("max_bounces", 3, 0.5, "entropy", True))
    errors = {AUTO: (0.5, "entropy"), FIXED: (0.1, "entropy"), SHIPPED: (shipped_error, "entropy")}
    between = {**errors, AUTO: (auto_error, "entropy")}
    models = {AUTO: model, FIXED: DEFAULT, SHIPPED: DEFAULT}
    name, took = REFLECTOR.name.removesuffix("-0"), {who: [each] for who, each in zip(models, seconds, strict=True)}
    return CaseResult(name, asked, Choice(model, 0.5, "entropy", steps), models, errors, between, (2.0, "brightness_db"), took, 9.0)


def rows(*results: CaseResult) -> list[dict]:
    return table(CONFIG, results, Choice(DEFAULT, 0.2, "entropy", ()))


@pytest.mark.parametrize(
    ("shape", "multipath", "verdicts"), [("none", "large", ["holds", "holds"]), ("large", "none", ["misses", "misses"])]
)
def test_claims_about_the_reflector_follow_the_chosen_room(shape: str, multipath: str, verdicts: list[str]) -> None:
    cost = (0.2, 0.5, 0.5)
    made = rows(case_result("rotation", shape, cost), case_result("shape", shape, cost), case_result("multipath share", multipath, cost))
    check_rows("complexity", made)
    assert [row["verdict"] for row in made if row["metric"].startswith("parts of the room")] == verdicts
    chart(made)
    choice = case_result("shape", "none", cost).choice
    assert list(complexity.examined(choice)) == [replace(FINEST, parts="none"), replace(FINEST, max_bounces=3)]


def test_median_saving_and_shipped_default_are_judged() -> None:
    made = rows(*(case_result("rotation", "none", cost) for cost in ((1.0, 4.0, 3.9), (1.0, 5.0, 5.0), (1.0, 6.0, 6.0))))
    verdict = {row["metric"]: (row["value"], row["verdict"]) for row in made}
    assert verdict["cost of the fixed default over auto's, median"] == (5.0, "holds")
    assert verdict["error of the shipped default between the frames of the choice, worst of all (limits)"] == (0.2, "holds")
    assert verdict["cost of the shipped default over the fixed one's, median"] == (1.0, "holds")
    costs = ((1.0, 2.0, 6.0), (1.0, 2.2, 7.0), (1.0, 2.4, 8.0))
    worse = rows(*(case_result("rotation", "none", cost, shipped_error=1.2, auto_error=1.1) for cost in costs))
    failed = {row["metric"]: row["verdict"] for row in worse if row["claim"]}
    assert failed.pop("error of the fixed default between the frames of the choice, worst of all (limits)") == "holds"
    assert set(failed.values()) == {"misses"}


def samples(domain: str, values: list[list[float]], labels: list[str]) -> Samples:
    names = np.array([f"{label} {domain} {number}" for number, label in enumerate(labels)])
    where = np.full(len(labels), "1 m")
    return Samples(("a", "b"), np.array(values), names, where, np.full(len(labels), domain), names, np.array(labels), np.array(labels))


def test_feature_error_is_in_standard_deviations_of_the_measured_without_a_common_gain() -> None:
    measured = samples(MEASURED, [[0.0, 5.0], [2.0, 5.0]], ["mug", "mustard"])  # the standard deviation of a is one, b is constant
    simulated = samples(SIMULATED, [[3.0, 9.0], [2.0, 9.0]], ["mug", "mustard"])
    assert campaign_methods.feature_error(simulated, measured)[0] == pytest.approx(np.sqrt(9 / 2))
    measured, simulated = (
        replace(samples(domain, [[0.0, -70.0 + gain], [2.0, -60.0 + gain]], ["mug", "mustard"]), names=("a", "brightness_db"))
        for domain, gain in ((MEASURED, 0.0), (SIMULATED, 55.0))
    )
    assert campaign_methods.feature_error(simulated, measured)[0] == pytest.approx(0.0)


def test_default_fails_if_an_equally_good_method_is_faster() -> None:
    """The other method is ten times faster. Its error equals that of the default, or is larger by more than a standard error."""

    def one(setting: str, second: float, error: float) -> dict:
        return {
            "problem": "campaign", "family": "this tracer", "setting": setting, "seconds_frame": second, "seconds": [second],
            "feature_error": error, "spread of feature_error": 0.1, "recognition_error": error,
            "answers": 100, "exact": False, "keys": ["k"],
        }  # fmt: skip

    for error, verdict in ((0.3, "misses"), (0.5, "holds")):
        table = speed_accuracy.campaign_rows([one("default", 1.0, 0.3), one("other", 0.1, error)], {"m": "m"}, "testbed")
        check_rows("speed_accuracy", table)
        assert [row["verdict"] for row in table if row["claim"]] == [verdict, verdict]


def test_recognition_error_is_the_share_of_wrong_revolutions() -> None:
    labels = ["mug", "drink_can_355", "mustard", "olive_oil"]
    values = [[0.0, 1.0], [0.1, 1.1], [5.0, 7.0], [5.1, 7.1]]
    simulated, measured = samples(SIMULATED, values, labels), samples(MEASURED, values, labels)
    assert campaign_methods.recognition_error(simulated, measured) == 0.0
    assert campaign_methods.recognition_error(simulated, samples(MEASURED, values[::-1], labels)) == 1.0
