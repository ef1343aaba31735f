"""Define the base classes of the schemas in the `algo` group, and the spec of an agent.

Each of auvbench's own agents, or each family of agents, has one module here with schemas and specs (`AgentSpec`). Importing
a module of this package imports no code of an agent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from auvbench.config.fields import later
from auvbench.config.schema import choice, choice_of, name, number
from auvbench.config.schema import name as plain_name
from auvbench.registry import AGENTS, Declared, Spec, schema_fault


@dataclass(kw_only=True)
class Tuned:
    """Search that chose the values of a preset; `auvbench tune` writes these keys, and reports read them."""

    study: str = name()
    protocol: str = name()
    scenarios: str = choice("validation")
    seed: int = number(0, (1 << 32) - 1)  # seed of the protocol's scenarios
    trials: int = number(1, 1 << 31)
    steps: int = number(0, 1 << 62)  # environment steps of training over all trials
    cpu_s: float | None = later(number(0.0, 1e12))  # s, processor time of all trials, including their tests
    version: str
    date: str


@dataclass(kw_only=True)
class Algorithm:
    """Keys of every `algo/*.yaml`: the agent's name and its number of environments."""

    name: str = name()
    agent: str = choice_of(lambda: AGENTS.own)
    n_envs: int = number(1, 65_536)
    tuned: Tuned | None = None  # search that chose the values

    def check(self) -> None:
        """Refuse values that contradict each other.

        Raises:
            ConfigError: names the key, the value and the valid range.
        """


@dataclass(kw_only=True)
class AgentConfig:
    """The `algo` configuration of a package's agent; a subclass adds its own keys."""

    name: str = plain_name()
    agent: str = plain_name()
    n_envs: int = number(1, 65_536)
    package: str
    learns: bool
    tuned: Tuned | None = None  # search that chose the values

    def check(self) -> None:
        """Raise ConfigError if values contradict each other."""


@dataclass(frozen=True, slots=True)
class AgentSpec(Spec):
    """Description of one value of `algo.agent`."""

    base: ClassVar[type] = AgentConfig

    name: str
    """Value of `algo.agent`."""
    title: str
    """Name in tables, figures and sentences."""
    schema: type
    """Keys of `algo` with their types and ranges."""
    factory: str
    """`module:callable` that creates the agent from a configuration and a vehicle."""
    algorithm: str = ""
    """`module:class` of the Stable-Baselines3 algorithm; empty for a controller."""
    exportable: bool = False
    """Whether a feed-forward network maps each observation to the action, so that an ONNX file can contain the policy."""
    knows: tuple[str, ...] = ()
    """What the agent knows in addition to the observation: `sheet` (the numbers of the vehicle's sheet) or `model` (a
    simulation of the vehicle).
    """
    observes: bool = True
    """Whether the agent reads the observation."""
    learns: bool = False
    """Whether the agent is trained."""
    teams: bool = True
    """Whether the agent can steer several vehicles in one episode."""
    pilots: bool = False
    """Whether `auvbench pilot` can use the agent: a controller whose code needs only NumPy and SciPy. Only for auvbench's own agents."""
    program: bool = False
    """Whether the agent starts a program on this machine; an entry (`auvbench submit`) must not contain an agent that does this."""
    settled: str = ""
    """`module:function` that adds the digest of the user's program to a configuration before the run gets its id. It takes
    the composed configuration and its checked `algo`, and returns the new configuration. Only for auvbench's own agents.
    """
    check: str = ""
    """`module:function` that takes configuration and vehicle and raises an error if the agent cannot steer the vehicle.
    For a controller, the function is called when the run begins. For a learner, it is called before the run is created, so
    it must not start a program. Only for auvbench's own agents.
    """

    @classmethod
    def adopt(cls, found: Declared, thing: Any) -> AgentSpec:
        """Create the spec of a package's agent, since the entry point of an agent names a factory, not a spec.

        Raises:
            ConfigError: the entry point is not callable, its `Config` is not a schema, or a learner lacks a
                required attribute.
        """
        schema = getattr(thing, "Config", AgentConfig)
        if fault := schema_fault(schema, AgentConfig, "Config"):
            raise found.error(fault)
        if not callable(thing):
            raise found.error(
                f"is a {type(thing).__name__}; it must be a class or a function that makes an agent"
            )
        learns = callable(getattr(thing, "learn", None))
        if learns:
            exact = getattr(thing, "exact_resume", None)
            needed = ("save", "load", "state", "restore") if exact else ("save", "load")
            lacking = [name for name in needed if not callable(getattr(thing, name, None))]
            lacking += [] if isinstance(exact, bool) else ["exact_resume, True or False"]
            if lacking:
                raise found.error(f"learns but lacks {', '.join(lacking)} (auvbench.agents.base.Learner)")
        return cls(found.name, found.name, schema, found.value, exportable=True, learns=learns)


def learns(algo: Any, *, unknown: bool = False) -> bool:
    """Return whether the agent of an `algo` configuration learns.

    Args:
        algo: typed or plain configuration.
        unknown: result for an agent that neither the registry nor the configuration describes.

    >>> learns({"agent": "ppo"}), learns({"agent": "pid"})
    (True, False)
    """
    agent = algo.get("agent") if isinstance(algo, Mapping) else getattr(algo, "agent", None)
    if agent in AGENTS.own:
        return AGENTS[str(agent)].learns
    # The configuration of a package's agent has the key `learns`, so the package need not be installed.
    declared = algo.get("learns") if isinstance(algo, Mapping) else getattr(algo, "learns", None)
    return declared if isinstance(declared, bool) else unknown
