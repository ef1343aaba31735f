"""Define the specs of trackers. Importing this module imports no client."""

from __future__ import annotations

from auvbench.config.trackers import TrackerSpec

wandb = TrackerSpec("wandb", "auvbench.integrations.tracking.wandb", "wandb")
mlflow = TrackerSpec("mlflow", "auvbench.integrations.tracking.mlflow", "mlflow")
