"""Register all parts that are chosen by name: auvbench's own parts, and the parts of installed packages.

Each part of a kind (agents, tasks, ...) has a line `name = module:object`. The lines of auvbench's own parts are the tables below;
the lines of a package are the entry points of one group. The object is a spec. A spec contains all that auvbench must know before
it imports the part's code: the part's name, title, schema and `module:object` of the code.

auvbench loads only code that these lines and specs name, and never code that a configuration or a run directory names. It imports a
package when one of the package's parts is chosen. Two rules hold only for parts of packages: the package's release belongs to a
run's identity, and auvbench always checks the results of the package's code.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, is_dataclass
from functools import cache, reduce
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from auvbench import integrations
from auvbench.errors import AgentError, AuvbenchError, ConfigError, PluginImportError
from auvbench.untrusted.text import first_line, short

if TYPE_CHECKING:
    from auvbench.blocks import BlockSpec
    from auvbench.config.algorithms import AgentSpec
    from auvbench.config.commands import CommandSpec
    from auvbench.config.disturbances import DisturbanceSpec
    from auvbench.config.filters import FilterSpec
    from auvbench.config.launchers import LauncherSpec
    from auvbench.config.rewards import RewardSpec
    from auvbench.config.simulators import SimulatorSpec
    from auvbench.config.tasks import TaskSpec
    from auvbench.config.trackers import TrackerSpec
    from auvbench.config.worlds import WorldSpec


class Spec:
    """Base class of specs; each kind of part has a frozen dataclass derived from it."""

    __slots__ = ()
    base: ClassVar[type] = object
    """Class that a package's schema must be derived from."""

    name: str
    """Name of the part: the value in the configuration that chooses it."""
    factory: str
    """`module:object` of the part's code."""
    schema: type | None
    """Dataclass of the part's configuration: types, ranges and meanings of its keys; None for a part without keys."""

    @property
    def keys(self) -> type:
        """Dataclass of the part's configuration; `base` for a part without keys of its own."""
        return self.schema or self.base

    @property
    def code(self) -> str:
        """`module:object` of the part's code; a subclass without the field `factory` overrides this property."""
        return self.factory

    def fault(self) -> str:
        """Return why a package's spec cannot be used; '' if it can."""
        return ""

    def enter(self) -> None:
        """Update data that depend on the registered parts, such as caches; the base class does nothing.

        Raises:
            ValueError: the part cannot be registered.
        """

    def leave(self) -> None:
        """Undo `enter`."""


S = TypeVar("S", bound=Spec)


@dataclass(frozen=True, slots=True, order=True)
class Declared:
    """An entry point with its package."""

    group: str
    name: str
    package: str
    value: str
    version: str
    key: str

    @property
    def release(self) -> str:
        """The package as a requirement, `auvbench-example==1.0`: part of a run's configuration and identity."""
        return f"{self.package}=={self.version}"

    def error(self, reason: str) -> ConfigError:
        """Return an error that names key, entry point and package."""
        return ConfigError(f"{self.key}={self.name}: {self.value} of {self.release} {reason}")


@cache
def entry_points() -> Any:
    """Return the entry points of all groups; cached, since importlib.metadata reads the files of all packages in each call."""
    from importlib import metadata  # imported late, since it is slow and most help texts do not need it

    return metadata.entry_points()


@cache
def load(point: Declared) -> Any:
    """Import the object of an entry point.

    Raises:
        PluginImportError: the object cannot be imported, or does not exist.
    """
    from importlib import metadata

    try:
        return metadata.EntryPoint(point.name, point.value, point.group).load()
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a package may raise any exception when it is imported, also SystemExit
        raise PluginImportError(str(point.error(f"cannot be imported: {describe_error(error)}"))) from error


class Kind(Mapping[str, S], Generic[S]):
    """All parts of one kind as a mapping from names to specs: auvbench's own, then the registered specs of packages.

    Args:
        group: group of the entry points of packages.
        key: configuration key that chooses a part, for example `task.name`; for commands, `auvbench COMMAND`.
        spec: `module:class` of the specs.
        own: `module:spec` by name, for the parts in auvbench's core; the constructor adds the parts of auvbench's integrations.
    """

    def __init__(self, group: str, key: str, spec: str, own: Mapping[str, str]) -> None:
        self.group = group
        self.key = key
        self._lines = {**own, **integrations.REGISTERED.get(group, {})}
        self.own = tuple(self._lines)
        """Names of auvbench's own parts."""
        self.entered: dict[str, S] = {}
        """Registered specs of packages, by name; a spec is registered when its part is chosen or a run names its part."""
        self._spec = spec

    def __getitem__(self, name: str) -> S:
        if name in self.entered:
            return self.entered[name]
        spec: S = resolve(self._lines[name])
        return spec

    def __contains__(self, name: object) -> bool:
        return name in self._lines or name in self.entered

    def __iter__(self) -> Iterator[str]:
        yield from self._lines
        yield from (name for name in self.entered if name not in self._lines)

    def __len__(self) -> int:
        return len({*self._lines, *self.entered})

    @property
    def spec(self) -> type[S]:
        """Class of the specs."""
        kind: type[S] = resolve(self._spec)
        return kind

    def declared(self) -> tuple[Declared, ...]:
        """Return all entry points of the kind, sorted by name and package, without importing a package."""
        return declared(self.group, self.key)

    def names(self) -> tuple[str, ...]:
        """Return the names of auvbench's own parts, then the names that packages declare, without importing a package."""
        return tuple(dict.fromkeys([*self._lines, *(point.name for point in self.declared())]))

    def find(self, name: str) -> Declared | None:
        """Return the entry point of this name; None if no package declares it.

        Raises:
            ConfigError: several packages declare the name, or auvbench and a package have a part of this name.
        """
        points = [point for point in self.declared() if point.name == name]
        holders = [*(["auvbench"] if name in self._lines else []), *(point.package for point in points)]
        if points and len(holders) > 1:
            raise ConfigError(
                f"{self.key}={short(name)}: {' and '.join(holders)} each provide a part of this name; uninstall one of them: pip "
                f"uninstall {holders[-1]}"
            )
        return points[0] if points else None

    def missing(self, name: str, release: str) -> ConfigError:
        """Return the error for a configuration that records a package's release, if this release is not installed."""
        point = self.find(name)
        now = "is not installed" if point is None else f"{point.release} is installed"
        return ConfigError(
            f"{self.key}={short(name)}: comes with {short(release)}, and {now}; pip install '{short(release)}'"
        )

    def choose(self, name: str, release: str | None = None) -> S:
        """Return the spec of the part with this name; register the spec if it comes from a package.

        Args:
            name: name of one of auvbench's own parts, or of an entry point.
            release: release that the part's package must have; None: any.

        Raises:
            ConfigError: the package is not installed, has another release, or its spec cannot be used.
            KeyError: neither auvbench nor a package has the name, and `release` is None.
        """
        point = self.find(name)
        if release is not None and (point is None or point.release != release):
            raise self.missing(name, release)
        return self[name] if point is None else self.enter(point)

    def enter(self, point: Declared) -> S:
        """Register the part that an entry point declares, and return its spec.

        Raises:
            ConfigError: the declared object cannot be used.
        """
        kind, thing = self.spec, load(point)
        if not isinstance(thing, kind) and (adopt := getattr(kind, "adopt", None)):
            entered = self.entered.get(point.name)
            thing = entered if entered is not None and entered.code == point.value else adopt(point, thing)
        if not isinstance(thing, kind):
            raise point.error(f"is a {type(thing).__name__}; it must be an auvbench.plugin.{kind.__name__}")
        if thing.name != point.name:
            raise point.error(
                f"has the name {short(repr(thing.name))}; it must have the name of its entry point"
            )
        if self.entered.get(thing.name) is not thing:
            if fault := schema_fault(thing.schema, kind.base) or thing.fault():
                raise point.error(fault)
            try:
                thing.enter()
            except ValueError as error:
                raise point.error(str(error)) from None
            self.entered[thing.name] = thing
        return thing

    def forget(self) -> None:
        """Unregister all specs that came from packages. Tests and programs that install packages at run time need this."""
        for spec in self.entered.values():
            spec.leave()
        self.entered.clear()


@cache
def declared(group: str, key: str) -> tuple[Declared, ...]:
    """Return all entry points of a group, sorted by name and package, without importing a package."""
    return tuple(
        sorted({
            Declared(group, point.name, point.dist.name, point.value, point.dist.version, key)
            for point in entry_points().select(group=group)
            if point.dist is not None
        })
    )  # fmt: skip


def schema_fault(schema: Any, base: type, word: str = "schema") -> str:
    """Return why a package's schema cannot be used; '' if it is None, or a typed dataclass derived from `base`."""
    from omegaconf import OmegaConf  # imported late, since it is slow and only parts of packages need it
    from omegaconf.errors import OmegaConfBaseException

    reason = ""
    try:
        if schema is None:
            return ""
        if isinstance(schema, type) and issubclass(schema, base) and is_dataclass(schema):
            OmegaConf.structured(schema)
            return ""
    except (OmegaConfBaseException, TypeError, ValueError) as error:
        reason = f" ({describe_error(error)})"
    return f"has a {word} that is not a dataclass derived from auvbench.plugin.{base.__name__}{reason}"


def resolve(target: str) -> Any:
    """Import and return the object of "module:object", or the module of "module"."""
    module, _, names = target.partition(":")
    return reduce(getattr, names.split(".") if names else [], importlib.import_module(module))


def describe_error(error: BaseException) -> str:
    """Return one line that describes an exception which a package's code raised."""
    kind = type(error).__name__
    return short(f"{kind}: {first_line(error)}" if str(error) else kind)


@contextmanager
def telling(owner_name: str, what: str) -> Iterator[None]:
    """Turn an exception of a package's code into an `AgentError`: `owner_name` is the part, `what` the failed call."""
    try:
        yield
    except AuvbenchError:
        raise
    except Exception as error:
        raise AgentError(f"{owner_name}: {what}: {describe_error(error)}") from error


def owner(kind: str, part: Any) -> str:
    """Return the name of a part for messages, with the package that provides the part: `task=circling of auvbench-example==1.0`."""
    return owned(f"{kind}={part.name}", part)


def owned(what: str, part: Any) -> str:
    """Return `what`; if a package provides the part, append the package: `WHAT of auvbench-example==1.0`."""
    package = getattr(part, "package", None)
    return f"{what} of {package}" if package else what


def _lines(module: str, *names: str) -> dict[str, str]:
    return {name: f"{module}:{name}" for name in names}


def _files(package: str, *names: str) -> dict[str, str]:
    return {name: f"{package}.{name}:SPEC" for name in names}


_ALGORITHMS = "auvbench.config.algorithms"
_SB3 = ("ppo", "sac", "ddpg", "td3", "tqc", "crossq", "trpo", "recurrent_ppo")
AGENTS: Kind[AgentSpec] = Kind(
    "auvbench.agents",
    "algo.agent",
    f"{_ALGORITHMS}:AgentSpec",
    {
        **_lines(f"{_ALGORITHMS}.sb3", *_SB3),
        **_lines(f"{_ALGORITHMS}.residual", "ppo_residual", "sac_residual"),
        **_files(
            _ALGORITHMS, "pid", "alos", "apf", "lqr", "smc", "adrc", "mpc", "mppi", "random", "onnx", "pets"
        ),
    },
)

_TASKS = "auvbench.config.tasks"
TASKS: Kind[TaskSpec] = Kind(
    "auvbench.tasks",
    "task.name",
    f"{_TASKS}:TaskSpec",
    _files(
        _TASKS,
        *("waypoint", "station_keeping", "trajectory_tracking", "path_following", "docking"),
        *("transit", "terrain", "formation", "rendezvous", "tracking"),
    ),
)

_REWARDS = "auvbench.config.rewards"
REWARDS: Kind[RewardSpec] = Kind(
    "auvbench.rewards",
    "reward.name",
    f"{_REWARDS}:RewardSpec",
    _lines(
        _REWARDS,
        *(
            "thesis",
            "tracking",
            "exponential",
            "marinegym_hover",
            "gym_auv_path",
            "gym_dockauv",
            "gym_dockauv_radar",
            "goal",
            "path",
        ),
    ),
)

_BLOCKS = "auvbench.blocks"
BLOCKS: Kind[BlockSpec] = Kind(
    "auvbench.blocks",
    "task.observation",
    f"{_BLOCKS}:BlockSpec",
    {
        **_lines(
            _BLOCKS,
            *("yaw_error", "position_error", "velocity_error", "velocity", "angular_velocity"),
            *("gravity", "depth_margin", "previous_action", "preview", "goal_error", "way"),
            *("position_sd", "specific_force", "sensor_age"),
            *("slot", "messages", "target", "pings"),
        ),
        **{
            f"range.{name}": f"auvbench.tasks.ranges.specs:{name}"
            for name in ("ideal", "ping1d", "ping360", "multibeam")
        },
        "solids": "auvbench.tasks.ranges.specs:solids",
    },
)

_SIMULATORS = "auvbench.config.simulators"
SIMULATORS: Kind[SimulatorSpec] = Kind(
    "auvbench.simulators",
    "simulator.name",
    f"{_SIMULATORS}:SimulatorSpec",
    _lines(_SIMULATORS, "fossen"),
)

_DISTURBANCES = "auvbench.config.disturbances"
DISTURBANCES: Kind[DisturbanceSpec] = Kind(
    "auvbench.disturbances",
    "disturbance",
    f"{_DISTURBANCES}:DisturbanceSpec",
    {
        **_lines(_DISTURBANCES, "current", "waves", "fault", "delay", "sensor", "randomisation"),
        "tether": "auvbench.tasks.disturbances.tether:tether",
        "identified": "auvbench.tasks.disturbances.identified:identified",
    },
)

_WORLDS = "auvbench.config.worlds"
WORLDS: Kind[WorldSpec] = Kind(
    "auvbench.worlds",
    "world.name",
    f"{_WORLDS}:WorldSpec",
    {
        **{name: f"{_WORLDS}:{name}_" for name in ("open", "field")},
        **_lines(_WORLDS, "tank", "slope", "rough", "bottom", "pillars", "pipeline"),
    },
)

_FILTERS = "auvbench.config.filters"
FILTERS: Kind[FilterSpec] = Kind(
    "auvbench.filters", "filter.name", f"{_FILTERS}:FilterSpec", _lines(_FILTERS, "none", "cbf")
)

_LAUNCHERS = "auvbench.config.launchers"
LAUNCHERS: Kind[LauncherSpec] = Kind(
    "auvbench.launchers",
    "launcher.name",
    f"{_LAUNCHERS}:LauncherSpec",
    _lines(_LAUNCHERS, "local"),
)

_TRACKING = "auvbench.config.trackers"
TRACKERS: Kind[TrackerSpec] = Kind("auvbench.trackers", "train.log", f"{_TRACKING}:TrackerSpec", {})

_COMMANDS = "auvbench.config.commands"
COMMANDS: Kind[CommandSpec] = Kind(
    "auvbench.commands",
    "auvbench COMMAND",
    f"{_COMMANDS}:CommandSpec",
    _lines(
        _COMMANDS,
        *(
            "init",
            "train",
            "resume",
            "evaluate",
            "tune",
            "report",
            "compare",
            "publish",
            "submit",
            "verify",
            "bound",
        ),
        *(
            "plan",
            "vehicles",
            "identify",
            "validate",
            "simulate",
            "runs",
            "export",
            "replay",
            "completion",
        ),
    ),
)

KINDS: tuple[Kind[Any], ...] = (
    AGENTS,
    TASKS,
    REWARDS,
    BLOCKS,
    DISTURBANCES,
    SIMULATORS,
    LAUNCHERS,
    TRACKERS,
    COMMANDS,
)


def forget() -> None:
    """Remove all registered parts of packages and clear the cached lists of packages, which tests and programs that install packages at run time need."""
    for kind in KINDS:
        kind.forget()
    forget_packages()


def forget_packages() -> None:
    """Clear the cached lists of installed packages, so that the process looks for packages again."""
    from auvbench.config import folders

    for cached in (entry_points, declared, load, folders.packages):
        cached.cache_clear()
