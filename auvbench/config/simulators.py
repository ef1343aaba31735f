"""Define the schemas of the `simulator` group, the spec of the embedded simulator, and the capabilities of
simulators.

A configuration that needs a capability which its simulator lacks is rejected before a run starts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from auvbench.config.disturbances import CURRENTS, needs
from auvbench.config.fields import choice_of, number
from auvbench.config.fields import name as plain_name
from auvbench.config.filters import Filter
from auvbench.config.schema import Disturbance
from auvbench.config.worlds import World
from auvbench.errors import ConfigError
from auvbench.registry import SIMULATORS, Spec


@dataclass(frozen=True, slots=True)
class Capabilities:
    """Capabilities of a simulator beyond moving vehicles."""

    exact_resume: bool
    """whether `load_state_dict` restores the exact state; otherwise a resumed run starts new episodes"""
    deterministic: bool
    """whether the same commands always give results with the same bits"""
    scales: bool
    """whether each vehicle may have its own factors: `reset(scales=...)`"""
    currents: str
    """most general kind of current that `set_current` takes, one of `CURRENTS`"""
    waves: bool = False
    """whether the simulator has `set_waves`"""
    vehicles: bool = False
    """whether the simulator has `set_vehicles`"""
    forces: bool = False
    """whether the simulator has `current` and `external_wrench` (`simulators.base.VehicleBatch`)"""
    solids: bool = False
    """whether the simulator's vehicles may be in a world with a bottom or obstacles"""
    teams: bool = False
    """whether an episode may have several of the simulator's vehicles"""


@dataclass(kw_only=True)
class Simulator:
    """Key of every `simulator/*.yaml`."""

    name: str = choice_of(lambda: SIMULATORS.own)

    def limited(self, capabilities: Capabilities) -> Capabilities:
        """Return the capabilities that the simulator has with the options of this configuration."""
        return capabilities


@dataclass(kw_only=True)
class Fossen(Simulator):
    """The embedded simulator."""

    max_step: float = number(0.0, 1.0, open_low=True)  # s
    threads: int = number(1, 256)


@dataclass(kw_only=True)
class SimulatorConfig(Simulator):
    """The `simulator` configuration of an installed package; a subclass adds its own keys."""

    name: str = plain_name()
    package: str


@dataclass(frozen=True, slots=True)
class SimulatorSpec(Spec):
    """Description of one value of `simulator.name`, available without importing its code."""

    base: ClassVar[type] = SimulatorConfig

    name: str
    """Value of `simulator.name`."""
    factory: str
    """`module:callable` that returns a `simulators.base.Simulator`. Its arguments are the configuration (an instance of
    `schema`), a `VehicleModel`, the number of vehicles and the longest stable substep in s.
    """
    capabilities: Capabilities
    """Capabilities of the simulator with the option `full`."""
    schema: type = SimulatorConfig
    """Keys of `simulator` with their types and ranges; in a package, derived from `SimulatorConfig`."""
    full: str = ""
    """Option, as `key=value`, with which the simulator has all capabilities; empty if no option limits them (`Simulator.limited`)."""
    check: str = ""
    """`module:function` that takes the simulator's configuration and the vehicle. It is called before a run is created, and
    raises an error if the simulator cannot simulate the vehicle.
    """
    served: str = ""
    """`module:class` if the vehicles are on a server, which only one test at a time can use. The class has two functions:
    `vehicles(configuration, vehicle)` returns the number of vehicles, and `clock()` returns the name of the clock that
    counted the steps of the last test.
    """

    def fault(self) -> str:
        able = isinstance(self.capabilities, Capabilities) and self.capabilities.currents in CURRENTS
        return (
            ""
            if able
            else "has invalid capabilities; must be auvbench.plugin.Capabilities with one of the known currents"
        )


fossen = SimulatorSpec(
    "fossen",
    "auvbench.simulators.fossen:make",
    Capabilities(
        exact_resume=True,
        deterministic=True,
        scales=True,
        currents="sheared",
        waves=True,
        vehicles=True,
        forces=True,
        solids=True,
        teams=True,
    ),
    Fossen,
)


def capabilities(simulator: Simulator) -> Capabilities:
    """Return a simulator's capabilities with its present options."""
    return simulator.limited(SIMULATORS[simulator.name].capabilities)


def is_served(simulator: Simulator) -> bool:
    """Return whether a simulator's vehicles are on a server."""
    return bool(SIMULATORS[simulator.name].served)


def threads(simulator: Any) -> int:
    """Return the number of threads for a batch; 1 if the simulator has no such key."""
    return int(getattr(simulator, "threads", 1))


def check_world(simulator: Simulator, world: World) -> None:
    """Raise ConfigError if the world has solids and the simulator cannot simulate them."""
    if world.solid and not capabilities(simulator).solids:
        able = [f"simulator={name}" for name, spec in SIMULATORS.items() if spec.capabilities.solids]
        raise ConfigError(
            f"world={world.name}: simulator={simulator.name} has no bottom and no obstacles; use {' or '.join(able)}, or world=open"
        )


def check_filter(simulator: Simulator, chosen: Filter) -> None:
    """Raise ConfigError for a command filter with a simulator that cannot simulate solids: the filter needs a map of the solids."""
    if chosen.acts and not capabilities(simulator).solids:
        able = [f"simulator={name}" for name, spec in SIMULATORS.items() if spec.capabilities.solids]
        raise ConfigError(
            f"filter={chosen.name}: not available with simulator={simulator.name}; use {' or '.join(able)}, or filter=none"
        )


def check_disturbance(simulator: Simulator, disturbance: Disturbance) -> None:
    """Raise ConfigError for a disturbance that needs a capability which the simulator lacks.

    Raises:
        ConfigError: the message names the key, and the simulators that have the capability.
    """
    for need in needs(disturbance):
        if need.able(capabilities(simulator)):
            continue
        spec_here = SIMULATORS[simulator.name]
        own = [spec_here.full] if spec_here.full and need.able(spec_here.capabilities) else []
        alternatives = [
            f"simulator={name}"
            for name, spec in SIMULATORS.items()
            if need.able(spec.capabilities) and name != simulator.name
        ]
        raise ConfigError(
            f"{need.key}: needs {need.what}, which simulator={simulator.name} does not have as configured; "
            f"use {' or '.join(own + alternatives)}"
        )
