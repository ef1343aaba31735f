"""Compose configurations with Hydra.

`compose` composes one configuration for commands and tests. `read` reads a command line with its flags (`--cfg`,
`--help`, `-m`). Both functions search `./conf` in the working directory first, so a user can add a vehicle or preset
without a change to the package. Hydra only composes configurations and completes words; it starts no job, calls no
plug-in and sets up no logging.
"""

from __future__ import annotations

import argparse
import copy
import dataclasses
import re
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from hydra import version
from hydra._internal import defaults_list
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.config_repository import CachingConfigRepository, ConfigRepository, IConfigRepository
from hydra._internal.config_search_path_impl import ConfigSearchPathImpl
from hydra._internal.core_plugins.bash_completion import BashCompletion
from hydra._internal.defaults_list import Overrides, _create_interpolation_map
from hydra._internal.hydra import Hydra
from hydra.core.config_store import ConfigNode, ConfigStore
from hydra.core.default_element import InputDefault, ResultDefault
from hydra.core.plugins import Plugins
from hydra.plugins.config_source import ConfigResult
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, flag_override
from omegaconf.errors import OmegaConfBaseException

from auvbench.config import (
    complete,
    folders,
    grids,
    navigation,
    ranges,
    restricted_yaml,
    schema,
    simulation,
    suggestions,
    tuning,
)
from auvbench.config import overrides as typing
from auvbench.config.copies import copied
from auvbench.errors import ConfigError, closest
from auvbench.registry import AGENTS, FILTERS, LAUNCHERS, REWARDS, SIMULATORS, TASKS, WORLDS, Kind
from auvbench.untrusted.text import plain_lines

T = TypeVar("T")

CONFIG_MODULE = "auvbench.conf"
EVERY_KEY = "all"
"""word after `--help` that shows every key, not only the common ones"""
WORKING_DIRECTORY = Path("conf")
"""folder of the user's own configuration, in the working directory"""

_LOCK = threading.RLock()


@dataclasses.dataclass
class Sweeper:
    """`hydra.sweeper` of an experiment: its grids, and axes that apply to all grids."""

    params: dict[str, Any] | None = None
    grids: list[Any] = dataclasses.field(default_factory=list)


def _register_schemas(store: ConfigStore) -> None:
    store.store(group="hydra/sweeper", name="auvbench", node=Sweeper)
    kinds = {
        "train_schema": schema.TrainConfig,
        "evaluate_schema": schema.EvaluateConfig,
        "tune_schema": tuning.TuneConfig,
        "simulate_schema": simulation.Simulation,
        "range_schema": ranges.Ranges,
        "sensors_schema": navigation.Sensors,
        **{f"{name}_schema": kind for name, kind in _schemas(AGENTS).items()},
    }
    for group, schemas in (
        ("launcher", _schemas(LAUNCHERS)),
        ("simulator", _schemas(SIMULATORS)),
        ("task", _schemas(TASKS)),
        ("reward", _schemas(REWARDS)),
        ("world", _schemas(WORLDS)),
        ("navigation", navigation.SCHEMAS),
        ("filter", _schemas(FILTERS)),
    ):
        kinds |= {f"{group}_{name}_schema": kind for name, kind in schemas.items()}
    # The schemas are stored outside of the groups, so that the groups algo, launcher and simulator list only their YAML files.
    store.repo |= {
        f"{name}.yaml": ConfigNode(f"{name}.yaml", _Schema(kind), group=None, package=None, provider=None)  # type: ignore[arg-type]
        for name, kind in kinds.items()
    }


@dataclasses.dataclass(frozen=True)
class _Schema:
    """A schema in Hydra's store. Its OmegaConf node is built only if Hydra copies the schema: most commands need few schemas."""

    kind: type

    def __deepcopy__(self, memo: dict[int, Any]) -> DictConfig:
        return copied(_node(self.kind))


@cache
def _node(kind: type) -> DictConfig:
    """Return the OmegaConf node of a schema; the caller must not change it. Cached, since building a node is slow."""
    node = OmegaConf.structured(kind)
    if kind is schema.TrainConfig:
        # More disturbances are allowed here; `complete` checks the keys that only some configurations have.
        node.disturbance = OmegaConf.structured(schema.Disturbance)
        OmegaConf.set_struct(node.disturbance, False)
    assert isinstance(node, DictConfig)
    return node


class _Repository(ConfigRepository):
    def __deepcopy__(self, memo: dict[int, Any]) -> _Repository:
        # Hydra copies the repository and then only replaces the copy's list of sources. So a shallow copy is enough; a deep copy
        # would copy all schemas.
        return copy.copy(self)


class _Loader(ConfigLoaderImpl):
    """Hydra's loader with less work for the same result: one merge of all files, and copies by `copied`."""

    def _compose_config_from_defaults_list(
        self, defaults: list[ResultDefault], repo: IConfigRepository
    ) -> DictConfig:
        config = OmegaConf.create()
        try:
            with flag_override(config, "no_deepcopy_set_nodes", True):
                # One merge of all files, since each merge visits all nodes to set their parents.
                config.merge_with(*(self._load_single_config(default, repo).config for default in defaults))
        except Exception:
            # Merge file by file, as Hydra does, because then the error message names the file. The failed merge has
            # changed the cached files, so they are read again.
            assert isinstance(repo, CachingConfigRepository)
            repo.cache.clear()
            return super()._compose_config_from_defaults_list(defaults, repo)
        _strip_defaults(config)
        return config

    @staticmethod
    def _embed_result_config(ret: ConfigResult, package_override: str | None) -> ConfigResult:
        package = package_override if package_override is not None else ret.header["package"]
        if not package or not isinstance(ret.config, DictConfig):
            return ConfigLoaderImpl._embed_result_config(ret, package_override)
        config = OmegaConf.create()
        with flag_override(config, "no_deepcopy_set_nodes", True):
            OmegaConf.update(config, package, copied(ret.config), merge=False)
        return dataclasses.replace(ret, config=config)


def _strip_defaults(node: Any) -> None:
    """Remove the key `defaults` from `node` and its descendants wherever Hydra set the flag HYDRA_REMOVE_TOP_LEVEL_DEFAULTS."""
    if not isinstance(node, DictConfig) or node._is_missing() or node._is_none():
        return
    if node._get_flag("HYDRA_REMOVE_TOP_LEVEL_DEFAULTS"):
        with flag_override(node, ["readonly", "struct"], False):
            node._set_flag("HYDRA_REMOVE_TOP_LEVEL_DEFAULTS", None)
            node.pop("defaults", None)
    for _, value in node.items_ex(resolve=False):
        _strip_defaults(value)


def _interpolations(overrides: Overrides, defaults_list: list[InputDefault], self_added: bool) -> DictConfig:
    """Return the values that interpolations in a list of defaults may refer to; empty if the list has no interpolation.

    This function replaces a function of Hydra that computes the values for every file, though few files need them.
    """
    if any(entry.is_interpolation() for entry in defaults_list):
        return _create_interpolation_map(overrides, defaults_list, self_added)
    return DictConfig({})


@contextmanager
def _loader(folder: Path | None) -> Iterator[ConfigLoaderImpl]:
    """Yield a loader that searches a folder, then auvbench's own files; restore Hydra's global state on exit.

    So a program that calls auvbench and also uses Hydra keeps its own version base and schemas.
    """
    path = ConfigSearchPathImpl()
    if folder is not None and folder.is_dir():
        path.append("own", f"{restricted_yaml.SCHEME}://{folder.absolute()}")
    path.append("hydra", f"{restricted_yaml.PACKAGE}://hydra.conf")
    # The folders of packages come before "main". If a package and auvbench have the same file, Hydra then finds the package's
    # file, and `InstalledFiles` rejects it.
    for release, installed_folder in folders.packages():
        path.append(release, f"{restricted_yaml.INSTALLED}://{installed_folder}")
    path.append("main", f"{restricted_yaml.PACKAGE}://{CONFIG_MODULE}")
    path.append("schema", "structured://")
    with _LOCK:
        Plugins.instance()  # The first call stores the plug-ins' schemas, so call it before the store is copied.
        store, base = ConfigStore.instance(), version.VersionBase.instance()
        version_base, repository = base.version_base, store.repo
        store.repo = _copied(repository)
        defaults_list._create_interpolation_map = _interpolations
        try:
            version.setbase("1.3")
            _register_schemas(store)
            restricted_yaml.register()
            loader = _Loader(config_search_path=path)
            loader.repository = _Repository(path)
            yield loader
        finally:
            store.repo, base.version_base = repository, version_base
            defaults_list._create_interpolation_map = _create_interpolation_map


def _schemas(kind: Kind[Any]) -> dict[str, type]:
    """Return the schemas of auvbench's own parts of a kind, by the part's name; the YAML files of these parts start from them."""
    return {name: kind[name].keys for name in kind.own}


def _copied(tree: dict[str, Any]) -> dict[str, Any]:
    return {name: _copied(node) if isinstance(node, dict) else node for name, node in tree.items()}


def _compose(entry: str, overrides: Sequence[str], folder: Path | None = WORKING_DIRECTORY) -> DictConfig:
    values = typing.read(overrides)
    with _composer(entry, folder) as (loader, load):
        return grids.single(loader, load, values)


@contextmanager
def _composer(entry: str, folder: Path | None) -> Iterator[tuple[ConfigLoaderImpl, grids.Load]]:
    """Yield a loader (see `_loader`), and the function that loads files with it."""
    own = folder.absolute() if folder is not None and folder.is_dir() else None
    state = folders.state(own) if own else ()
    with _loader(own) as loader:
        packages = folders.packages()
        yield loader, lambda files, mode: _loaded(entry, files, mode, packages, own, state)


@lru_cache(maxsize=64)
def _loaded(
    entry: str,
    files: tuple[str, ...],
    mode: RunMode,
    packages: tuple[tuple[str, Path], ...],
    own: Path | None,
    state: folders.State,
) -> DictConfig:
    """Return the configuration that Hydra loads from the chosen files, including the node `hydra`; the caller must not change it.

    Cached, since loading the files takes up to half a second, ten times as long as setting values in a copy.

    Args:
        entry: see `compose`.
        files: overrides that choose files.
        mode: `MULTIRUN` if axes are allowed, else `RUN`.
        packages: folders of installed packages to search; part of the cache key.
        own: the user's folder to search first.
        state: `folders.state` of the user's folder; part of the cache key.
    """
    with _loader(own) as loader:
        return loader.load_configuration(entry, list(files), mode, from_shell=False)


def compose(
    entry: str, overrides: Sequence[str] = (), *, folder: Path | None = WORKING_DIRECTORY
) -> DictConfig:
    """Return the configuration `conf/<entry>.yaml` with overrides applied, types checked.

    Args:
        entry: train, evaluate, tune or simulate.
        overrides: overrides in Hydra's grammar, e.g. `["vehicle=rexrov", "reward.k=40"]`.
        folder: folder to search before the package's own files, if it exists; None: search only the package.

    Raises:
        ConfigError: an unknown key, group or option, a value of the wrong type, or a grammar error.
    """
    try:
        return complete.complete(_compose(entry, overrides, folder))
    except typing.FAULTS as error:
        raise translate(error, entry, overrides) from error


def typed(config: DictConfig) -> schema.TrainConfig:
    """Convert a plain configuration, e.g. a run's `config.yaml`, to a typed one and check it.

    Raises:
        ConfigError: a key is unknown or missing, a type or a value is wrong.
    """
    from auvbench.config.validate import train_config

    try:
        config = complete.complete(config, frozen=True)
        merged = OmegaConf.structured(schema.TrainConfig)
        merged.algo = _empty(config, "algo.agent", _schemas(AGENTS))
        merged.simulator = _empty(config, "simulator.name", _schemas(SIMULATORS))
        merged.task = _empty(config, "task.name", _schemas(TASKS))
        if "range" not in config.task:
            merged.task.range = None
        merged.reward = _empty(config, "reward.name", _schemas(REWARDS))
        for group, schemas in (  # runs of earlier versions lack these
            ("world", _schemas(WORLDS)),
            ("navigation", navigation.SCHEMAS),
            ("filter", _schemas(FILTERS)),
        ):
            if config.get(group) is not None:
                merged[group] = _empty(config, f"{group}.name", schemas)
        merged.disturbance = OmegaConf.structured(_disturbance(config))
        merged = OmegaConf.merge(merged, config)
    except OmegaConfBaseException as error:
        raise translate(error) from error
    assert isinstance(merged, DictConfig)
    return train_config(merged)


OWN = ("seed", "name", "output")
"""keys whose values do not affect any other value of a configuration; see `once_for_all_seeds`"""

_shared: dict[tuple[str, str], Any] = {}


def once_for_all_seeds(
    what: str, values: Mapping[str, Any], make: Callable[[], T], put: Callable[[T, dict[str, Any]], T]
) -> T:
    """Return the result of `make()` for a run; runs whose configurations differ only in the keys `OWN` share one call.

    Converting a configuration to typed values takes a tenth of a second, and a study has hundreds of runs.

    Args:
        what: name of the result, part of the cache key.
        values: all values of the run's configuration.
        make: function that computes the result, without side effects.
        put: function that returns a copy of the shared result with the run's own values of the keys `OWN`.
    """
    own = {name: values.get(name) for name in OWN}
    # Not cached for a configuration with packages: the next call may find another version of a package installed.
    if complete.releases(values) or not _is_valid(own):
        return make()
    key = what, repr({name: value for name, value in values.items() if name not in OWN})
    if key not in _shared:
        if len(_shared) >= 256:
            _shared.clear()
        _shared[key] = make()
    return put(_shared[key], own)


def _is_valid(own: Mapping[str, Any]) -> bool:
    """Return whether the values of the keys `OWN` have the types and ranges of the schema, so that they need no conversion."""
    from auvbench.config.validate import check_value

    fields = {field.name: field for field in dataclasses.fields(schema.TrainConfig)}
    if any(value == "???" or type(value).__name__ != fields[name].type for name, value in own.items()):
        return False
    try:
        for name, value in own.items():
            check_value(name, value, fields[name].metadata)
    except ConfigError:
        return False
    return True


def _empty(config: DictConfig, key: str, schemas: Mapping[str, type]) -> Any:
    """Return the types of a configuration's group without the values; `key` is the key that chooses the group's part."""
    kind = OmegaConf.get_type(config, key.partition(".")[0])
    if isinstance(kind, type) and issubclass(kind, complete.CONFIGS):
        return OmegaConf.structured(kind)
    name = str(OmegaConf.select(config, key))
    if name not in schemas:
        raise ConfigError(f"{key}={name}: unknown; {closest(name, schemas)}")
    return OmegaConf.structured(schemas[name])


def _disturbance(config: DictConfig) -> type:
    """Return the schema of a completed configuration's disturbances."""
    kind = OmegaConf.get_type(config, "disturbance")
    return kind if isinstance(kind, type) and issubclass(kind, schema.Disturbance) else schema.Disturbance


def with_groups(config: schema.TrainConfig, groups: Mapping[str, Mapping[str, Any]]) -> schema.TrainConfig:
    """Return a checked configuration with new values of some groups, much faster than `typed`.

    Args:
        config: result of `typed`; unchanged groups are shared.
        groups: plain values by group, such as `algo`; the values must include every key of the group's schema.

    Raises:
        ConfigError: a key is unknown, a type or value is wrong, or a value contradicts another.
    """
    from auvbench.config.validate import check_across, validate_fields

    replaced = {}
    for name, values in groups.items():
        try:
            completed = complete.complete(OmegaConf.create({name: dict(values)}))
            kind = _disturbance(completed) if name == "disturbance" else type(getattr(config, name))
            empty = {name: OmegaConf.structured(kind)}
            merged = OmegaConf.select(OmegaConf.merge(empty, completed), name)
        except OmegaConfBaseException as error:
            raise translate(error) from error
        replaced[name] = OmegaConf.to_object(merged)
        validate_fields(replaced[name], f"{name}.")
    changed = dataclasses.replace(config, **replaced)  # type: ignore[arg-type]
    check_across(changed)
    return changed


def option(group: str, choice: str) -> DictConfig:
    """Return the configuration that `group=choice` selects, e.g. `vehicle=rexrov`.

    Raises:
        ConfigError: an unknown group or option.
    """
    return copied(_option(group, choice))


@lru_cache(maxsize=256)
def _option(group: str, choice: str) -> DictConfig:
    """Return the configuration of an option; the caller must not change it.

    Cached, since composing takes a tenth of a second, and a protocol needs the same few options for every run.
    """
    node = compose("train", [f"{group}={choice}"])[group]
    assert isinstance(node, DictConfig)
    return node


@dataclasses.dataclass(frozen=True, slots=True)
class Request:
    """Content of a command line: the jobs, and whether they are a grid or a dry run."""

    jobs: list[grids.Job]
    """all jobs of the grid; a single job if the command line has no grid"""
    grid: bool
    """whether the jobs form a grid: the command line has `-m`, or an experiment with `hydra.mode: MULTIRUN` has several jobs"""
    dry_run: bool

    @property
    def configs(self) -> list[DictConfig]:
        """Return the configuration of each job."""
        return [job.config for job in self.jobs]


def read(
    entry: str, arguments: Sequence[str], *, grid: bool = False, dry_run: bool = False
) -> Request | None:
    """Read the command line of `conf/<entry>.yaml`: flags, `-m` and overrides.

    Args:
        entry: name of the command and of its file in `conf/`.
        arguments: words of the command line.
        grid: whether the command accepts grids.
        dry_run: whether the command has the flag `--dry-run`.

    Returns:
        The request; None after `--help` or `--cfg job`, whose text is printed.

    Raises:
        ConfigError: see `compose`.
    """
    try:
        parsed = _parse(entry, arguments, dry=dry_run)
        overrides = typing.read(parsed.overrides)
        with _composer(entry, WORKING_DIRECTORY) as (loader, load):
            if parsed.help:
                shown = f"{_help(Hydra('auvbench', loader), entry, overrides)}\n"
            elif parsed.cfg:
                shown = OmegaConf.to_yaml(complete.complete(grids.single(loader, load, overrides)))
            elif parsed.multirun and not grid:
                raise ConfigError(
                    f"-m: {entry} takes one value for each key; grids are for auvbench train and tune"
                )
            else:
                jobs = grids.compose(loader, load, overrides, parsed.multirun)
                jobs = [dataclasses.replace(job, config=complete.complete(job.config)) for job in jobs]
                return Request(jobs, parsed.multirun or len(jobs) > 1, dry_run and parsed.dry_run)
    except typing.FAULTS as error:
        raise translate(error, entry, arguments) from error
    # Print the text outside of the `try`, because the OSError of a closed pipe is not an error of the configuration.
    print(plain_lines(shown), end="")
    return None


def complete_override(entry: str, line: str) -> list[str]:
    """Return the completions of the last word of a line of overrides."""
    with _loader(WORKING_DIRECTORY) as loader:
        return list(BashCompletion(loader)._query(config_name=entry, line=line))


def _help(hydra: Hydra, entry: str, overrides: list[str]) -> str:
    config = hydra.compose_config(entry, [o for o in overrides if o != EVERY_KEY], RunMode.RUN)
    if EVERY_KEY in overrides:
        config.hydra.help.template += "\nevery key and its value (KEY=VALUE):\n\n$CONFIG"
    shown = complete.complete(hydra.get_sanitized_cfg(copied(config), "job"))
    return str(hydra.get_help(config.hydra.help, shown, _parser(entry), resolve=False))


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise ConfigError(f"{self.prog}: {message} (auvbench {self.prog} --help)")


def _parser(entry: str) -> argparse.ArgumentParser:
    parser = _Parser(prog=entry, add_help=False, allow_abbrev=False)
    parser.add_argument("overrides", nargs="*", help="key=value")
    for names in (("-h", "--help"), ("-m", "--multirun")):
        parser.add_argument(*names, action="store_true")
    parser.add_argument("-c", "--cfg", choices=("job",))
    return parser


def _parse(entry: str, arguments: Sequence[str], *, dry: bool = False) -> argparse.Namespace:
    """Parse the flags; raise ConfigError for an unknown flag, and suggest the override or flag that was probably meant."""
    parser = _parser(entry)
    if dry:
        parser.add_argument("--dry-run", action="store_true")
    parsed, remaining = parser.parse_known_args(list(arguments))
    for word in remaining:
        if re.match(r"--?[A-Za-z]", word):
            keys = typing.leaves(OmegaConf.to_container(_compose(entry, ())))
            flags = [name for action in parser._actions for name in action.option_strings]
            raise ConfigError(suggestions.unknown_flag(entry, word, flags, keys, arguments))
    parsed.overrides += remaining
    if parsed.multirun and parsed.cfg:
        raise ConfigError("--cfg job shows one configuration: leave out -m, and give each key one value")
    if dry and parsed.dry_run and parsed.cfg:
        raise ConfigError("--cfg job shows a configuration, --dry-run lists runs: give one of them")
    return parsed


def translate(error: BaseException, entry: str = "train", overrides: Sequence[str] = ()) -> ConfigError:
    """Return a one-line error for an error of Hydra or OmegaConf, with the value and the closest valid name."""
    return typing.translate(error, lambda words: _compose(entry, words), entry, overrides)
