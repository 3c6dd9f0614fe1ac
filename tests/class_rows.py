"""Feature rows of classes around random centres, and a text vector for each class, for tests of learners and probes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from radartwin.recognize.samples import Part, Samples, gather


def class_rows(
    domain: str, seed: int, labels: Sequence[str], features: int, each: int, copies: int = 1, spread: float = 0.2, strata: int = 1000
) -> Samples:
    """Return `each` recordings of every class, with `copies` rows each. The centres of the classes are equal for all domains and seeds."""
    rng, centres = np.random.default_rng(seed), np.random.default_rng(0).normal(size=(len(labels), features))
    parts = [
        Part(f"{domain} {label} {number}", label, domain, centre + spread * rng.normal(size=(copies, features)), f"{number % strata} m")
        for label, centre in zip(labels, centres, strict=True)
        for number in range(each)
    ]
    return gather([f"f{number}" for number in range(features)], parts)


def text_vectors(labels: Sequence[str], size: int = 16) -> dict[str, np.ndarray]:
    """Return orthonormal text vectors by class."""
    vectors = np.linalg.qr(np.random.default_rng(9).normal(size=(size, len(labels))))[0].T.astype(np.float32)
    return dict(zip(labels, vectors, strict=True))
