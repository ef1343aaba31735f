"""From a composed configuration to a frozen run, everything checked before anything starts, and back again."""

from __future__ import annotations

from typing import Any

from omegaconf import DictConfig, OmegaConf

from auvbench.config import schema
from auvbench.config.compose import typed
from auvbench.config.validate import train_config
from auvbench.errors import ConfigError
from auvbench.runs import declared, identity, policy_files
from auvbench.runs.directory import RunDirectory, freeze, place
from auvbench.vehicles import pace, sheet
from auvbench.vehicles.inspect import shortest_time_constant
from auvbench.vehicles.vehicle_model import VehicleModel


def load_config(run: RunDirectory) -> schema.TrainConfig:
    """The typed configuration of a run directory, its identity checked.

    Raises:
        RunError: the directory is no run, or its configuration was changed.
        ConfigError: a value is out of range.
    """
    return typed(OmegaConf.create(run.check()))


def resolve_run(config: DictConfig) -> RunDirectory:
    """Checks types, values, the vehicle's sheet and a policy's file; returns where the run will lie. Writes nothing.

    Raises:
        ConfigError: a value is wrong.
        VehicleError: the sheet breaks a rule.
        PolicyError: the file of `algo=onnx` cannot be used.
    """
    return place(_plain(_settled(config)))


def check_vehicle(config: schema.TrainConfig) -> VehicleModel:
    """The vehicle, if its sheet is right and it is not too quick to be integrated.

    Raises:
        ConfigError, VehicleError: it is not.
    """
    vehicle = sheet.load(config.vehicle)
    pace.refuse_stiff_vehicle(vehicle.name, shortest_time_constant(vehicle))
    return vehicle


def prepare(config: DictConfig, command: str = "") -> RunDirectory:
    """`check`, then the run's directory on disk: from here on, editing YAML changes nothing.

    Raises:
        ConfigError, VehicleError, PolicyError: as `check`.
        RunError: the directory holds another configuration, or cannot be written.
        TrainingError: the disk is full or failing.
    """
    plain = _plain(_settled(config))
    # Before the manifest, which says that there is a run.
    policy_files.keep(place(plain), plain)
    return freeze(plain, command, _declared(config))


def _declared(config: DictConfig) -> declared.Declared | None:
    """Return the analysis that a composed configuration declares."""
    found: Any = OmegaConf.select(config, declared.KEY)
    return None if found is None else declared.Declared(**{key: found[key] for key in declared.DECLARED})


def _settled(config: DictConfig) -> DictConfig:
    typed = train_config(config)
    return policy_files.settled(config, typed, check_vehicle(typed))


def _plain(config: DictConfig) -> dict[str, object]:
    container = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    assert isinstance(container, dict)
    # The analysis is none of the run's: it lies next to the runs.
    plain = {str(key): value for key, value in container.items() if key != declared.KEY}
    if found := identity.first_interpolation(plain):  # from a value with \${ in it
        raise ConfigError(f"{found}: a run's configuration holds no ${{ }}")
    return plain
