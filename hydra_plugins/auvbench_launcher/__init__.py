"""Hydra's side of a grid: which jobs there are (`Grids`), and composing them all (`Compose`).

Nothing is started here. Each composed configuration is handed to the task function, which collects them; the
command then validates and freezes all of them before `auvbench.scheduling` starts the first.

Hydra's scan for plugins does not see editable installations, so `register` has to be called before Hydra runs;
the scan of an ordinary installation, which does see it, finds the same classes.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.core.config_store import ConfigStore
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.core.plugins import Plugins
from hydra.core.utils import JobReturn, JobStatus
from hydra.plugins.launcher import Launcher
from hydra.plugins.sweeper import Sweeper
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig, OmegaConf, open_dict

from auvbench.errors import ConfigError
from hydra_plugins.auvbench_launcher import grids


@dataclass
class ComposeConf:
    """hydra/launcher=auvbench; where and how jobs are carried out is auvbench's own group `launcher`."""

    _target_: str = "hydra_plugins.auvbench_launcher.Compose"


@dataclass
class GridsConf:
    """hydra/sweeper=auvbench."""

    _target_: str = "hydra_plugins.auvbench_launcher.Grids"
    params: dict[str, Any] | None = None  # as in Hydra's own sweeper: axes that apply to every grid
    grids: list[Any] = field(default_factory=list)  # see grids.py


class Compose(Launcher):
    """Composes every job and hands each to the task function."""

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        self.hydra_context = hydra_context
        self.task_function = task_function
        self.config = config

    def launch(self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int) -> Sequence[JobReturn]:
        # All of them before the first is handed over: a mistake in the last one is found before anything happens.
        composed = self.compose(job_overrides)
        returns = []
        for overrides, config in zip(job_overrides, composed, strict=True):
            done = JobReturn(overrides=list(overrides), cfg=config, status=JobStatus.COMPLETED)
            done.return_value = self.task_function(config)
            returns.append(done)
        return returns

    def compose(self, jobs: Sequence[Sequence[str]]) -> list[DictConfig]:
        """The configuration of each job.

        Hydra composes once for each choice of files; jobs that differ in values alone, as seeds do, share that,
        and their values are then set by the same function that Hydra itself would call next.
        """
        parser = OverridesParser.create(config_loader=self.hydra_context.config_loader)
        bases: dict[tuple[str, ...], DictConfig] = {}
        composed = []
        for job in jobs:
            overrides = parser.parse_overrides(list(job))
            values = [override for override in overrides if self._sets_a_value(override)]
            choices = tuple(
                line for line, override in zip(job, overrides, strict=True) if override not in values
            )
            if choices not in bases:
                bases[choices] = self._choose(choices)
            config = copy.deepcopy(bases[choices])
            ConfigLoaderImpl._apply_overrides_to_config(values, config)
            composed.append(config)
        return composed

    def _sets_a_value(self, override: Override) -> bool:
        """Whether an override is one that Hydra applies after composing."""
        if isinstance(override.value(), dict) or override.package is not None or override.is_hydra_override():
            return False
        loader = self.hydra_context.config_loader
        assert isinstance(loader, ConfigLoaderImpl)
        return not loader.repository.group_exists(override.key_or_group)

    def _choose(self, choices: Sequence[str]) -> DictConfig:
        config = self.hydra_context.config_loader.load_sweep_config(self.config, list(choices))
        held = OmegaConf.select(config, "hydra.sweeper.grids")
        if held != OmegaConf.select(self.config, "hydra.sweeper.grids"):
            raise ConfigError(f"{' '.join(choices)}: an experiment with grids is swept alone, one at a time")
        with open_dict(config):
            del config["hydra"]
        return config


class Grids(Sweeper):
    """Makes the jobs: Hydra's products of comma lists, and unions of grids that an experiment holds."""

    def __init__(self, params: dict[str, Any] | None = None, grids: Sequence[Any] = ()) -> None:
        super().__init__()
        self.params = params or {}
        self.grids = grids

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        self.hydra_context = hydra_context
        self.config = config
        self.launcher = Plugins.instance().instantiate_launcher(
            hydra_context=hydra_context, task_function=task_function, config=config
        )

    def sweep(self, arguments: list[str]) -> Sequence[JobReturn]:
        assert self.launcher is not None
        jobs = self.jobs(arguments)
        if not jobs:
            raise ConfigError(f"{' '.join(arguments)}: leaves no job of the experiment's grids")
        return self.launcher.launch(jobs, initial_job_idx=0)

    def jobs(self, arguments: Sequence[str]) -> list[list[str]]:
        """The overrides of each job."""
        assert self.hydra_context is not None
        parser = OverridesParser.create(config_loader=self.hydra_context.config_loader)
        shared = grids.from_config(parser, [self.params])[0]
        union = [{**shared, **grid} for grid in grids.from_config(parser, self.grids)]
        typed = grids.axes(parser, arguments)
        if not union:
            return grids.jobs([{**shared, **typed}])
        return grids.jobs(grids.narrow(union, typed))


def store() -> None:
    """Stores what `hydra/launcher=auvbench` and `hydra/sweeper=auvbench` name; enough to compose."""
    repository = ConfigStore.instance()
    repository.store(group="hydra/launcher", name="auvbench", node=ComposeConf, provider="auvbench")
    repository.store(group="hydra/sweeper", name="auvbench", node=GridsConf, provider="auvbench")


def register() -> None:
    """Makes both known to Hydra, so that it can run them."""
    store()
    for plugin in (Compose, Grids):
        Plugins.instance().register(plugin)
