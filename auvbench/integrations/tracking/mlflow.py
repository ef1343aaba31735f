"""Log to MLflow. `MLFLOW_TRACKING_URI` names a server or a database; default: `mlflow.db` in the current folder."""

from __future__ import annotations

import io
import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mlflow.entities import Metric, Param
from mlflow.tracking import MlflowClient

KEY = "auvbench.key"
PARAMETERS = ("task", "vehicle", "algo", "reward.k", "step.frequency", "seed", "train.total_steps")
"""configuration keys that become MLflow parameters of a logged run; the run's config.yaml has all keys"""


def start(key: str, config: Mapping[str, Any], name: str) -> Run:
    """Open the logged run with this key; see `auvbench.tracking.start`."""
    client = MlflowClient()
    place = experiment_of(str(config["name"]))
    runs = client.search_runs([place], filter_string=f"tags.`{KEY}` = '{key}'")
    if runs:
        run = runs[0].info.run_id
        client.update_run(run, status="RUNNING")
    else:
        run = client.create_run(place, tags={KEY: key}, run_name=name).info.run_id
        client.log_batch(run, params=[Param(name, _value(config, name)) for name in PARAMETERS])
        client.log_dict(run, dict(config), "config.yaml")
    return Run(client, run)


def prepare(experiment: str) -> None:
    """Create the experiment; see `auvbench.tracking.prepare`."""
    experiment_of(experiment)


def experiment_of(name: str) -> str:
    """Return the id of an experiment; create it if it does not exist."""
    client = MlflowClient()
    experiment = client.get_experiment_by_name(name)
    return str(experiment.experiment_id if experiment else client.create_experiment(name))


class Run:
    """A logged run.

    Args:
        client: client of the server or database.
        run: MLflow's id of the run.
    """

    def __init__(self, client: MlflowClient, run: str) -> None:
        self._client, self._run = client, run

    def write(self, scalars: Mapping[str, float], step: int) -> None:
        now = round(time.time() * 1000)
        metrics = [Metric(name, value, now, step) for name, value in scalars.items()]
        self._client.log_batch(self._run, metrics=metrics)

    def close(self, error: BaseException | None) -> None:
        ended = "KILLED" if isinstance(error, KeyboardInterrupt) else "FAILED" if error else "FINISHED"
        self._client.set_terminated(self._run, ended)


def table(name: str, csv: str, files: list[Path]) -> None:
    """Log a ranked table and files; see `auvbench.tracking.table`."""
    import pandas as pd

    client = MlflowClient()
    run = client.create_run(experiment_of("reports"), run_name=name).info.run_id
    client.log_table(run, pd.read_csv(io.StringIO(csv)), "ranking.json")
    root = os.path.commonpath([path.parent for path in files])
    for path in files:
        folder = os.path.relpath(path.parent, root)
        client.log_artifact(run, str(path), None if folder == "." else folder)
    client.set_terminated(run)


def _value(config: Mapping[str, Any], key: str) -> str:
    value: Any = config
    for part in key.split("."):
        value = value[part]
    return str(value["name"] if isinstance(value, Mapping) else value)
