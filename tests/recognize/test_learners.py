"""All learners fulfil one contract: they learn, they are deterministic, and they do not use the labels of test rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from class_rows import class_rows, text_vectors

from radartwin.recognize.encoder import Settings
from radartwin.recognize.learners import LEARNERS, Convolution, Learner, Trees
from radartwin.recognize.probes import nearest_centroid
from radartwin.recognize.samples import MEASURED, SIMULATED, Part, Samples, gather
from radartwin.recognize.split import Split, label_free

SHAPE = (2, 8, 7)
OBJECTS: tuple[str, ...] = ("bottle", "can", "mug", "reflector")
ANCHORS = text_vectors(OBJECTS)
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
    if SMALL[name].reads != "pictures":
        return class_rows(domain, seed, objects, 6, each, copies)
    rng = np.random.default_rng(seed)
    parts = [
        Part(f"{domain} {label} {number}", label, domain, pictures(OBJECTS.index(label), rng, copies), f"{number} m")
        for label in objects
        for number in range(each)
    ]
    return gather([f"value {n}" for n in range(int(np.prod(SHAPE)))], parts)


def split(name: str) -> Split:
    return label_free(samples(name, SIMULATED, 1), samples(name, MEASURED, 2))


@each_learner
def test_a_learner_learns_an_easy_problem_with_and_without_labels_of_other_rows(name: str) -> None:
    """Embeddings of networks are unit vectors, and those of trees are logarithms of probabilities."""
    data = split(name)
    fitted = SMALL[name].fit(data, ANCHORS, SETTINGS, 0)
    assert (fitted.predict(data.unlabelled) == data.test.label).mean() > 0.9
    train, test = fitted.embedded(data.train), fitted.embedded(data.test)
    assert (nearest_centroid(train, test) == test.label).mean() > 0.9
    assert np.array_equal(test.recording, data.test.recording)
    assert len(test.names) == test.values.shape[1]
    length = np.exp(test.values).sum(axis=1) if name == "trees" else np.linalg.norm(test.values, axis=1)
    assert length == pytest.approx(np.ones(len(test.values)), abs=5e-3)


@each_learner
def test_only_the_seed_and_the_training_rows_decide_the_bytes(name: str) -> None:
    """Neither the test rows and their labels nor the order of the text vectors reach the training."""
    data = split(name)
    other = replace(data.test, label=np.roll(data.test.label, 18), values=data.test.values[::-1].copy())
    variants = [(data.test, ANCHORS), (other, ANCHORS), (data.test, dict(reversed(ANCHORS.items())))]
    fits = [SMALL[name].fit(label_free(data.train, test), anchors, SETTINGS, 3) for test, anchors in variants]
    assert len({fitted.embedded(data.test).values.tobytes() for fitted in fits}) == 1
    if name == "network":
        assert (
            fits[0].embedded(data.test).values.tobytes() != SMALL[name].fit(data, ANCHORS, SETTINGS, 4).embedded(data.test).values.tobytes()
        )


@each_learner
def test_the_order_of_the_class_names_does_not_matter(name: str) -> None:
    """The new class names sort in the reverse order, so that the classes have other numbers and other random draws."""
    data = split(name)
    names: dict[str, str] = dict(zip(OBJECTS, ("z", "y", "x", "w"), strict=True))
    renamed = label_free(data.train.relabelled(names), data.test.relabelled(names))
    predicted = SMALL[name].fit(renamed, {names[label]: ANCHORS[label] for label in OBJECTS}, SETTINGS, 0).predict(renamed.unlabelled)
    assert (predicted == renamed.test.label).mean() > 0.9


@each_learner
def test_one_recording_of_two_rows_per_class_is_enough_to_train(name: str) -> None:
    data = label_free(samples(name, SIMULATED, 1, each=1, copies=2), samples(name, MEASURED, 2, each=1, copies=1))
    fitted = SMALL[name].fit(data, ANCHORS, SETTINGS, 0)
    assert (fitted.predict(data.unlabelled) == data.test.label).sum() >= 2
    assert fitted.embedded(data.test.take([0])).values.shape[0] == 1


def test_a_later_start_of_the_revolution_does_not_change_the_embedding_of_a_convolution() -> None:
    data = split("convolution")
    fitted = SMALL["convolution"].fit(data, ANCHORS, SETTINGS, 0)
    cells = data.test.values.reshape(-1, *SHAPE).copy()
    cells[:, 0] = np.roll(cells[:, 0], 3, axis=1)
    later = data.test.with_values(cells.reshape(len(cells), -1))
    assert fitted.embedded(later).values == pytest.approx(fitted.embedded(data.test).values, abs=1e-5)
    cells[:, 1] = np.roll(cells[:, 1], 1, axis=1)
    moved = data.test.with_values(cells.reshape(len(cells), -1))
    assert np.abs(fitted.embedded(moved).values - fitted.embedded(data.test).values).max() > 0.01


def test_messages_name_the_mistake() -> None:
    vectors = split("network")
    with pytest.raises(ValueError, match=r"6 values are not pictures of shape \(2, 8, 7\)"):
        SMALL["convolution"].fit(vectors, ANCHORS, SETTINGS, 0)
    with pytest.raises(ValueError, match="class mug has no text embedding"):
        SMALL["network"].fit(vectors, {label: ANCHORS[label] for label in ("bottle", "can")}, SETTINGS, 0)
    single = label_free(samples("trees", SIMULATED, 1, objects=("can",)), samples("trees", MEASURED, 2))
    with pytest.raises(ValueError, match="all training rows have the class can; give at least two classes"):
        SMALL["trees"].fit(single, ANCHORS, SETTINGS, 0)
    fitted = SMALL["convolution"].fit(split("convolution"), ANCHORS, SETTINGS, 0)
    with pytest.raises(ValueError, match=r"not rows of shape \(72, 6\)"):
        fitted.embedded(vectors.test)


@each_learner
def test_rows_of_classes_outside_the_training_are_embedded(name: str) -> None:
    """A learner of three classes predicts one of them for rows of a fourth class, and embeds these rows."""
    known = OBJECTS[:3]
    data = label_free(samples(name, SIMULATED, 1, objects=known), samples(name, MEASURED, 2))
    fitted = SMALL[name].fit(data, ANCHORS, SETTINGS, 0)
    assert set(fitted.predict(data.unlabelled)) <= set(known)
    assert np.isfinite(fitted.embedded(data.test).values).all()
