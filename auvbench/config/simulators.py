"""The schemas of the `simulator` group, and the capabilities of simulators.

A configuration that asks for more than a simulator can is refused before anything starts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from auvbench.config.schema import SCALES, Current, Disturbance, Scale, choice, number
from auvbench.errors import ConfigError

CURRENTS = ("none", "steady", "varying", "sheared")
"""Kinds of current, each including those before it: steady in an episode, varying in it, and changing with depth."""


@dataclass(frozen=True, slots=True)
class Capabilities:
    """Capabilities of a simulator beyond moving vehicles."""

    exact_resume: bool
    """`state_dict` restores the exact state; otherwise a resumed run begins its episodes in flight again"""
    deterministic: bool
    """the same commands give the same bits"""
    scales: bool
    """each vehicle may have numbers of its own: `reset(scales=...)`"""
    currents: str
    """the most that `set_current` takes, one of `CURRENTS`"""
    waves: bool = False
    """it has `set_waves`"""


CAPABILITIES: dict[str, Capabilities] = {
    "fossen": Capabilities(
        exact_resume=True, deterministic=True, scales=True, currents="sheared", waves=True
    ),
    "gazebo": Capabilities(exact_resume=False, deterministic=True, scales=True, currents="sheared"),
    "ros2": Capabilities(exact_resume=False, deterministic=True, scales=True, currents="sheared"),
}


@dataclass(kw_only=True)
class Simulator:
    """The key of every `simulator/*.yaml`."""

    name: str = choice(*CAPABILITIES)


@dataclass(kw_only=True)
class Fossen(Simulator):
    """The embedded simulator."""

    max_step: float = number(0.0, 1.0, open_low=True)  # s
    threads: int = number(1, 256)


@dataclass(kw_only=True)
class Gazebo(Simulator):
    """Gazebo Harmonic in this process."""

    max_step: float = number(0.0, 1.0, open_low=True)  # s
    hydrodynamics: str = choice("corrected", "published")


@dataclass(kw_only=True)
class Ros2(Simulator):
    """A server of the interface over ROS 2."""

    namespace: str | None
    clock: str = choice("auto", "lockstep", "clock", "wall")
    timeout: float = number(0.0, 1e4, open_low=True)  # s


SCHEMAS: dict[str, type] = {
    "fossen": Fossen,
    "gazebo": Gazebo,
    "ros2": Ros2,
}


def capabilities(simulator: Simulator) -> Capabilities:
    """Return a simulator's capabilities with its present options."""
    can = CAPABILITIES[simulator.name]
    if isinstance(simulator, Gazebo) and simulator.hydrodynamics == "published":
        return replace(can, currents="steady")  # the plugin takes a current when a vehicle is made
    if isinstance(simulator, Ros2) and simulator.clock != "lockstep":
        # The server is unknown, and messages arrive late.
        return replace(can, deterministic=False, scales=False, currents="steady")
    return can


def threads(simulator: Any) -> int:
    """Return the threads that a batch may use: more than one on the embedded simulator only."""
    return simulator.threads if isinstance(simulator, Fossen) else 1


_FULL = {"gazebo": "simulator.hydrodynamics=corrected", "ros2": "simulator.clock=lockstep"}
"""By simulator: the option that gives it all of its CAPABILITIES."""


def check_disturbance(simulator: Simulator, disturbance: Disturbance) -> None:
    """Refuse a disturbance that is beyond the simulator.

    Raises:
        ConfigError: names the key that asks too much, and what can do it.
    """

    def need(key: str, what: str, able: Callable[[Capabilities], bool]) -> None:
        if able(capabilities(simulator)):
            return
        own = (
            [_FULL[simulator.name]] if simulator.name in _FULL and able(CAPABILITIES[simulator.name]) else []
        )
        others = [
            f"simulator={name}" for name, can in CAPABILITIES.items() if able(can) and name != simulator.name
        ]
        raise ConfigError(
            f"{key}: asks for {what}, which simulator={simulator.name} does not have here; use {' or '.join(own + others)}"
        )

    key, current = _current(disturbance.current)
    need(key, f"a {current} current", lambda can: CURRENTS.index(can.currents) >= CURRENTS.index(current))
    if disturbance.sea is not None:
        need(f"disturbance.waves.height={disturbance.sea.height:g}", "waves", lambda can: can.waves)
    for part in SCALES:
        scale: Scale = getattr(disturbance.randomisation, part)
        if scale.low != 1.0 or scale.high != 1.0:
            need(
                f"disturbance.randomisation.{part}",
                "vehicles with numbers of their own",
                lambda can: can.scales,
            )


def _current(current: Current) -> tuple[str, str]:
    """Return the key that asks most of the current, and the kind of current."""
    speed, fluctuation, profile = current.speed_high or current.speed, current.gauss_markov, current.profile
    varies = fluctuation.sigma > 0.0 or fluctuation.sigma_vertical > 0.0
    if (speed > 0.0 or varies) and (profile.factor != 1.0 or profile.turn != 0.0):
        return "disturbance.current.profile", "sheared"
    if varies:
        return "disturbance.current.gauss_markov", "varying"
    return "disturbance.current.speed", "steady" if speed > 0.0 else "none"
