"""From a composed configuration to a frozen run, everything checked before anything starts, and back again."""

from __future__ import annotations

from omegaconf import DictConfig, OmegaConf

from auvbench.config import schema
from auvbench.config.compose import typed
from auvbench.config.validate import train_config
from auvbench.errors import ConfigError
from auvbench.runs import interpolations
from auvbench.runs.directory import RunDirectory, freeze, place
from auvbench.vehicles import pace, sheet
from auvbench.vehicles.inspect import shortest_time_constant


def load_config(run: RunDirectory) -> schema.TrainConfig:
    """The typed configuration of a run directory, its identity checked.

    Raises:
        RunError: the directory is no run, or its configuration was changed.
        ConfigError: a value is out of range.
    """
    return typed(OmegaConf.create(run.check()))


def check(config: DictConfig) -> RunDirectory:
    """Checks types, values and the vehicle's sheet; returns where the run will lie. Writes nothing.

    Raises:
        ConfigError: a value is wrong.
        VehicleError: the sheet breaks a rule.
    """
    vehicle = sheet.load(train_config(config).vehicle)
    pace.check(vehicle.name, shortest_time_constant(vehicle))
    return place(_plain(config))


def prepare(config: DictConfig, command: str = "") -> RunDirectory:
    """`check`, then the run's directory on disk: from here on, editing YAML changes nothing.

    Raises:
        ConfigError, VehicleError: as `check`.
        RunError: the directory holds another configuration, or cannot be written.
    """
    check(config)
    return freeze(_plain(config), command)


def _plain(config: DictConfig) -> dict[str, object]:
    container = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    assert isinstance(container, dict)
    plain = {str(key): value for key, value in container.items()}
    if found := interpolations.first(plain):  # from a value with \${ in it
        raise ConfigError(f"{found}: a run's configuration holds no ${{ }}")
    return plain
