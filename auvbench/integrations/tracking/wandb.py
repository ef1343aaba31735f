"""Log to Weights & Biases.

`WANDB_MODE=offline` needs no account; `WANDB_PROJECT` and `WANDB_DIR` set where the logs go.
"""

from __future__ import annotations

import io
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import wandb

from auvbench.errors import ConfigError

PROJECT = "auvbench"


def start(key: str, config: Mapping[str, Any], name: str) -> Run:
    """Open the logged run with this key; see `auvbench.tracking.start`."""
    return Run(_init(id=key, name=name, group=str(config["name"]), config=dict(config), resume="allow"))


class Run:
    """A logged run.

    Args:
        run: run as opened by the client.
    """

    def __init__(self, run: Any) -> None:
        self._run = run

    def write(self, scalars: Mapping[str, float], step: int) -> None:
        """Add scalars.

        A resumed run writes the steps since its last checkpoint again, with the same values. The client skips these
        repeated steps.
        """
        self._run.log(dict(scalars), step=step)

    def close(self, error: BaseException | None) -> None:
        self._run.finish(exit_code=0 if error is None else 1)


def table(name: str, csv: str, files: list[Path]) -> None:
    """Log a ranked table and files; see `auvbench.tracking.table`."""
    import pandas as pd

    run = _init(name=name, job_type="report")
    run.log({"ranking": wandb.Table(dataframe=pd.read_csv(io.StringIO(csv)))})
    report = wandb.Artifact("report", "report")
    for path in files:
        report.add_file(str(path), name=os.path.relpath(path, os.path.commonpath([p.parent for p in files])))
    run.log_artifact(report)
    run.finish()


def prepare(experiment: str) -> None:
    """Check the settings (`refuse_settings`); see `auvbench.tracking.prepare`."""
    refuse_settings()


def refuse_settings() -> None:
    """Reject a W&B settings file in the working directory: its settings could send the user's key to another server.

    Raises:
        ConfigError: the working directory has a W&B settings file; the message names the file.
    """
    for folder in ("wandb", ".wandb"):
        path = Path(folder, "settings")
        if "WANDB_DIR" not in os.environ and path.exists():
            raise ConfigError(
                f"{path}: W&B would take server and project from this folder; remove the file and set WANDB_BASE_URL, "
                "WANDB_PROJECT or WANDB_MODE instead"
            )


def _init(**arguments: Any) -> Any:
    refuse_settings()
    # The client would take over this process's output, which belongs in the run's own log.
    settings = wandb.Settings(console="off", silent=True, disable_git=True, disable_code=True)
    return wandb.init(project=os.environ.get("WANDB_PROJECT", PROJECT), settings=settings, **arguments)
