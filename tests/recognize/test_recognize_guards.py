"""Splits refuse measured labels in training without labels, a recording in both parts, and a scored calibration object."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from class_rows import class_rows

from radartwin.recognize.samples import MEASURED, SIMULATED, Part, Samples, gather, join
from radartwin.recognize.split import LeakError, Split, as_domains, draw_shots, label_free, most_shots, shuffled

OBJECTS = ("can", "mug", "reflector")


def recordings(domain: str, each: int = 4, seed: int = 0) -> Samples:
    return class_rows(domain, seed, OBJECTS, 2, each, copies=5, spread=1.0, strata=2)


def test_measured_labels_cannot_reach_training_without_labels():
    """A measured recording with its class label is refused, alone and among simulated recordings, and so is a scored simulation."""
    simulated, measured = recordings(SIMULATED), recordings(MEASURED)
    first = measured.recording == measured.recording[0]
    labelled, rest = measured.take(first), measured.take(~first)
    for train in (labelled, join(simulated, labelled)):
        with pytest.raises(LeakError, match="is in training"):
            Split("label_free", train, rest)
        with pytest.raises(LeakError, match="is in training"):
            Split("calibrated", train, rest.without("reflector"), calibration_object="reflector")
    with pytest.raises(LeakError, match="score measured recordings only"):
        Split("label_free", recordings(SIMULATED, seed=1), simulated)
    split = label_free(simulated, measured)
    assert not hasattr(split.unlabelled, "label")
    assert np.array_equal(split.unlabelled.values, split.test.values)


def test_frames_of_a_recording_stay_together():
    measured = recordings(MEASURED)
    with pytest.raises(LeakError, match="split by recording, never by frame"):
        Split("few_shot", measured.take(np.arange(0, len(measured), 2)), measured.take(np.arange(1, len(measured), 2)), shots=9)
    known, rest = draw_shots(measured, 2, seed=0)
    assert not set(known.recording) & set(rest.recording)
    with pytest.raises(LeakError, match=r"shots is 1"):
        Split("few_shot", join(recordings(SIMULATED), known), rest, shots=1)


def test_revolutions_of_a_recording_stay_together():
    """The revolutions of one recording are nearly equal, so that no split has them in both parts."""
    rng = np.random.default_rng(0)
    parts = [
        Part(f"{label} {number} turn {revolution}", label, MEASURED, rng.normal(size=2), source=f"{label} {number}")
        for label in OBJECTS
        for number in range(4)
        for revolution in range(3)
    ]
    measured = gather(("a", "b"), parts)
    assert most_shots(measured) == 6
    known, rest = draw_shots(measured, 4, seed=0)
    assert not set(known.source) & set(rest.source)
    assert {label: int((known.label == label).sum()) for label in OBJECTS} == dict.fromkeys(OBJECTS, 4)
    others = measured.take(~np.isin(measured.recording, known.recording))
    with pytest.raises(LeakError, match="never by frame"):
        Split("few_shot", known, others, shots=4)


def test_the_calibration_object_is_not_scored():
    simulated, measured = recordings(SIMULATED), recordings(MEASURED)
    with pytest.raises(LeakError, match="reflector is the calibration object"):
        Split("calibrated", simulated, measured, calibration_object="reflector")
    assert "reflector" not in Split("calibrated", simulated, measured.without("reflector"), calibration_object="reflector").test.classes


def test_a_recording_has_one_label_and_one_domain():
    simulated = recordings(SIMULATED)
    labels = simulated.label.copy()
    labels[0] = "mug"
    with pytest.raises(ValueError, match="has two labels, domains or sources"):
        replace(simulated, label=labels)


def test_the_order_of_files_does_not_matter():
    rng = np.random.default_rng(0)
    parts = [Part(f"r{number:02d}", "can", MEASURED, rng.normal(size=(3, 2))) for number in range(12)]
    ordered, shuffled_files = gather(("a", "b"), parts), gather(("a", "b"), [parts[i] for i in rng.permutation(len(parts))])
    assert np.array_equal(ordered.values, shuffled_files.values)
    assert np.array_equal(ordered.recording, shuffled_files.recording)


def test_shuffled_labels_stay_with_recordings_and_keep_class_sizes():
    samples = recordings(SIMULATED, each=6)
    permuted = shuffled(samples, seed=1)
    assert sorted(permuted.per_recording().label) == sorted(samples.per_recording().label)
    assert (permuted.label != samples.label).any()
    both = as_domains(join(recordings(SIMULATED), recordings(MEASURED)))
    domains = shuffled(both, seed=1)
    assert set(domains.classes) == {SIMULATED, MEASURED}
    assert (domains.label != both.label).any()


def test_the_message_names_a_value_that_is_not_finite():
    with pytest.raises(ValueError, match=r"b of recording r1 is not finite"):
        gather(("a", "b"), [Part("r1", "can", MEASURED, np.array([[0.0, np.nan]]))])
