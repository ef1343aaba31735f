"""Check a composed configuration and write it to disk as a frozen run; load the configuration of an existing run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from auvbench.config import schema
from auvbench.config.algorithms.onnx import ONNX
from auvbench.config.compose import once_for_all_seeds, typed
from auvbench.config.validate import resolved, train_config
from auvbench.errors import ConfigError
from auvbench.registry import AGENTS, WORLDS, resolve
from auvbench.runs import declared, declaring, identity
from auvbench.runs.directory import RunDirectory, freeze, now, place, unwritable
from auvbench.vehicles import sheet
from auvbench.vehicles.inspect import shortest_time_constant
from auvbench.vehicles.vehicle_model import VehicleModel


def load_config(run: RunDirectory) -> schema.TrainConfig:
    """Return the typed configuration of a run directory, after checking it against the run's id.

    Raises:
        RunError: the directory is not a run, or its configuration was changed.
        ConfigError: a value is out of range.
    """
    values = run.check()
    return once_for_all_seeds(
        "run", values, lambda: typed(OmegaConf.create(values)), lambda config, own: replace(config, **own)
    )


@dataclass(frozen=True, slots=True)
class Plan:
    """A run after all checks that are possible before it is written to disk."""

    config: schema.TrainConfig
    values: dict[str, Any]
    """all values, as `config.yaml` will contain them"""

    @property
    def run(self) -> RunDirectory:
        """Return the run's future directory."""
        return place(self.values)

    def freeze(self, command: str = "") -> RunDirectory:
        """Create the run's directory; later changes of YAML files have no effect on the run.

        Raises:
            RunError: the directory has a different configuration, or cannot be written.
            PolicyError: the file of `algo=onnx` was changed after the check.
            TrainingError: the disk is full or failing.
        """
        return freeze_all([self], command)[0]


def freeze_all(plans: Sequence[Plan], command: str = "") -> list[RunDirectory]:
    """Declare the runs of an experiment, then create their directories; return them in the order of the
    plans.

    Raises:
        ConfigError: an analysis names an unknown protocol or condition; nothing was written.
        RunError, PolicyError, TrainingError: see `Plan.freeze`.
    """
    digests = _declare(plans)
    runs = []
    for item in plans:
        # Copy the policy file before `freeze` writes the manifest: each run with a manifest must have its policy file.
        if item.values["algo"].get("agent") == "onnx":
            from auvbench.runs import policy_file

            policy_file.keep(item.run, item.values)
        runs.append(freeze(item.values, command, digests.get(item.run.path)))
    return runs


def _declare(plans: Sequence[Plan]) -> dict[Path, str]:
    """Declare the runs that have an analysis; return the digests for their manifests."""
    completed: dict[str, declared.Declared] = {}
    analyses: dict[Path, declared.Declared] = {}
    for item in plans:
        if (analysis := item.config.analysis) is not None:
            if (key := repr(analysis)) not in completed:
                completed[key] = declaring.completed(analysis)
            analyses[item.run.path] = completed[key]
    configs = {item.run.path: item.values for item in plans}
    try:
        return declaring.declare_all(analyses, configs, now())
    except OSError as error:
        raise unwritable(next(iter(analyses)).parent, error) from error


def plan(config: DictConfig) -> Plan:
    """Check types, values, the vehicle's sheet and the files of a composed configuration. Write nothing.

    Raises:
        ConfigError: a value is wrong.
        VehicleError: the sheet breaks a rule.
        PolicyError: the file of `algo=onnx` cannot be used.
    """
    checked = train_config(config)
    vehicle = check_vehicle(checked)
    if isinstance(checked.algo, ONNX):
        from auvbench.runs import policy_file

        config = policy_file.with_policy(config, checked, checked.algo, vehicle)
    elif checked.algo.agent in AGENTS.own and (settled := AGENTS[checked.algo.agent].settled):
        config = resolve(settled)(config, checked.algo)
    if settled := WORLDS[checked.world.name].settled:
        config = resolve(settled)(config, checked.world)
    values = resolved(config)
    values.pop(declared.KEY, None)  # the analysis belongs to the experiment's folder
    if interpolation := identity.first_interpolation(values):  # An escaped \${ in a value becomes ${.
        raise ConfigError(f"{interpolation}: a run's configuration must not contain ${{ }}")
    return Plan(checked, values)


def prepare(config: DictConfig, command: str = "") -> RunDirectory:
    """Plan a run, then write it to the disk.

    Raises:
        ConfigError, VehicleError, PolicyError, RunError, TrainingError: see `plan` and `Plan.freeze`.
    """
    return plan(config).freeze(command)


def check_vehicle(config: schema.TrainConfig) -> VehicleModel:
    """Return the vehicle after two checks: its sheet is valid, and its dynamics are slow enough to integrate.

    Raises:
        ConfigError, VehicleError: a check fails.
    """
    vehicle = sheet.load(config.vehicle)
    sheet.refuse_stiff_vehicle(vehicle.name, shortest_time_constant(vehicle))
    return vehicle
