"""Serve MLflow's pages and the page /start, which lists the experiments (`python -m radartwin.runs.start_page STORE ARTIFACTS HOST PORT`).

In a new browser, MLflow shows an experiment as traces of a language model, without its runs. The start page therefore stores the settings
of MLflow's pages in the browser: the workflow of model training, a closed assistant, and the columns of each experiment's table of runs.
"""

from __future__ import annotations

import os
import sys
import time
from collections import Counter
from collections.abc import Sequence
from importlib import resources
from typing import TYPE_CHECKING, Any

from radartwin.runs.tracking import DESCRIPTION, PARENT

if TYPE_CHECKING:
    from mlflow.entities import Run

START = "/start"
METRICS = 3  # number of metrics in the table of runs
NEWEST = 1000  # number of runs per experiment whose options and metrics are read


def serve(store: str, artifacts: str, host: str, port: int) -> None:
    """Serve until a signal ends the server. `mlflow server` starts MLflow's application in the same way, but without further pages."""
    import uvicorn  # MLflow must find uvicorn in sys.modules, or it does not check the hosts of requests
    from mlflow.server import constants
    from starlette.responses import HTMLResponse
    from starlette.routing import Route

    os.environ[constants.BACKEND_STORE_URI_ENV_VAR] = os.environ[constants.REGISTRY_STORE_URI_ENV_VAR] = store
    os.environ[constants.ARTIFACT_ROOT_ENV_VAR] = "mlflow-artifacts:/"
    os.environ[constants.ARTIFACTS_DESTINATION_ENV_VAR] = artifacts
    os.environ[constants.SERVE_ARTIFACTS_ENV_VAR] = "true"
    from mlflow.server.fastapi_app import app

    app.router.routes.insert(0, Route(START, lambda _: HTMLResponse(start_page(store))))  # MLflow's last route takes all other addresses
    uvicorn.run(app, host=host, port=port, log_level="warning")


def start_page(store: str) -> str:
    """Return the HTML page that lists the experiments that have runs, newest first."""
    import jinja2
    from mlflow import MlflowClient

    client = MlflowClient(store)
    experiments = []
    for experiment in client.search_experiments():
        if runs := client.search_runs([experiment.experiment_id], max_results=NEWEST):
            started = max(run.info.start_time for run in runs)
            described = {
                "id": experiment.experiment_id, "name": experiment.name, "text": experiment.tags.get(DESCRIPTION, ""),
                "runs": f"{len(runs)}{'+' if len(runs) == NEWEST else ''}", "columns": columns(runs),
                "parents": sorted({run.data.tags[PARENT] for run in runs if PARENT in run.data.tags}),
                "started": time.strftime("%Y-%m-%d %H:%M", time.localtime(started / 1000)),
            }  # fmt: skip
            experiments.append((started, described))
    template = (resources.files("radartwin.runs") / "start_page.html").read_text(encoding="utf-8")
    newest_first = [described for _, described in sorted(experiments, key=lambda pair: -pair[0])]
    return jinja2.Environment(autoescape=True).from_string(template).render(experiments=newest_first)


def columns(runs: Sequence[Run]) -> list[str]:
    """Return MLflow's names of the columns to show: the options that differ between the runs, and the metrics that most runs have."""
    jobs = [run for run in runs if run.data.params or run.data.metrics]  # the parent run of a sweep has neither
    options = dict.fromkeys(key for run in jobs for key in run.data.params)
    swept = [key for key in options if len({run.data.params.get(key) for run in jobs}) > 1]
    counts: Counter[str] = Counter(key for run in jobs for key in run.data.metrics if not key.startswith("system/"))
    return [_column("params", key) for key in swept] + [_column("metrics", key) for key, _ in counts.most_common(METRICS)]


def _column(kind: str, key: str) -> str:
    return f"{kind}.`{key}`"


def _main(store: str, artifacts: str, host: str, port: Any) -> None:
    serve(store, artifacts, host, int(port))


if __name__ == "__main__":
    _main(*sys.argv[1:])
