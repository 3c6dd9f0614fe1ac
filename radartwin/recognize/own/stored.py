"""Write a trained recogniser with its held-out answers and its model card into a stored result, and copy it from there to a model folder.

models/recogniser/    model.safetensors, model.json (recognize/model.py) and README.md, the model card
held_out.json         answers at held-out distances (`HeldOut.to_dict`); null if there is no held-out distance
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from radartwin.errors import OutputError
from radartwin.io import files, untrusted_json
from radartwin.recognize.model import ARRAYS, DESCRIPTION, FORMAT, Recogniser
from radartwin.recognize.own.fitting import HeldOut, Training, held_out
from radartwin.recognize.own.model_card import CARD, TrainedOn, model_card
from radartwin.recognize.own.object_list import OwnObject
from radartwin.recognize.samples import Samples
from radartwin.store.products import Product, save_json

MODELS, NAME = "models", "recogniser"  # folder that MLflow logs as models, and name of the model in this folder
HELD_OUT = "held_out"


def write(
    folder: Path, rows: Samples, training: Training, objects: Sequence[OwnObject], trained: TrainedOn, provenance: Mapping[str, Any]
) -> None:
    """Train a recogniser on simulated feature rows, test it at held-out distances, and write both into the folder of a stored result."""
    tested = held_out(rows, training)
    recogniser = training.recogniser(rows, {"trained on": "simulation", **provenance})
    model = recogniser.save(folder / MODELS / NAME)
    files.write_atomically(model / CARD, model_card(objects, trained, int(recogniser.provenance["epochs"]), tested))
    save_json(folder, HELD_OUT, None if tested is None else tested.to_dict())


def read_held_out(product: Product) -> HeldOut | None:
    described = product.read_json(HELD_OUT)
    return None if described is None else HeldOut.from_dict(described)


def copy(product: Product, folder: Path) -> None:
    """Copy the recogniser and its model card to a model folder, which `check_model_folder` accepted. Each file is written atomically."""
    model = product.path / MODELS / NAME
    card = (model / CARD).read_text(encoding="utf-8")
    (folder / CARD).unlink(missing_ok=True)  # the card of another model must never stand beside this model
    Recogniser.load(model).save(folder)
    files.write_atomically(folder / CARD, card)


def check_model_folder(folder: Path) -> None:
    """Raise OutputError if the folder cannot be written, or if it holds files but no recogniser that may be replaced."""
    files.sweep(files.check_folder(folder))
    names = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    interrupted = ARRAYS in names and names <= {ARRAYS, CARD}  # `Recogniser.save` writes model.json last
    if names and not interrupted and not _is_recogniser(folder / DESCRIPTION):
        raise OutputError(f"{folder}: the folder holds files, but no recogniser; choose a new or empty folder for --out")


def _is_recogniser(path: Path) -> bool:
    with contextlib.suppress(OSError, ValueError, RecursionError):
        described = untrusted_json.read(path)
        return isinstance(described, dict) and described.get("format") == FORMAT
    return False
