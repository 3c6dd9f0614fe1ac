"""Recognition tables on synthetic recordings: what simulation and measurement share is recognised, the rest stays at chance."""

from __future__ import annotations

import functools
import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass, replace
from functools import partial
from itertools import permutations
from pathlib import Path
from typing import Any

import fake_campaign
import numpy as np
import pandas as pd
import pytest
from fake_campaign import STILL, FakeCampaign, draw_all, find, sides_of

from experiments.campaign import frame
from experiments.campaign.cases import Case, planned
from experiments.generators import choices, feature_floor
from experiments.recognition import (
    contrastive,
    corner_reflector_calibration,
    encoder_comparison,
    labelled_probe,
    material_errors,
    randomisation_ablation,
    reconstruction_ablation,
    rover_recognition,
    simulation_parts,
    turntable_label_free,
    unlabelled_adaptation,
)
from experiments.recognition.copies import copies
from experiments.recognition.protocol import TEXT, Scored, permuted_accuracy
from experiments.verdicts import Claim
from radartwin.config.compose import compose
from radartwin.config.config import Config
from radartwin.features import families
from radartwin.io.progress import Progress
from radartwin.recognize import probes
from radartwin.recognize.samples import MEASURED, Part, Samples, gather
from radartwin.runs.experiment import Result, check_result, save
from radartwin.store.products import Store

SMALL = ["supervision.copies=3", "supervision.seeds=2", "supervision.trees=20", "supervision.encoder.epochs=10", *STILL]
FRAME = pd.DataFrame({"key": ["0" * 32], "domain": "measured", "side": ""})  # the recordings of a cell
OBJECTS = ("can_211_300", "can_211_400", "corner_reflector", "mug", "mustard", "olive_oil")


def config(name: str, *overrides: str) -> Config:
    return fake_campaign.config(name, *SMALL, *overrides)


@functools.cache
def turntable(**changed) -> FakeCampaign:
    return FakeCampaign(**({"objects": OBJECTS, "frames": 24, "repetitions": 2, "turns": 2} | changed))


@functools.cache
def drives(**changed) -> FakeCampaign:
    given = {"objects": OBJECTS, "frames": 16, "repetitions": 2, "motions": ("lateral", "depth"), "rooms": ("squash_court",)}
    return FakeCampaign(**(given | changed))


def checked(result: Result) -> Result:
    """Check the table rows of a result and draw its figures."""
    check_result(result)
    assert all(row["run_keys"] for row in result.rows)
    draw_all(result)
    return result


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """Return the store of the simulated copies, which the tables share."""
    return Store(tmp_path_factory.mktemp("copies"))


def scored(module: Any, chosen: Config, store: Store, sides: Mapping[str, FakeCampaign] | None = None) -> Result:
    """Return the result of a turntable table."""
    sides = sides or {"": turntable()}
    return module.score(chosen, sides_of(sides), partial(copies, store, sides))


def probe(store: Store, campaign: FakeCampaign) -> Result:
    chosen = config("labelled_probe", "supervision.seeds=12")  # two shuffles of labels are too few for a control
    return scored(labelled_probe, chosen, store, {labelled_probe.PRETRAINED: campaign, labelled_probe.RIVAL: turntable(gap=0.5)})


def test_labelled_probe_recognises_different_objects(store: Store):
    result = checked(probe(store, turntable()))
    for kind in labelled_probe.PROBES:
        row = find(result, probe=kind, method=labelled_probe.PRETRAINED)
        assert (row["verdict"], row["n"], row["answers"]) == ("supported", 24, 48)
        assert row["chance"] == pytest.approx(1 / 6)
    assert find(result, probe=labelled_probe.RECORDINGS, method=labelled_probe.PRETRAINED)["value"] > 0.8
    control = find(result, probe="control", method="simulated labels shuffled, nearest text")
    assert control["low"] <= control["chance"] <= control["high"]


def test_every_learner_recognises_different_objects(store: Store):
    result = checked(scored(encoder_comparison, config("encoder_comparison"), store))
    for method in encoder_comparison.METHODS:
        unlabelled = find(result, method=method, **{"labels per class": 0})
        assert (unlabelled["n"], unlabelled["answers"], unlabelled["chance"]) == (24, 48, pytest.approx(1 / 6))
        if method != encoder_comparison.NETWORK:  # whose row is in the table labelled_probe
            assert find(result, method=method, **{"labels per class": encoder_comparison.RECORDINGS})["value"] > 0.4
    assert find(result, method=encoder_comparison.NETWORK, **{"labels per class": 0})["verdict"] == "supported"
    assert find(result, method=encoder_comparison.RAW, **{"labels per class": 4})["n"] < 24
    assert find(result, method=encoder_comparison.JOINT, **{"labels per class": 4})["value"] > 0.8
    assert not [row for row in result.rows if row["labels per class"] == 8]
    assert "label_efficiency" in result.figures


def test_each_part_of_the_simulation_has_an_accuracy_and_a_difference(store: Store):
    settings = config("simulation_parts")
    # The rival simulates all objects equal.
    names = [part.versions["side"] for part in simulation_parts.query(settings).parts if part.domain == "twin"]
    twins = {name: turntable(signature=float(name != simulation_parts.RIVAL)) for name in names}
    result = checked(scored(simulation_parts, settings, store, twins))
    tables = {row["simulation"] for row in result.rows if row["metric"] == "accuracy" and row["probe"] == TEXT}
    # the other tables have the row of the whole simulation, and that of the rival with labels
    assert tables == {*twins, simulation_parts.NO_LEVEL} - {simulation_parts.EVERYTHING}
    assert not [row for row in result.rows if simulation_parts.RIVAL in row["simulation"] and row["probe"] != TEXT]
    difference = f"{simulation_parts.EVERYTHING} - {simulation_parts.RIVAL}"
    assert find(result, probe=TEXT, simulation=difference)["value"] > 0.3


def test_adaptation_scores_balanced_and_skewed_batches(store: Store):
    settings = config("unlabelled_adaptation")
    result = checked(scored(unlabelled_adaptation, settings, store))
    for method in unlabelled_adaptation.METHODS:
        for batch in ("balanced", "skewed"):
            assert find(result, batch=batch, method=method)["metric"] == "accuracy"
    assert find(result, batch="balanced", method=unlabelled_adaptation.STATISTICS)["value"] > 0.8
    assert find(result, batch="skewed", method=unlabelled_adaptation.STATISTICS)["n"] <= 24


def test_the_ablation_of_randomisation_has_a_row_for_each_kind_of_copies(store: Store):
    settings = config("randomisation_ablation")
    result = checked(scored(randomisation_ablation, settings, store))
    kinds = {row["copies"] for row in result.rows if row["metric"] == "accuracy"}
    left_out = {f"without {name}" for name in settings.profile.left_out}
    assert kinds == {randomisation_ablation.ALL, randomisation_ablation.NOISE_ONLY, *left_out}
    difference = f"{randomisation_ablation.ALL} - {randomisation_ablation.NOISE_ONLY}"
    assert find(result, copies=difference, probe=TEXT)["metric"] == "gain in accuracy"


def test_the_layout_of_the_paper_has_four_objects_at_each_distance(store: Store):
    """Twelve objects at four distances in the paper's layout have a chance of 25 % at equal distance, and the paper states 24.8 %."""
    whole = FakeCampaign(frames=24, repetitions=1, turns=3, distances=(0.5, 1.0, 1.5, 2.0))
    cases = [case for _, case in labelled_probe.as_in_paper(whole)]
    assert len(cases) == 16
    assert {case.object for case in cases} == set(whole.objects)
    assert [sum(case.distance_m == distance for case in cases) for distance in whole.distances] == [4, 4, 4, 4]
    settings = config("labelled_probe")
    layout = turntable(distances=(0.5, 1.0, 1.5), turns=3)
    sides = {labelled_probe.PRETRAINED: turntable()}
    special = frame.read(layout, labelled_probe.as_in_paper(layout), Progress(quiet=True)).assign(side=labelled_probe.LAYOUT)
    both = pd.concat([sides_of(sides), special], ignore_index=True)
    result = labelled_probe.score(settings, both, partial(copies, store, sides))
    assert set(special.key) <= set(result.keys)
    rows = {(row["probe"], row["method"]): row for row in result.rows if row.get("layout") and row["metric"] == "accuracy"}
    assert {probe for probe, _ in rows} == {labelled_probe.REVOLUTIONS, labelled_probe.MATCHED}
    matched = rows[labelled_probe.MATCHED, labelled_probe.PRETRAINED]
    assert (matched["chance"], matched["n"], matched["answers"]) == (pytest.approx(1 / 3), 9, 27)  # six objects at three distances
    assert rows[labelled_probe.REVOLUTIONS, labelled_probe.RAW]["chance"] == pytest.approx(1 / 6)


def test_every_object_has_the_same_number_of_measured_cases():
    often = FakeCampaign(objects=OBJECTS, keep=lambda domain, case: case.repetition < 2 or case.object == "corner_reflector")
    measured = [case for domain, case in frame.shared(often, ["turntable"], several=True) if domain == "measured"]
    assert Counter((case.object, case.distance_m) for case in measured) == {(name, at): 2 for name in OBJECTS for at in (0.5, 1.0)}
    assert {case.repetition for case in measured} == {0, 1}


def test_distances_with_one_object_and_objects_without_twin_are_left_out():
    def keep(domain: str, case: Case) -> bool:
        return (case.distance_m == 1.0 or case.object == "corner_reflector") and (domain == "measured" or case.object != "mug")

    uneven = FakeCampaign(objects=OBJECTS, keep=keep)
    wanted = frame.shared(uneven, ["turntable"], several=True)
    assert {case.distance_m for _, case in wanted} == {1.0}
    for domain in ("measured", "twin"):
        assert {case.object for of, case in wanted if of == domain} == set(OBJECTS) - {"mug"}
    with pytest.raises(ValueError, match="no lateral recordings of one object and place"):
        frame.shared(uneven, ["lateral"], "atrium", several=True)
    single = FakeCampaign(objects=OBJECTS[:1])
    with pytest.raises(ValueError, match="no recordings of two objects at one distance"):
        frame.shared(single, ["turntable"], several=True)


def test_geometry_transfers_without_labels(store: Store):
    settings = config("turntable_label_free")
    result = checked(scored(turntable_label_free, settings, store))
    geometry = find(result, attribute="geometry", method=turntable_label_free.ENCODER)
    assert geometry["chance"] == 0.5
    assert geometry["value"] > 0.8
    assert find(result, attribute="material", method=turntable_label_free.ENCODER)["chance"] == 0.5


@pytest.mark.slow
@pytest.mark.parametrize("overrides", [(), ("supervision=few_shot", "supervision.encoder.paired=0.5")])
def test_contrastive_exports_a_model(store: Store, tmp_path: Path, overrides: tuple[str, ...]):
    settings = config("contrastive", *overrides)
    result = checked(scored(contrastive, settings, store))
    copied = partial(copies, store, {"": turntable()})
    save(replace(result, models={"recogniser": contrastive.export(settings, sides_of({"": turntable()}), copied)}), tmp_path)
    assert find(result, attribute="geometry", method=contrastive.EMBEDDED, **{"left out": "recording"})["value"] > 0.8
    assert find(result, attribute="geometry", method=contrastive.EMBEDDED, **{"left out": "object"})["chance"] == 0.5
    described = json.loads((tmp_path / "models" / "recogniser" / "model.json").read_text())
    assert described["classes"] == sorted(OBJECTS)
    assert not [name for name in described["names"] if "brightness" in name]


def test_rover_rows_follow_the_level_of_supervision():
    label_free = config("rover_recognition", "supervision=label_free", "supervision.seeds=1", "supervision.trees=2")
    of = pd.concat([sides_of({"": drives(materials="vlm")}, motion) for motion in rover_recognition.MOTIONS], ignore_index=True)
    assert {row["supervision"] for row in rover_recognition.score(label_free, of).rows} == {"label_free"}
    result = checked(rover_recognition.score(config("rover_recognition"), of))
    assert {row["supervision"] for row in result.rows} == {"label_free", "calibrated", "few_shot"}
    objects = find(result, supervision="label_free", motion="lateral", classes="object", method=rover_recognition.TRAINED)
    assert (objects["verdict"], objects["n"], objects["chance"]) == ("supported", 24, pytest.approx(1 / 6))
    assert objects["p"] < 0.01  # Student's t over six objects
    material = find(result, supervision="calibrated", motion="lateral", method=rover_recognition.TRAINED, metric="balanced accuracy")
    assert material["n"] == 20  # the four recordings of the corner reflector are not scored
    for motion in ("lateral", "depth"):
        control = find(result, motion=motion, method="simulated labels shuffled")
        assert control["low"] <= control["chance"], "the classifier does not see the labels that it is scored by"


def test_the_ablation_detects_the_benefit_of_the_room():
    """In the synthetic rooms, a wrong material mirrors the room's echoes, so that the labelled room recognises best."""
    names = (reconstruction_ablation.LABELLED, reconstruction_ablation.UNIFORM, reconstruction_ablation.VOID)
    sides = {name: drives(materials=source) for name, source in zip(names, ("vlm", "uniform", "void"), strict=True)}
    result = checked(reconstruction_ablation.score(config("reconstruction_ablation"), sides_of(sides, "lateral")))
    method = f"{reconstruction_ablation.LABELLED} - {reconstruction_ablation.UNIFORM}"
    assert find(result, classes="object", method=method, metric="gain in accuracy")["value"] > 0
    uneven = [row for row in result.rows if row["metric"] == "share of the unequal objects"]
    assert len(uneven) == 2
    assert {row["verdict"] for row in uneven} == {"not testable here"}  # the court has only its floor near the target
    with pytest.raises(ValueError, match="choose another source than uniform"):
        reconstruction_ablation.query(config("reconstruction_ablation", "materials=uniform"))


@pytest.mark.slow
def test_material_errors_are_zero_with_true_materials():
    settings, shares = config("material_errors", "profile.name=paper"), 3
    sides = {name: drives(materials=materials.source) for name, (_, materials) in material_errors.sources(settings).items()}
    result = checked(material_errors.score(settings, sides_of(sides, "lateral")))
    errors = [row["value"] for row in result.rows if row["metric"].startswith("level error")]
    assert errors[0] == 0
    assert len(errors) == shares + 2  # one further error with the configured settings
    assert min(errors[1 : shares + 1]) > 0.1


def test_calibration_removes_a_gain_and_does_not_score_the_reflector():
    settings = config("corner_reflector_calibration")
    result = checked(corner_reflector_calibration.score(settings, fake_campaign.frame_of(turntable(repetitions=3))))
    before, after = (
        find(result, materials="metal", method=when) for when in (corner_reflector_calibration.BEFORE, corner_reflector_calibration.AFTER)
    )
    assert before["value"] == pytest.approx(3.0, abs=0.5)  # the measured radar has twice the gain
    assert abs(after["value"]) < 0.7
    assert after["n"] == 12  # two cans, two distances, three recordings


def test_all_correct_has_the_exact_interval_and_one_object_has_none():
    """Four correct objects of four have an exact confidence interval from 0.40 to 1. A single object is too few to judge a claim."""
    rng = np.random.default_rng(0)
    recordings = gather(("a",), [Part(f"r{n}", f"k{n % 4}", MEASURED, rng.normal(size=1), f"{n // 4} m") for n in range(8)])
    settings = config("contrastive")
    given = Scored(settings, recordings, FRAME, 0.45).accuracy({}, np.ones((2, 8), bool), Claim("above chance")).row(settings)
    assert (given["low"], given["high"], given["verdict"]) == (pytest.approx(0.3976, abs=1e-4), 1.0, "undecided")
    one_place = turntable(distances=(1.0,), repetitions=1, objects=("can_211_300", "corner_reflector", "mug"))
    rows = corner_reflector_calibration.score(config("corner_reflector_calibration"), fake_campaign.frame_of(one_place)).rows
    assert {row["verdict"] for row in rows} <= {"", "undecided"}


def recorded(objects: int, kinds: int, at: int = 4) -> Samples:
    """Return measured recordings of objects of several classes at several distances."""
    parts = [Part(f"r{n:03}", f"k{n // at % kinds}", MEASURED, np.zeros(1), f"{n % at} m") for n in range(objects * at)]
    made = gather(("a",), parts)
    return replace(made, object=np.array([f"o{n // at:02}" for n in range(objects * at)]))


def test_a_gain_needs_six_objects_with_unequal_answers():
    """Five objects of ten swap their methods in 32 ways, so that p is at least 1/16; six allow 1/32."""
    recordings = recorded(10, 10, 2)
    settings, wrong = config("contrastive"), np.zeros((1, 20), bool)
    for unequal, verdict, p in ((0, "undecided", 1.0), (5, "undecided", 1 / 16), (6, "supported", 1 / 32)):
        better = np.isin(recordings.object, [f"o{n:02}" for n in range(unequal)])[None]
        row = Scored(settings, recordings, FRAME, 0.1).gain({}, better, wrong, Claim("helps")).row(settings)
        assert row["verdict"] == verdict
        assert row["p"] == pytest.approx(p)


@pytest.mark.parametrize("balanced", [False, True])
def test_the_classes_of_objects_are_permuted(balanced: bool):
    """Five objects of two classes: the test equals the count over all 120 permutations of the classes."""
    recordings = replace(recorded(5, 5, 2), label=np.repeat(["a", "a", "a", "b", "b"], 2))
    answers = np.array(["a", "a", "a", "b", "a", "a", "b", "b", "b", "a"])
    estimate = permuted_accuracy([answers], recordings, 0, balanced)

    def accuracy(classes: tuple[str, ...]) -> float:
        right = answers == np.repeat(classes, 2)
        return float(np.mean([right[np.repeat(classes, 2) == kind].mean() for kind in "ab"] if balanced else right))

    shuffled = np.array([accuracy(order) for order in permutations(("a", "a", "a", "b", "b"))])
    assert estimate.value == pytest.approx(accuracy(("a", "a", "a", "b", "b")))
    assert sorted(estimate.shuffled) == pytest.approx(sorted(shuffled))  # type: ignore[arg-type]
    assert estimate.p(float(shuffled.mean())) == pytest.approx(2 * np.mean(shuffled >= estimate.value - 1e-9))


def test_no_setting_was_chosen_on_reported_recordings():
    """The file of choices names the data on which each setting was chosen, and has every numeric setting at its value."""
    content = json.loads(choices.OUTPUT.read_text())
    given = compose(["experiment=labelled_probe"])
    for choice in content["choices"]:
        assert choice["chosen_on"] in ("none", "synthetic", "simulated", "selection")
        value = given
        for part in choice["setting"].split("."):
            value = getattr(value, part)
        assert (asdict(value) if is_dataclass(value) and not isinstance(value, type) else value) == choice["value"], choice["setting"]
    recorded = {choice["setting"] for choice in content["choices"]}
    numbers = {f"supervision.encoder.{field.name}" for field in fields(given.supervision.encoder)} - {
        "supervision.encoder.paired", "supervision.encoder.weight_decay",
    }  # fmt: skip
    assert numbers <= recorded


def test_no_reported_recording_was_among_those_of_the_selection():
    selection = json.loads(choices.OUTPUT.read_text())["selection"]
    assert selection["recordings"] == choices.recordings(choices.configured())
    for profile in ("quick", "paper"):
        given = compose(["experiment=labelled_probe", f"profile={profile}"])
        reported = {choices.named(case, given) for case in planned(given.profile.campaign, measured=True)}
        assert reported
        assert not reported & set(selection["recordings"])
        prefixes = {name.partition(":")[0] for name in (*reported, *selection["recordings"])}
        boards, seeds = zip(*(tuple(prefix.split()[1::2])[::-1] for prefix in prefixes), strict=True)
        assert len(set(boards)) == len(set(seeds)) == len(prefixes)  # every draw has its own board and its own seed


def test_the_recorded_choices_follow_from_the_scores():
    selection = json.loads(choices.OUTPUT.read_text())["selection"]
    share = choices.chosen_share(selection["scores"])
    assert selection["chosen"] == choices.selected(selection["scores"]) | {"labelled share": share}
    assert share == encoder_comparison.LABELLED_SHARE
    assert selection["chosen"]["copies"] == randomisation_ablation.ALL  # the default of supervision.randomise
    assert {row["method"] for row in selection["scores"] if "method" in row} == {*encoder_comparison.METHODS, encoder_comparison.RAW}


def test_the_floor_of_features_is_measured_in_a_draw_of_its_own():
    content = json.loads(probes.FLOOR.read_text())
    assert f"draw {feature_floor.DRAW}," in content["source"]
    paper = compose(["experiment=labelled_probe", "profile=paper"]).profile.campaign
    assert feature_floor.DRAW not in {choices.DRAW, *range(max(paper.draws, paper.rover_draws))}
    case, source = Case("mug", "lab", "turntable", 1.0), turntable()
    names, _ = families.vector(source.processed("twin", case)[1], source.log(case, "twin"), "rotation")
    assert (probes.repeatability(names) > 0).all()


def test_single_recordings_leave_out_the_rows_that_need_several(store: Store):
    """With one recording per object, no probe tests on other recordings, although the recording has several revolutions."""
    single = turntable(repetitions=1, keep=lambda domain, case: case.distance_m == 1.0)
    result = checked(probe(store, single))
    revolutions = find(result, probe=labelled_probe.REVOLUTIONS, method=labelled_probe.PRETRAINED)
    assert (revolutions["n"], revolutions["answers"]) == (6, 12)
    assert labelled_probe.RECORDINGS not in {row["probe"] for row in result.rows}
    learned = scored(encoder_comparison, config("encoder_comparison"), store, {"": single})
    assert {row["labels per class"] for row in checked(learned).rows} == {0}
    adapted = scored(unlabelled_adaptation, config("unlabelled_adaptation", "supervision.encoder.epochs=2"), store, {"": single})
    assert {row["batch"] for row in checked(adapted).rows} == {"balanced"}
