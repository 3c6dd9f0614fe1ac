"""All learners fulfil one contract: they learn, they are deterministic, and they do not use the labels of test rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from radartwin.recognize.encoder import Settings
from radartwin.recognize.learners import LEARNERS, Convolution, Learner, Trees
from radartwin.recognize.probes import nearest_centroid
from radartwin.recognize.samples import MEASURED, SIMULATED, Part, Samples, gather
from radartwin.recognize.split import Split, label_free

SHAPE = (2, 8, 7)
OBJECTS: tuple[str, ...] = ("bottle", "can", "mug", "reflector")
ANCHORS: dict[str, np.ndarray] = dict(
    zip(OBJECTS, np.linalg.qr(np.random.default_rng(9).normal(size=(16, 4)))[0].T.astype(np.float32), strict=True)
)
SETTINGS = Settings(hidden=16, epochs=30, batch=32)
SMALL: dict[str, Learner] = {**LEARNERS, "convolution": Convolution(SHAPE, batch=32), "trees": Trees(iterations=20)}

each_learner = pytest.mark.parametrize("name", SMALL)


def pictures(kind: int, rng: np.random.Generator, rows: int) -> np.ndarray:
    """Return pictures of an echo that flashes `kind` times per revolution, from a random start angle."""
    height, width = SHAPE[1:]
    start = 2 * np.pi * rng.random((rows, 1, 1))
    angle, column = 2 * np.pi * np.arange(height)[:, None] / height, np.arange(width)
    lobe = np.exp(-((column - width // 2) ** 2) / 2)
    time = (0.6 + 0.4 * np.cos(kind * (angle + start))) * lobe
    doppler = np.broadcast_to((np.abs(np.arange(height) - height // 2)[:, None] == kind) * lobe, time.shape)
    return np.clip(np.stack([time, doppler], axis=1) + 0.05 * rng.normal(size=(rows, *SHAPE)), 0, 1).reshape(rows, -1)


def samples(name: str, domain: str, seed: int, each: int = 3, copies: int = 6, objects: tuple[str, ...] = OBJECTS) -> Samples:
    rng, centres = np.random.default_rng(seed), np.random.default_rng(0).normal(size=(len(OBJECTS), 6))
    parts = []
    for label in objects:
        kind = OBJECTS.index(label)
        for number in range(each):
            vectors = pictures(kind, rng, copies) if SMALL[name].reads == "pictures" else centres[kind] + 0.2 * rng.normal(size=(copies, 6))
            parts.append(Part(f"{domain} {label} {number}", label, domain, vectors, f"{number} m"))
    return gather([f"value {n}" for n in range(parts[0].values.shape[1])], parts)


def split(name: str) -> Split:
    return label_free(samples(name, SIMULATED, 1), samples(name, MEASURED, 2))


@each_learner
def test_a_learner_learns_an_easy_problem_with_and_without_labels_of_other_rows(name: str) -> None:
    one = split(name)
    fitted = SMALL[name].fit(one, ANCHORS, SETTINGS, 0)
    assert (fitted.predict(one.unlabelled) == one.test.label).mean() > 0.9
    train, test = fitted.embedded(one.train), fitted.embedded(one.test)
    assert (nearest_centroid(train, test) == test.label).mean() > 0.9
    assert np.array_equal(test.recording, one.test.recording)
    assert len(test.names) == test.values.shape[1]


@each_learner
def test_the_same_seed_gives_the_same_bytes(name: str) -> None:
    one = split(name)
    first, again = (SMALL[name].fit(one, ANCHORS, SETTINGS, 3).embedded(one.test).values for _ in range(2))
    assert first.tobytes() == again.tobytes()


@each_learner
def test_test_rows_do_not_reach_the_training(name: str) -> None:
    one = split(name)
    other = replace(one.test, label=np.roll(one.test.label, 18), values=one.test.values[::-1].copy())
    fits = [SMALL[name].fit(label_free(one.train, test), ANCHORS, SETTINGS, 0) for test in (one.test, other)]
    first, second = (fitted.embedded(one.test).values for fitted in fits)
    assert first.tobytes() == second.tobytes()


@each_learner
def test_the_order_of_the_text_anchors_does_not_matter(name: str) -> None:
    one, turned = split(name), dict(reversed(ANCHORS.items()))
    first, second = (SMALL[name].fit(one, anchors, SETTINGS, 0).embedded(one.test).values for anchors in (ANCHORS, turned))
    assert first.tobytes() == second.tobytes()


@each_learner
def test_the_order_of_the_class_names_does_not_matter(name: str) -> None:
    """The new class names sort in the reverse order, so that the classes have other numbers and other random draws."""
    one = split(name)
    names: dict[str, str] = dict(zip(OBJECTS, ("z", "y", "x", "w"), strict=True))
    renamed = label_free(one.train.relabelled(names), one.test.relabelled(names))
    predicted = SMALL[name].fit(renamed, {names[label]: ANCHORS[label] for label in OBJECTS}, SETTINGS, 0).predict(renamed.unlabelled)
    assert (predicted == renamed.test.label).mean() > 0.9


@each_learner
def test_rows_of_classes_outside_the_training_are_embedded(name: str) -> None:
    """A learner of three classes predicts one of them for rows of a fourth class, and embeds these rows."""
    known = OBJECTS[:3]
    one = label_free(samples(name, SIMULATED, 1, objects=known), samples(name, MEASURED, 2))
    fitted = SMALL[name].fit(one, ANCHORS, SETTINGS, 0)
    assert set(fitted.predict(one.unlabelled)) <= set(known)
    assert np.isfinite(fitted.embedded(one.test).values).all()


@each_learner
def test_one_recording_of_two_rows_per_class_is_enough_to_train(name: str) -> None:
    one = label_free(samples(name, SIMULATED, 1, each=1, copies=2), samples(name, MEASURED, 2, each=1, copies=1))
    fitted = SMALL[name].fit(one, ANCHORS, SETTINGS, 0)
    assert (fitted.predict(one.unlabelled) == one.test.label).sum() >= 2
    assert fitted.embedded(one.test.take([0])).values.shape[0] == 1


def test_a_later_start_of_the_revolution_does_not_change_the_embedding_of_a_convolution() -> None:
    one = split("convolution")
    fitted = SMALL["convolution"].fit(one, ANCHORS, SETTINGS, 0)
    shown = one.test.values.reshape(-1, *SHAPE).copy()
    shown[:, 0] = np.roll(shown[:, 0], 3, axis=1)
    later = one.test.with_values(shown.reshape(len(shown), -1))
    assert fitted.embedded(later).values == pytest.approx(fitted.embedded(one.test).values, abs=1e-5)
    shown[:, 1] = np.roll(shown[:, 1], 1, axis=1)
    moved = one.test.with_values(shown.reshape(len(shown), -1))
    assert np.abs(fitted.embedded(moved).values - fitted.embedded(one.test).values).max() > 0.01


def test_embeddings_of_networks_are_unit_vectors_and_those_of_trees_are_log_probabilities() -> None:
    for name in SMALL:
        one = split(name)
        values = SMALL[name].fit(one, ANCHORS, SETTINGS, 0).embedded(one.test).values
        length = np.exp(values).sum(axis=1) if name == "trees" else np.linalg.norm(values, axis=1)
        assert length == pytest.approx(np.ones(len(values)), abs=5e-3)


def test_messages_name_the_mistake() -> None:
    vectors = split("network")
    with pytest.raises(ValueError, match=r"6 values are not pictures of shape \(2, 8, 7\)"):
        SMALL["convolution"].fit(vectors, ANCHORS, SETTINGS, 0)
    with pytest.raises(ValueError, match="class mug has no text embedding"):
        SMALL["network"].fit(vectors, {label: ANCHORS[label] for label in ("bottle", "can")}, SETTINGS, 0)
    one = label_free(samples("trees", SIMULATED, 1, objects=("can",)), samples("trees", MEASURED, 2))
    with pytest.raises(ValueError, match="all training rows have the class can; give at least two classes"):
        SMALL["trees"].fit(one, ANCHORS, SETTINGS, 0)
    fitted = SMALL["convolution"].fit(split("convolution"), ANCHORS, SETTINGS, 0)
    with pytest.raises(ValueError, match=r"not rows of shape \(72, 6\)"):
        fitted.embedded(vectors.test)
