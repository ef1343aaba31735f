"""From composed configurations to carried-out runs: all checked, then all frozen, then the first started."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from auvbench.config import launchers
from auvbench.config.agents import learns
from auvbench.config.validate import train_config
from auvbench.errors import ConfigError
from auvbench.runs import plan
from auvbench.runs.directory import RunDirectory
from auvbench.scheduling.base import Backend
from auvbench.scheduling.loop import Result
from auvbench.scheduling.sweep import sweep
from auvbench.training import preflight
from auvbench.training.worker import TARGET


def carry_out(
    configs: Sequence[DictConfig], command: str = "", *, target: str = TARGET, console: Console | None = None
) -> Result:
    """Brings the runs of a grid to their end; `Result.exit_code` is the command's.

    Args:
        configs: a configuration per job, composed; jobs that resolve to the same run are one.
        command: the command line, for the manifests.
        target: what a worker calls with a run directory, as module:function.
        console: where the tables go; standard output by default.

    Raises:
        ConfigError, VehicleError, MissingExtraError: a job cannot run; nothing has been written then.
        RunError: a run's directory holds another configuration, or cannot be written.
    """
    distinct: dict[Path, DictConfig] = {}
    for config in configs:
        distinct.setdefault(plan.resolve_run(config).path, config)
    for config in distinct.values():
        preflight.check_runnable(train_config(config))
    learning = any(learns(config.algo) for config in distinct.values())
    chosen = backend(configs[0].launcher, target=target, learning=learning)
    if any(config.launcher != configs[0].launcher for config in configs):
        raise ConfigError("launcher: a grid has one launcher; it cannot be an axis")
    runs: list[RunDirectory] = [plan.prepare(config, command) for config in distinct.values()]
    return sweep(runs, chosen, console)


def backend(launcher: DictConfig, *, target: str = TARGET, learning: bool = True) -> Backend:
    """Return the backend that a `launcher` configuration names.

    Args:
        launcher: the composed `launcher` group.
        target: what a worker calls with a run directory, as module:function.
        learning: whether any of the runs learns; otherwise torch is not imported.

    Raises:
        UserError: it cannot work on this machine.
    """
    options = OmegaConf.to_object(launcher)
    # Imported when chosen: each backend has needs of its own.
    if isinstance(options, launchers.Slurm):
        from auvbench.scheduling.slurm import SlurmBackend

        return SlurmBackend(options, target=target)
    if isinstance(options, launchers.Ray):
        from auvbench.scheduling.ray import RayBackend

        return RayBackend(options, target=target)
    if isinstance(options, launchers.Local):
        from auvbench.scheduling.local import CONTROLLERS, LEARNERS, LocalBackend

        return LocalBackend(options.workers, target=target, preload=LEARNERS if learning else CONTROLLERS)
    raise ConfigError("launcher: its file must start from a schema (see conf/launcher)")
