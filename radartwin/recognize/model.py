"""Save, load and apply an exported recogniser: encoder, class prototypes, feature names and scaling, and provenance.

    FOLDER/model.safetensors    encoder weights, class prototypes (K, T), mean and standard deviation of each feature (D,)
    FOLDER/model.json           class names, features, temperature, provenance, digest of model.safetensors

Neither file contains code, so reading a model from an untrusted source runs no code. A class prototype is the unit vector that stands for a
class: the text embedding of the class description, or the centroid of the class's labelled recordings.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError, MissingError
from radartwin.io import files, untrusted_json
from radartwin.recognize.encoder import WEIGHTS, Encoder, text_scores

ARRAYS, DESCRIPTION = "model.safetensors", "model.json"
FORMAT = "radartwin recogniser 1"


@dataclass(frozen=True, eq=False)
class Recogniser:
    """Maps the features of radar recordings to class probabilities.

    Attributes:
        encoder: the encoder that maps D features to an embedding of length T.
        classes: names of the K object classes.
        prototypes: (K, T) unit vectors, one per class; an embedding is compared with all of them.
        temperature: divisor of the similarities in the softmax over classes.
        names: names of the D signal features, in the order in which the encoder expects them.
        features: configuration with which the features of a recording are computed.
        centre: (D,) mean of each feature over the training data.
        spread: (D,) standard deviation of each feature over the training data; a feature with standard deviation 0 is not used.
        provenance: training data and settings, as JSON-compatible values.
    """

    encoder: Encoder
    classes: tuple[str, ...]
    prototypes: NDArray[np.float32]
    temperature: float
    names: tuple[str, ...]
    features: Mapping[str, Any]
    centre: NDArray[np.float64]
    spread: NDArray[np.float64]
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        text = self.encoder.weights["output_bias"].shape[0]
        fits = len(self.names) == self.encoder.size == len(self.centre) == len(self.spread)
        if not fits or self.prototypes.shape != (len(self.classes), text) or not self.classes:
            raise InputError("recogniser: classes, features and encoder have different sizes; train the model again")
        if not (np.isfinite(self.centre).all() and np.isfinite(self.spread).all() and (self.spread >= 0).all()):
            raise InputError("recogniser: centre and spread of the features must be finite; train the model again")

    def probabilities(self, values: NDArray) -> NDArray[np.float64]:
        """Return the class probabilities (N, K) of N feature rows (N, D)."""
        if values.ndim != 2 or values.shape[1] != len(self.names) or not np.isfinite(values).all():
            raise InputError(f"recogniser: needs finite rows of its {len(self.names)} features, not {values.shape}")
        scaled = (values - self.centre) / np.where(self.spread > 0, self.spread, np.inf)
        return text_scores(self.encoder.embed(scaled), self.prototypes, self.temperature)

    def save(self, folder: str | Path) -> Path:
        """Write the model's two files atomically; model.json is written last."""
        from safetensors.numpy import save

        folder = Path(folder)
        arrays = {name: np.ascontiguousarray(self.encoder.weights[name]) for name in WEIGHTS}
        arrays |= {"prototypes": np.ascontiguousarray(self.prototypes), "centre": self.centre, "spread": self.spread}
        content = save(arrays)
        described = {
            "format": FORMAT, "classes": list(self.classes), "names": list(self.names), "features": dict(self.features),
            "temperature": self.temperature, "provenance": dict(self.provenance), "sha256": hashlib.sha256(content).hexdigest(),
        }  # fmt: skip
        text = json.dumps(described, indent=1, allow_nan=False) + "\n"
        (folder / DESCRIPTION).unlink(missing_ok=True)  # a model.json must never stand beside arrays of another model
        files.write_atomically(folder / ARRAYS, content)
        files.write_atomically(folder / DESCRIPTION, text)
        return folder

    @classmethod
    def load(cls, folder: str | Path) -> Recogniser:
        """Read the model that `save` wrote to a folder.

        Raises:
            MissingError: a file of the model is missing.
            InputError: a file is damaged, has another format, or belongs to another model.
        """
        from safetensors import SafetensorError
        from safetensors.numpy import load

        folder = Path(folder)
        for name in (DESCRIPTION, ARRAYS):
            if not (folder / name).is_file():
                raise MissingError(f"{folder / name}: no such file; a model is a folder with {ARRAYS} and {DESCRIPTION}")
        try:
            described = untrusted_json.read(folder / DESCRIPTION)
            if not isinstance(described, dict) or described.get("format") != FORMAT:
                raise InputError(f"its format is not '{FORMAT}'")
            content = (folder / ARRAYS).read_bytes()
            if hashlib.sha256(content).hexdigest() != described["sha256"]:
                raise InputError(f"{ARRAYS} is damaged or belongs to another model")
            arrays = load(content)
            return cls(
                Encoder({name: arrays[name] for name in WEIGHTS}), tuple(map(str, described["classes"])), arrays["prototypes"],
                float(described["temperature"]), tuple(map(str, described["names"])), dict(described["features"]),
                arrays["centre"], arrays["spread"], dict(described["provenance"]),
            )  # fmt: skip
        except (KeyError, TypeError, ValueError, AttributeError, RecursionError, SafetensorError) as error:
            raise InputError(f"{folder}: not a usable model ({str(error).splitlines()[0]}); copy or train the model again") from error
