"""Load a recogniser as an MLflow python_function model. MLflow calls the function `_load_pyfunc` of the module that the model names.

This module needs neither mlflow nor pickle, because the model's data is the folder that `Recogniser.save` wrote.
"""

from __future__ import annotations

from radartwin.errors import InputError
from radartwin.recognize.classify import classify
from radartwin.recognize.model import Recogniser

RECORDING = "recording"


class Classifier:
    def __init__(self, recogniser: Recogniser) -> None:
        self.recogniser = recogniser

    def predict(self, model_input, params=None):  # without type hints, because MLflow would read type hints as a schema
        """Classify recordings. Return a data frame with one row per recording: the column `label`, and the probability of each class.

        Args:
            model_input: a data frame with a column `recording` of file paths and optional columns `distance_m` and `period_s`.
        """
        import pandas as pd

        if RECORDING not in model_input:
            raise InputError(f"the model needs a column '{RECORDING}' of paths; the columns are {', '.join(map(str, model_input))}")
        rows = []
        for request in model_input.to_dict("records"):
            distance_m, period_s = (float(request[name]) if name in request else None for name in ("distance_m", "period_s"))
            answer = classify(str(request[RECORDING]), self.recogniser, distance_m=distance_m, period_s=period_s)
            probabilities = dict(zip(answer.classes, answer.probabilities.tolist(), strict=True))
            rows.append({"label": answer.classes[0], **{name: probabilities[name] for name in self.recogniser.classes}})
        return pd.DataFrame(rows)


def _load_pyfunc(data_path: str) -> Classifier:
    return Classifier(Recogniser.load(data_path))
