"""What a run leaves in MLflow besides figures and metrics: its table, its models, the data it rests on, what the machine did.

With radartwin/runs/tracking.py, which opens the store, the only module that imports mlflow.
"""

from __future__ import annotations

import contextlib
import csv
import hashlib
import io
import json
import tempfile
import threading
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from radartwin import __version__
from radartwin.errors import BackendError
from radartwin.runs.commit import commit

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import DatasetInput, Metric

LOADER = "radartwin.recognize.pyfunc"  # the module that MLflow loads a run's models with
DIGEST_LENGTH = 32  # of a dataset; MLflow takes up to 36
BATCH = 1000  # metrics that MLflow takes in one call
SYSTEM = "system/"  # metrics of this prefix have a page of their own in MLflow
SYSTEM_METRICS = "MLFLOW_ENABLE_SYSTEM_METRICS_LOGGING"


@dataclass
class Record:
    """What a run leaves behind; whoever runs it fills this in.

    Attributes:
        rows: of its table.
        inputs: keys of the products that it rests on, by their kind.
    """

    run_id: str = ""
    metrics: Mapping[str, float] = field(default_factory=dict)
    artifacts: Sequence[Path] = ()
    rows: Sequence[Mapping[str, Any]] = ()
    inputs: Mapping[str, Sequence[str]] = field(default_factory=dict)


def tags(table: str, key: str) -> dict[str, str]:
    head, dirty = commit()
    return {"run_key": key, "table": table, "git_commit": head, "dirty": str(dirty).lower(), "radartwin": __version__}


def log_table(client: MlflowClient, run_id: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """The rows as table.csv, which MLflow's page of a run shows as a table."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(dict.fromkeys(column for row in rows for column in row)), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    client.log_text(run_id, text.getvalue(), "table.csv")


def log_models(client: MlflowClient, run_id: str, folder: Path) -> None:
    """Each folder in it as a python_function model, models/NAME of the run; its data is the folder, and nothing is pickled."""
    from mlflow import pyfunc

    for model in sorted(folder.iterdir()):
        with tempfile.TemporaryDirectory() as work, warnings.catch_warnings():
            warnings.filterwarnings("ignore", ".*Any type hint is inferred")  # of mlflow's own classes, when it is first imported
            made = Path(work) / model.name
            requirements = [f"radartwin=={__version__}"]
            pyfunc.save_model(str(made), loader_module=LOADER, data_path=str(model), pip_requirements=requirements)
            client.log_artifacts(run_id, str(made), f"{folder.name}/{model.name}")


def datasets(inputs: Mapping[str, Sequence[str]]) -> list[DatasetInput]:
    """A dataset per kind of product: its digest is the key of the only one, or that of all their keys."""
    from mlflow.entities import Dataset, DatasetInput

    found = []
    for kind, keys in sorted(inputs.items()):
        unique = sorted(set(keys))
        digest = unique[0] if len(unique) == 1 else hashlib.sha256(" ".join(unique).encode()).hexdigest()
        source = json.dumps({"uri": f"cache/{kind}"})
        profile = json.dumps({"products": len(unique)})
        found.append(DatasetInput(Dataset(kind, digest[:DIGEST_LENGTH], "local", source, profile=profile)))
    return found


@contextlib.contextmanager
def machine(run_id: str, uri: str) -> Iterator[list[Metric]]:
    """Processor, memory, disk, network and GPU during the `with`, where SYSTEM_METRICS is set as MLflow has it.

    The list grows as they are sampled and is logged by the caller: MLflow's own thread would write to the store at any time, and a SQLite
    that two write to at once fails. How often is MLFLOW_SYSTEM_METRICS_SAMPLING_INTERVAL, in seconds.

    Raises:
        BackendError: they are asked for without psutil.
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
        raise BackendError(f"{SYSTEM_METRICS} needs {error.name}: pip install 'radartwin[system-metrics]', or unset it") from error
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
    """Any number of them."""
    for first in range(0, len(metrics), BATCH):
        client.log_batch(run_id, metrics=metrics[first : first + BATCH])


def comparison(experiment_id: str, run_ids: Sequence[str]) -> str:
    """Description of a sweep's parent run, Markdown: a link to its jobs side by side, in the dashboard that shows it."""
    runs, experiments = (quote(json.dumps(ids, separators=(",", ":"))) for ids in (list(run_ids), [experiment_id]))
    return f"[Compare its {len(run_ids)} latest jobs](#/compare-runs?runs={runs}&experiments={experiments})"
