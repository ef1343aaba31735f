"""Hydra's loader for the files of `./conf`, restricted to values: a configuration names no code.

Hydra instantiates what `_target_` names, configures logging by the classes that a file names, sets environment
variables and imports packages to search them. A downloaded folder with a `conf/` would run its author's code for the
user who types `auvbench train` there. So all of this is refused, in each file (`OwnFiles`) and in the composed
configuration (`CheckedLoader`).
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import resources
from typing import Any

from hydra._internal import hydra as hydra_application
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.core_plugins.file_config_source import FileConfigSource
from hydra._internal.sources_registry import SourcesRegistry
from hydra.plugins.config_source import ConfigResult, ConfigSource
from omegaconf import DictConfig, OmegaConf

from auvbench.config import plugins
from auvbench.errors import ConfigError
from auvbench.untrusted import documents, reading
from auvbench.untrusted.text import short

SCHEME, INSTALLED = "conf", "installed"

ALLOWED = (
    "hydra.mode",
    "hydra.sweeper.grids",
    "hydra.sweeper.params",
    "hydra.help",
    "hydra.run.dir",
    "hydra.sweep.dir",
    "hydra.sweep.subdir",
    "hydra.output_subdir",
    "hydra.job.chdir",
)
"""Hydra's own keys that a file may set"""

_FIXED = {
    "hydra.run.dir": ".",
    "hydra.sweep.dir": ".",
    "hydra.sweep.subdir": ".",
    "hydra.output_subdir": None,
    "hydra.job.chdir": False,
}
"""their only valid values: with others Hydra would make folders and change into them"""

_TARGETS = {
    "hydra.launcher": ("hydra_plugins.auvbench_launcher.Compose", "hydra._internal.core_plugins."),
    "hydra.sweeper": ("hydra_plugins.auvbench_launcher.Grids", "hydra._internal.core_plugins."),
}

_EMPTY = ("hydra.callbacks", "hydra.job.env_set", "hydra.job.env_copy", "hydra.searchpath")
_NO_LOGGING = {"version": 1, "root": None, "disable_existing_loggers": False}


class OwnFiles(FileConfigSource):
    """Hydra's source of files for `./conf`: bounded, and without code."""

    def __init__(self, provider: str, path: str) -> None:
        ConfigSource.__init__(self, provider=provider, path=path)

    @staticmethod
    def scheme() -> str:
        return SCHEME

    def load_config(self, config_path: str) -> ConfigResult:
        name = self._normalize_file_name(config_path)
        path = os.path.realpath(os.path.join(self.path, name))
        shown = os.path.join(os.path.basename(self.path), name)
        if os.path.exists(path):
            try:
                documents.check_yaml(reading.content(path))
            except ValueError as error:
                raise ConfigError(f"{shown}: {error}") from None
        result = super().load_config(config_path)
        check_file(shown, name, OmegaConf.to_container(result.config), result.header.get("package"))
        return result


class InstalledFiles(OwnFiles):
    """Hydra's source of files for the folder of an installed package; a file's name must be unique among all packages."""

    @staticmethod
    def scheme() -> str:
        return INSTALLED

    def load_config(self, config_path: str) -> ConfigResult:
        name = self._normalize_file_name(config_path)
        holders = [f.release for f in plugins.folders() if (f.path / name).is_file()]
        if (resources.files("auvbench.conf") / name).is_file():
            holders.append("auvbench itself")
        if len(holders) > 1:
            stem = name.removesuffix(".yaml").replace(os.sep, "/")
            raise ConfigError(
                f"{'='.join(stem.rsplit('/', 1))}: {' and '.join(holders)} have a file of that name each, and a name "
                f"must stand for one; uninstall one of them: pip uninstall {holders[0].partition('==')[0]}"
            )
        return super().load_config(config_path)


def installed_sources() -> list[tuple[str, str]]:
    """Return provider and path, on Hydra's search path, of the folders of installed packages.

    Raises:
        ConfigError: a folder does not exist.
    """
    return [(folder.release, f"{INSTALLED}://{folder.path}") for folder in plugins.folders()]


def register() -> None:
    """Register `conf://FOLDER` and `installed://FOLDER` with Hydra's search path."""
    SourcesRegistry.instance().register(OwnFiles)
    SourcesRegistry.instance().register(InstalledFiles)


def check_file(shown: str, name: str, content: Any, package: str | None) -> None:
    """Refuse a file that names code, or sets a key of Hydra's own.

    Args:
        shown: the file, for messages.
        name: its path below the folder, e.g. `experiment/mine.yaml`.
        content: what it holds, interpolations as text.
        package: of its header `# @package ...`, if it has one.

    Raises:
        ConfigError: names the key.
    """
    for key in _keys(content, ""):
        if key.rpartition(".")[2] == "_target_":
            raise ConfigError(f"{shown}: {short(key)}: a configuration names no code; remove the key")
    group = os.path.dirname(name).replace(os.sep, ".")
    for where in (group, package or ""):
        if _is_hydra(where) and not where.startswith("hydra.help"):
            raise ConfigError(f"{shown}: files for {short(where)} are not read from a folder of one's own")
    if not isinstance(content, dict):
        return
    for entry in content.get("defaults") or ():
        for text in [entry] if isinstance(entry, str) else list(entry) if isinstance(entry, dict) else []:
            if "@" in str(text) and _is_hydra(str(text).partition("@")[2]):
                raise ConfigError(f"{shown}: defaults: {short(text)}: nothing is put into Hydra's own keys")
    for key, value in _values(content.get("hydra"), "hydra"):
        allowed = next((a for a in ALLOWED if key == a or key.startswith((f"{a}.", f"{a}["))), None)
        if allowed is None:
            raise ConfigError(
                f"{shown}: {short(key)}: a file in conf/ may not set it; valid: "
                "hydra.mode, hydra.sweeper.grids, hydra.sweeper.params"
            )
        if allowed in _FIXED and value != _FIXED[allowed]:
            raise ConfigError(f"{shown}: {short(key)}={short(value)}: must be {_FIXED[allowed]}")


def check_composed(hydra: Any) -> None:
    """Refuse a composed `hydra` node with which Hydra would call, import or write foreign things.

    Raises:
        ConfigError: names the key.
    """
    root = OmegaConf.create({"hydra": OmegaConf.to_container(hydra)})
    for key in _EMPTY:
        if OmegaConf.select(root, key):
            raise ConfigError(f"{key}: must stay empty: auvbench runs no code that a configuration names")
    for key in ("hydra.job_logging", "hydra.hydra_logging"):
        node = OmegaConf.select(root, key)
        if node is not None and OmegaConf.to_container(node) != _NO_LOGGING:
            raise ConfigError(
                f"{key}: must stay none: auvbench keeps logs of its own, train/log.txt of a run"
            )
    for key, (ours, stock) in _TARGETS.items():
        target = str(OmegaConf.select(root, f"{key}._target_"))
        if target != ours and not target.startswith(stock):
            raise ConfigError(f"{key}._target_={short(target)}: must be {ours}")
    if OmegaConf.select(root, "hydra.output_subdir") is not None:
        raise ConfigError("hydra.output_subdir: must be null: a run's configuration is its config.yaml")


class CheckedLoader(ConfigLoaderImpl):
    """Hydra's loader of configurations, which checks the composed configuration."""

    def load_configuration(self, *arguments: Any, **named: Any) -> DictConfig:
        config = super().load_configuration(*arguments, **named)
        check_composed(config.get("hydra"))
        return config


@contextmanager
def checked() -> Iterator[None]:
    """Replace the loader of Hydra's application, which offers no choice, by `CheckedLoader`."""
    before = vars(hydra_application)["ConfigLoaderImpl"]
    vars(hydra_application)["ConfigLoaderImpl"] = CheckedLoader
    try:
        yield
    finally:
        vars(hydra_application)["ConfigLoaderImpl"] = before


def _is_hydra(package: str) -> bool:
    return "hydra" in package.replace(":", ".").replace("/", ".").split(".")


def _keys(node: Any, prefix: str) -> Iterator[str]:
    if isinstance(node, dict):
        for key, child in node.items():
            yield f"{prefix}{key}"
            yield from _keys(child, f"{prefix}{key}.")
    elif isinstance(node, list):
        for child in node:
            yield from _keys(child, prefix)


def _values(node: Any, path: str) -> Iterator[tuple[str, Any]]:
    if isinstance(node, dict) and node:
        for key, child in node.items():
            yield from _values(child, f"{path}.{key}" if path else str(key))
    elif isinstance(node, list) and node:
        for index, child in enumerate(node):
            yield from _values(child, f"{path}[{index}]")
    elif node is not None or path not in ("", "hydra"):
        yield path, node
