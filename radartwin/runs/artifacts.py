"""Log the models and input data of a run to MLflow. Only this package imports mlflow."""

from __future__ import annotations

import hashlib
import json
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from radartwin.constants import __version__
from radartwin.runs.checkout import commit

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import DatasetInput

LOADER = "radartwin.recognize.pyfunc"  # Python module with which MLflow loads the trained models of a run
DIGEST_LENGTH = 32  # number of characters in a dataset's digest; MLflow accepts at most 36


@dataclass
class Record:
    """The data of a run that the runner logs to MLflow."""

    run_id: str = ""
    metrics: Mapping[str, float] = field(default_factory=dict)
    artifacts: Sequence[Path] = ()
    inputs: Mapping[str, Sequence[str]] = field(default_factory=dict)  # keys of the stored input data by kind


def tags(table: str, key: str) -> dict[str, str]:
    head, dirty = commit()
    return {"run_key": key, "table": table, "git_commit": head, "dirty": str(dirty).lower(), "radartwin": __version__}


def log_models(client: MlflowClient, run_id: str, folder: Path) -> None:
    """Log each subfolder NAME of `folder`, a model without pickle files, as the MLflow python_function model models/NAME."""
    from mlflow import pyfunc

    for model in sorted(folder.iterdir()):
        with tempfile.TemporaryDirectory() as work, warnings.catch_warnings():
            warnings.filterwarnings("ignore", ".*Any type hint is inferred")  # mlflow raises this warning about its own classes
            made = Path(work) / model.name
            requirements = [f"radartwin=={__version__}"]
            pyfunc.save_model(str(made), loader_module=LOADER, data_path=str(model), pip_requirements=requirements)
            client.log_artifacts(run_id, str(made), f"{folder.name}/{model.name}")


def datasets(inputs: Mapping[str, Sequence[str]]) -> list[DatasetInput]:
    """Return one MLflow dataset per kind of input data. Its digest is the key of the stored data, or a digest of several such keys."""
    from mlflow.entities import Dataset, DatasetInput

    dataset_inputs = []
    for kind, keys in sorted(inputs.items()):
        unique = sorted(set(keys))
        digest = unique[0] if len(unique) == 1 else hashlib.sha256(" ".join(unique).encode()).hexdigest()
        source = json.dumps({"uri": f"cache/{kind}"})
        profile = json.dumps({"products": len(unique)})
        dataset_inputs.append(DatasetInput(Dataset(kind, digest[:DIGEST_LENGTH], "local", source, profile=profile)))
    return dataset_inputs


def comparison(experiment_id: str, run_ids: Sequence[str]) -> str:
    """Return the Markdown description of a sweep's parent run, with a link that compares the sweep's jobs in the MLflow dashboard."""
    runs, experiments = (quote(json.dumps(ids, separators=(",", ":"))) for ids in (list(run_ids), [experiment_id]))
    return f"[Compare its {len(run_ids)} latest jobs](#/compare-runs?runs={runs}&experiments={experiments})"
