"""Composing configurations with Hydra, and saying in one line what is wrong with them.

`compose` is for commands and tests; `run` is Hydra's own command line (`--cfg`, `--help`, `-m`, completion)
around a function. Both search `./conf` of the working directory first, so that a user's own vehicle or preset
needs no change to the package; `compose` can be told to search another folder, or none.
"""

from __future__ import annotations

import argparse
import copy
import dataclasses
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from contextvars import ContextVar
from functools import lru_cache
from pathlib import Path
from typing import Any, NoReturn

from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.config_store import ConfigStore
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.core.plugins import Plugins
from hydra.errors import (
    OverrideParseException,
)
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import (
    OmegaConfBaseException,
)

from auvbench.config import (
    hydra_errors,
    installed,
    isolated,
    launchers,
    restricted_yaml,
    schema,
    simulators,
    suggestions,
    tuning,
)
from auvbench.config import overrides as typing
from auvbench.config.agents import AGENTS
from auvbench.errors import ConfigError, closest
from hydra_plugins import auvbench_launcher

CONFIG_MODULE = "auvbench.conf"

ALGORITHM_SCHEMAS = {f"{name}_schema": spec.schema for name, spec in AGENTS.items()}


def register_schemas() -> None:
    store = ConfigStore.instance()
    store.store(name="train_schema", node=schema.TrainConfig)
    store.store(name="evaluate_schema", node=schema.EvaluateConfig)
    store.store(name="tune_schema", node=tuning.TuneConfig)
    # At the top level: the folders algo, launcher and simulator then list their answers alone.
    for name, node in (ALGORITHM_SCHEMAS | launchers.SCHEMAS | simulators.SCHEMAS).items():
        store.store(name=name, node=node)


class WorkingDirectory(SearchPathPlugin):
    """Puts installed packages' folders and `./conf` of the working directory on Hydra's search path, the latter first."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        for provider, path in restricted_yaml.installed_sources():
            search_path.prepend(provider=provider, path=path, anchor="main")
        own = Path.cwd() / "conf"
        if own.is_dir():
            search_path.prepend(provider="working-directory", path=f"{restricted_yaml.SCHEME}://{own}")


# Hydra accepts plugin classes only from `hydra_plugins` or its own core package.
WorkingDirectory.__module__ = "hydra_plugins.auvbench_search_path"


def _store() -> None:
    register_schemas()
    auvbench_launcher.store()
    restricted_yaml.register()


def _prepare() -> None:
    from hydra import version

    version.setbase("1.3")
    register_schemas()
    auvbench_launcher.register()
    restricted_yaml.register()
    plugins = Plugins.instance()
    if WorkingDirectory not in plugins.discover(SearchPathPlugin):
        plugins.register(WorkingDirectory)


WORKING_DIRECTORY = Path("conf")
"""of the folder in which the program runs"""

_folder: ContextVar[Path | None] = ContextVar("folder", default=WORKING_DIRECTORY)


def compose(
    entry: str, overrides: Sequence[str] = (), *, folder: Path | None = WORKING_DIRECTORY
) -> DictConfig:
    """The configuration `conf/<entry>.yaml` with overrides applied, types checked.

    Args:
        entry: train or evaluate.
        overrides: in Hydra's grammar, e.g. `["vehicle=rexrov", "reward.k=40"]`.
        folder: searched before the package's own files if it exists; None searches the package alone.

    Raises:
        ConfigError: an unknown key, group or option, a value of the wrong type, or a grammar error.
    """
    token = _folder.set(folder)
    try:
        return installed.complete(_compose(entry, overrides))
    except hydra_errors.FAULTS as error:
        raise translate(error, entry, overrides) from error
    finally:
        _folder.reset(token)


def typed(config: DictConfig) -> schema.TrainConfig:
    """The typed, checked configuration of a plain one, e.g. of a run's `config.yaml`.

    Raises:
        ConfigError: a key is unknown or missing, a type or a value is wrong.
    """
    from auvbench.config.validate import train_config

    try:
        config = installed.complete(config, frozen=True)
        merged = OmegaConf.structured(schema.TrainConfig)
        merged.algo = _algorithm(config)
        merged.simulator = _simulator(config)
        merged = OmegaConf.merge(merged, config)
    except OmegaConfBaseException as error:
        raise translate(error) from error
    assert isinstance(merged, DictConfig)
    return train_config(merged)


def with_algorithm(config: schema.TrainConfig, algo: Mapping[str, Any]) -> schema.TrainConfig:
    """A checked configuration with other values of `algo`, checked as well: a hundredth of the time of `typed`.

    Args:
        config: as `typed` returns it.
        algo: the plain values of the group.

    Raises:
        ConfigError: a key is unknown, a type or a value is wrong, or it is at odds with another.
    """
    from auvbench.config.validate import again

    try:
        merged = OmegaConf.merge(OmegaConf.structured(type(config.algo)), dict(algo))
    except OmegaConfBaseException as error:
        raise translate(error) from error
    return again(dataclasses.replace(config, algo=OmegaConf.to_object(merged)))


def _algorithm(config: DictConfig) -> Any:
    """The typed, still empty `algo` of a configuration."""
    typed_already = OmegaConf.get_type(config, "algo")
    if isinstance(typed_already, type) and issubclass(typed_already, installed.AgentConfig):
        return OmegaConf.structured(typed_already)
    agent = str(OmegaConf.select(config, "algo.agent"))
    if agent not in AGENTS:
        raise ConfigError(f"algo.agent={agent}: unknown; {closest(agent, AGENTS)}")
    return OmegaConf.structured(AGENTS[agent].schema)


def _simulator(config: DictConfig) -> Any:
    """The typed, still empty `simulator` of a configuration."""
    typed_already = OmegaConf.get_type(config, "simulator")
    if isinstance(typed_already, type) and issubclass(typed_already, installed.SimulatorConfig):
        return OmegaConf.structured(typed_already)
    name = str(OmegaConf.select(config, "simulator.name"))
    found = simulators.schema_of(name)
    if found is None:
        raise ConfigError(f"simulator.name={name}: unknown; {closest(name, simulators.CAPABILITIES)}")
    return OmegaConf.structured(found)


def option(group: str, choice: str) -> DictConfig:
    """The configuration that `group=choice` stands for, e.g. `vehicle=rexrov`.

    Raises:
        ConfigError: there is no such group or option.
    """
    return copy.deepcopy(_option(group, choice))


@lru_cache(maxsize=256)
def _option(group: str, choice: str) -> DictConfig:
    """Composing takes a tenth of a second, and a protocol asks for the same few options for every run."""
    node = compose("train", [f"{group}={choice}"])[group]
    assert isinstance(node, DictConfig)
    return node


def _compose(entry: str, overrides: Sequence[str]) -> DictConfig:
    folder = _folder.get()
    return isolated.load(
        CONFIG_MODULE,
        entry,
        typing.read(overrides),
        folder=folder.absolute() if folder is not None and folder.is_dir() else None,
        register=_store,
    )


def run(
    entry: str,
    arguments: Sequence[str],
    job: Callable[[DictConfig], Any],
    grid: Callable[[list[DictConfig]], Any] | None = None,
    program: str = "auvbench",
) -> Any:
    """Hydra's command line for `conf/<entry>.yaml`: flags, `-m` and overrides.

    Calls `job` with the configuration, or `grid` with those of all jobs when there may be several: with `-m`, or
    for an experiment that sets `hydra.mode: MULTIRUN`.

    Raises:
        ConfigError: as `compose`.
    """
    from hydra._internal.utils import _run_hydra, get_args_parser

    _prepare()
    # Otherwise Hydra prints and exits by itself, with exit code 1 and a hint to set this variable.
    os.environ["HYDRA_FULL_ERROR"] = "1"
    sys.argv = [f"{program} {entry}", *arguments]
    parser: argparse.ArgumentParser = get_args_parser()
    parser.prog = f"{program} {entry}"
    _check_flags(parser, arguments, entry)
    parsed = parser.parse_args(list(arguments))
    parsed.overrides = typing.read(parsed.overrides)
    if parsed.package and not re.fullmatch(r"[\w.]+", parsed.package):
        raise ConfigError(f"--package {parsed.package}: must be a key, for example --package algo")
    shows = next((flag for flag in ("cfg", "info") if getattr(parsed, flag) is not None), None)
    if parsed.multirun and shows is not None:
        raise ConfigError(f"--{shows} shows one configuration: leave out -m, and give each key one value")
    if grid is not None:
        parsed.overrides = _as_axes(parsed.overrides, parsed.multirun)
    composed: list[DictConfig] = []

    def task(config: DictConfig) -> None:
        composed.append(config)

    try:
        with restricted_yaml.checked():
            _run_hydra(
                args=parsed,
                args_parser=parser,
                task_function=task,
                config_path=f"pkg://{CONFIG_MODULE}",
                config_name=entry,
            )
        composed = [installed.complete(config) for config in composed]
    except hydra_errors.FAULTS as error:
        raise translate(error, entry, arguments) from error
    # Outside Hydra's job, which would print a line of its own before an error reaches us.
    if grid is not None and (parsed.multirun or len(composed) > 1):
        return grid(composed)
    return job(composed[0]) if composed else None


def _check_flags(parser: argparse.ArgumentParser, arguments: Sequence[str], entry: str) -> None:
    """Refuses what Hydra's parser would answer with its whole usage, and what would do harm.

    Raises:
        ConfigError: names the override, or the flag, that was probably meant.
    """
    known = {name: action for action in parser._actions for name in action.option_strings}
    before = ""
    for index, word in enumerate(arguments):
        takes_this = before in known and known[before].nargs is None
        before = "" if takes_this else word
        if takes_this or not re.match(r"--?[A-Za-z]", word):
            continue
        flag = word.partition("=")[0]
        if flag in typing.FLAGS:
            raise ConfigError(f"{flag}: has no meaning here; {typing.FLAGS[flag]}")
        if flag not in known:
            following = arguments[index + 1] if index + 1 < len(arguments) else None
            keys = hydra_errors.leaves(OmegaConf.to_container(_compose(entry, ())))
            flags = [name for name in known if name.startswith("--") and name not in typing.FLAGS]
            raise ConfigError(suggestions.unknown_flag(entry, word, flags, keys, following))

    def error(message: str) -> NoReturn:
        raise ConfigError(f"{entry}: {message} (auvbench {entry} --help)")

    parser.error = error  # type: ignore[method-assign]


def _as_axes(overrides: Sequence[str], multirun: bool) -> list[str]:
    """Of a grid, single values as axes of one value each.

    Hydra sets single values before it chooses the swept files: `algo=sac,td3 algo.learning_starts=300` would look
    for the key in the default algorithm.
    """
    try:
        parsed = OverridesParser.create().parse_overrides(list(overrides))
    except OverrideParseException:
        return list(overrides)  # Hydra says what is wrong with them
    if not multirun and not any(override.is_sweep_override() for override in parsed):
        return list(overrides)
    return [_as_axis(line, override) for line, override in zip(overrides, parsed, strict=True)]


def _as_axis(line: str, override: Override) -> str:
    key, _, value = line.partition("=")
    is_group = "." not in override.key_or_group
    if is_group or not value or override.is_sweep_override() or override.is_hydra_override():
        return line
    # Not what is deleted, and not a mapping, which is merged with what is there.
    return line if override.is_delete() or isinstance(override.value(), dict) else f"{key}=choice({value})"


def translate(error: BaseException, entry: str = "train", overrides: Sequence[str] = ()) -> ConfigError:
    """One line that names the value and what would be right, from Hydra's and OmegaConf's messages."""
    return hydra_errors.translate(error, lambda given: _compose(entry, given), entry, overrides)
