"""Log the models, input data and machine load of a run to MLflow.

Only this module, radartwin/runs/tracking.py and radartwin/runs/start_page.py import mlflow.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import tempfile
import threading
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from radartwin.constants import __version__
from radartwin.errors import BackendError
from radartwin.runs.checkout import commit

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import DatasetInput, Metric

LOADER = "radartwin.recognize.pyfunc"  # Python module with which MLflow loads the trained models of a run
DIGEST_LENGTH = 32  # number of characters in a dataset's digest; MLflow accepts at most 36
BATCH = 1000  # number of metrics that MLflow accepts in one call
SYSTEM = "system/"  # prefix of machine-load metrics, which MLflow shows on a separate page
SYSTEM_METRICS = "MLFLOW_ENABLE_SYSTEM_METRICS_LOGGING"


@dataclass
class Record:
    """The data of a run that the runner logs to MLflow.

    Attributes:
        inputs: keys of the stored data that the result was computed from, grouped by kind of data.
    """

    run_id: str = ""
    metrics: Mapping[str, float] = field(default_factory=dict)
    artifacts: Sequence[Path] = ()
    inputs: Mapping[str, Sequence[str]] = field(default_factory=dict)


def tags(table: str, key: str) -> dict[str, str]:
    head, dirty = commit()
    return {"run_key": key, "table": table, "git_commit": head, "dirty": str(dirty).lower(), "radartwin": __version__}


def log_models(client: MlflowClient, run_id: str, folder: Path) -> None:
    """Log each subfolder NAME of `folder` as the MLflow python_function model models/NAME.

    Each subfolder holds a model without pickle files.
    """
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


@contextlib.contextmanager
def machine(run_id: str, uri: str) -> Iterator[list[Metric]]:
    """Within the `with` block, sample the load of processor, memory, disk, network and GPU, if SYSTEM_METRICS is set. Yield the list of
    samples.

    The caller logs the samples, because MLflow's own thread would write to the SQLite database at any time, and two simultaneous writers
    fail. The environment variable MLFLOW_SYSTEM_METRICS_SAMPLING_INTERVAL sets the sampling interval in seconds.

    Raises:
        BackendError: psutil is not installed.
    """
    from mlflow.entities import Metric
    from mlflow.environment_variables import MLFLOW_ENABLE_SYSTEM_METRICS_LOGGING

    samples: list[Metric] = []
    if not MLFLOW_ENABLE_SYSTEM_METRICS_LOGGING.get():
        yield samples
        return
    try:
        from mlflow.system_metrics.system_metrics_monitor import SystemMetricsMonitor
    except ModuleNotFoundError as error:
        raise BackendError(
            f"{SYSTEM_METRICS} needs {error.name}: run pip install 'radartwin[system-metrics]', or unset the variable"
        ) from error
    monitor = SystemMetricsMonitor(run_id, tracking_uri=uri)
    over = threading.Event()

    def sample() -> None:
        step = 0
        while step == 0 or not over.wait(monitor.sampling_interval):
            monitor.collect_metrics()
            now = int(time.time() * 1000)
            samples.extend(Metric(SYSTEM + name, float(value), now, step) for name, value in monitor.aggregate_metrics().items())
            for part in monitor.monitors:
                part.clear_metrics()
            step += 1

    thread = threading.Thread(target=sample, daemon=True, name="system-metrics")
    thread.start()
    try:
        yield samples
    finally:
        over.set()
        thread.join()


def log_metrics(client: MlflowClient, run_id: str, metrics: Sequence[Metric]) -> None:
    for first in range(0, len(metrics), BATCH):
        client.log_batch(run_id, metrics=metrics[first : first + BATCH])


def comparison(experiment_id: str, run_ids: Sequence[str]) -> str:
    """Return the Markdown description of a sweep's parent run, with a link that compares the sweep's jobs in the MLflow dashboard."""
    runs, experiments = (quote(json.dumps(ids, separators=(",", ":"))) for ids in (list(run_ids), [experiment_id]))
    return f"[Compare its {len(run_ids)} latest jobs](#/compare-runs?runs={runs}&experiments={experiments})"
