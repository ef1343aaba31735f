"""`auvbench simulate`: simulate one vehicle open loop, and write a CSV file or a plot."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from auvbench.errors import ConfigError, closest
from auvbench.runs.atomic_io import check_writable

if TYPE_CHECKING:
    from omegaconf import DictConfig

    from auvbench.vehicles.vehicle_model import VehicleModel

PICTURES = (".png", ".svg", ".pdf")


def main(arguments: Sequence[str]) -> int:
    from auvbench.config.compose import read
    from auvbench.grammar import read_named_sheets

    read_named_sheets(arguments)
    request = read("simulate", arguments)
    if request is not None:
        simulate(request.configs[0])
    return 0


def simulate(config: DictConfig) -> None:
    """Simulate a vehicle with the settings in `config`; write the files and print their paths."""
    import numpy as np

    from auvbench.config.simulation import simulation_config
    from auvbench.simulators import openloop
    from auvbench.vehicles import sheet

    settings = simulation_config(config)
    if settings.plot is not None and Path(settings.plot).suffix.lower() not in PICTURES:
        raise ConfigError(f"plot={settings.plot}: must end with one of {', '.join(PICTURES)}")
    for key, file in (("output", settings.output), ("plot", settings.plot)):
        if file is not None:
            check_writable(Path(file), f"{key}={file}")  # raises an error before anything is computed
    vehicle = sheet.load(settings.vehicle)
    inputs = settings.input
    command = _command(vehicle, inputs.command)
    if settings.thrusters == "off":
        if inputs.command is not None and np.any(command):
            raise ConfigError(
                "input.command: thrusters=off leaves no thruster to command; leave one of these two keys out"
            )
        vehicle, command = openloop.without_actuators(vehicle), np.zeros(0)
    trajectory = openloop.integrate(
        vehicle,
        duration=settings.duration,
        sample=settings.sample,
        wrench=np.array(inputs.wrench),
        command=command,
        pose=np.array(inputs.pose),
        velocity=np.array(inputs.velocity),
        current=np.array(inputs.current),
        frame=inputs.frame,
        max_step=settings.max_step,
    )
    if settings.output is None and settings.plot is None:
        sys.stdout.write(trajectory.csv())
    if settings.output is not None:
        openloop.write(trajectory, Path(settings.output))
        print(f"{len(trajectory.time)} rows: {settings.output}")
    if settings.plot is not None:
        openloop.draw(trajectory, Path(settings.plot), title=vehicle.title)
        print(f"plot: {settings.plot}")


def _command(vehicle: VehicleModel, command: Any) -> Any:
    """Return the commands (n_u,) from a list, or from a mapping of actuator names to commands; None means zeros.

    Raises:
        ConfigError: a wrong number of commands, an unknown actuator, or a command outside [-1, 1].
    """
    import numpy as np

    names = vehicle.actuators
    if command is None:
        return np.zeros(len(names))
    if isinstance(command, Mapping):
        unknown = [str(name) for name in command if name not in names]
        if unknown:
            raise ConfigError(
                f"input.command.{unknown[0]}: {vehicle.name} has no such actuator; {closest(unknown[0], names)}"
            )
        values = [command.get(name, 0.0) for name in names]
    elif isinstance(command, list | tuple):
        values = list(command)
        if len(values) != len(names):
            raise ConfigError(
                f"input.command={values}: has {len(values)} numbers, {vehicle.name} has {len(names)}"
                f" actuators: {', '.join(names)}"
            )
    else:
        raise ConfigError(f"input.command={command}: must be a list of numbers or {{actuator: number}}")
    for name, value in zip(names, values, strict=True):
        if isinstance(value, bool) or not isinstance(value, int | float) or not -1.0 <= value <= 1.0:
            raise ConfigError(f"input.command: {name} is {value}: must be a number in [-1, 1]")
    return np.array(values, dtype=np.float64)
