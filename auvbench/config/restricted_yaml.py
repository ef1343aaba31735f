"""Restrict Hydra's files of `./conf` to values: a configuration cannot name code.

Hydra instantiates what `_target_` names, configures logging by the classes that a file names, sets
environment variables, and imports packages to search them. A downloaded folder with a `conf/` would thus run
its author's code when the user types `auvbench train` in this folder. So auvbench rejects a file that does any of this.
"""

from __future__ import annotations

import io
import os
import warnings
from collections.abc import Iterator
from dataclasses import replace
from functools import cache, lru_cache
from importlib import resources
from pathlib import Path
from typing import Any

import yaml
from hydra._internal.core_plugins.file_config_source import FileConfigSource
from hydra._internal.core_plugins.importlib_resources_config_source import ImportlibResourcesConfigSource
from hydra._internal.sources_registry import SourcesRegistry
from hydra.plugins.config_source import ConfigResult, ConfigSource
from omegaconf import DictConfig, OmegaConf
from omegaconf._utils import get_yaml_loader

from auvbench.config import folders, schema
from auvbench.config.copies import copied
from auvbench.errors import AuvbenchWarning, ConfigError
from auvbench.untrusted import reading
from auvbench.untrusted.text import plain, short

SCHEME, INSTALLED, PACKAGE = "conf", "installed", "package"

ALLOWED = ("hydra.mode", "hydra.sweeper.grids", "hydra.sweeper.params", "hydra.help")
"""Hydra's own keys that a file or an override may set"""

ENTRIES = ("train.yaml", "evaluate.yaml", "tune.yaml", "simulate.yaml")
"""main configuration files of the commands; many other programs that use Hydra also have a conf/train.yaml"""


class OwnFiles(FileConfigSource):
    """Hydra's file source for `./conf`: limited in size, without code, and without files from outside the folder."""

    closed = True
    """whether ".." and links out of the folder are rejected"""

    def __init__(self, provider: str, path: str) -> None:
        ConfigSource.__init__(self, provider=provider, path=path)

    @staticmethod
    def scheme() -> str:
        return SCHEME

    def is_config(self, config_path: str) -> bool:
        if not super().is_config(config_path):
            return False
        name = self._normalize_file_name(config_path)
        return name not in ENTRIES or _is_ours(os.path.join(self.path, name), name)

    def load_config(self, config_path: str) -> ConfigResult:
        name = self._normalize_file_name(config_path)
        path = os.path.realpath(os.path.join(self.path, name))
        shown = os.path.join(os.path.basename(self.path), name)
        if not os.path.exists(path):
            return super().load_config(config_path)  # raises the error
        if self.closed and not Path(path).is_relative_to(os.path.realpath(self.path)):
            raise ConfigError(f"{plain(shown)}: is outside conf/; copy the file into conf/")
        try:
            text = _text(reading.content(path))
        except UnicodeDecodeError as error:
            raise ConfigError(f"{shown}: is not UTF-8 text: {error.reason} at byte {error.start}") from None
        except ValueError as error:
            raise ConfigError(f"{shown}: {error}") from None
        config, header = _read(shown, name, path, text)
        return ConfigResult(
            provider=self.provider,
            path=f"{self.scheme()}://{self.path}",
            config=copied(config),
            header=dict(header),
        )


@lru_cache(maxsize=512)
def _text(data: bytes) -> str:
    """Check that a file's YAML is safe to load, and return its text; cached, since Hydra reads a file several times."""
    reading.check_yaml(data)
    return data.decode("utf-8-sig")  # Windows editors may begin a file with a byte order mark.


@lru_cache(maxsize=512)
def _read(shown: str, name: str, path: str, text: str) -> tuple[DictConfig, dict[str, str | None]]:
    """Parse a file's text into a configuration and a header; the caller must not change either."""
    header = ConfigSource._get_header_dict(text[:512])
    stream = io.StringIO(text)
    stream.name = path  # for the position in an error message
    content = yaml.load(stream, Loader=get_yaml_loader())
    if not isinstance(content, dict | None):
        raise ConfigError(f"{shown}: must map keys to values, e.g. seed: 1")
    group = os.path.dirname(name)
    if header["package"] is None and group == "experiment":
        header["package"] = "_global_"  # an experiment sets keys of the whole configuration
    check_file(shown, name, content, header["package"])
    package = header["package"] or group.replace(os.sep, ".")
    return OmegaConf.create(_with_whole_numbers(content or {}, package.removeprefix("_global_"))), header


class InstalledFiles(OwnFiles):
    """Hydra's file source for the folder of an installed package; no two packages may have the same file."""

    closed = False  # package managers may install files as links

    @staticmethod
    def scheme() -> str:
        return INSTALLED

    def load_config(self, config_path: str) -> ConfigResult:
        name = self._normalize_file_name(config_path)
        holders = [release for release, folder in folders.packages() if (folder / name).is_file()]
        if (resources.files("auvbench.conf") / name).is_file():
            holders.append("auvbench itself")
        if len(holders) > 1:
            option = "=".join(name.removesuffix(".yaml").replace(os.sep, "/").rsplit("/", 1))
            raise ConfigError(
                f"{option}: {' and '.join(holders)} have the same file; uninstall one of them: "
                f"pip uninstall {holders[0].partition('==')[0]}"
            )
        return super().load_config(config_path)


class PackageFiles(ImportlibResourcesConfigSource):
    """Hydra's file source for a package that does not change while the program runs: each file is parsed once."""

    @staticmethod
    def scheme() -> str:
        return PACKAGE

    def load_config(self, config_path: str) -> ConfigResult:
        result = _parsed(self.provider, self.path, config_path)
        return replace(result, config=copied(result.config), header=dict(result.header))


@cache
def _parsed(provider: str, package: str, config_path: str) -> ConfigResult:
    return ImportlibResourcesConfigSource(provider, f"pkg://{package}").load_config(config_path)


def _is_ours(path: str, name: str) -> bool:
    """Return whether a file that is named like one of `ENTRIES` starts from auvbench's schema; warn if it does not."""
    try:
        ours = f"{name.removesuffix('.yaml')}_schema".encode() in reading.content(path)
    except (OSError, ValueError):
        ours = True  # Hydra loads the file later, and then reports what is wrong with the file.
    if not ours:
        _pass_over(path)
    return ours


@cache
def _pass_over(path: str) -> None:
    shown = os.path.join(os.path.basename(os.path.dirname(path)), os.path.basename(path))
    warnings.warn(
        f"{shown} is ignored: it is not a configuration of auvbench, because its defaults do not name "
        f"{os.path.basename(path).removesuffix('.yaml')}_schema",
        AuvbenchWarning,
        stacklevel=2,
    )


def _with_whole_numbers(node: Any, prefix: str) -> Any:
    """Return a file's values; 1e6, a float in YAML, becomes a whole number if the key needs one."""
    from auvbench.config.overrides import whole_keys  # imported late: it imports this module

    if isinstance(node, dict):
        above = f"{prefix}." if prefix else ""
        return {key: _with_whole_numbers(value, f"{above}{key}") for key, value in node.items()}
    if isinstance(node, list):
        return [_with_whole_numbers(value, prefix) for value in node]
    if isinstance(node, float) and prefix in whole_keys():
        number = schema.whole(repr(node))
        return node if number is None else number
    return node


def register() -> None:
    """Register the schemes `conf`, `installed` and `package` with Hydra's search path."""
    for source in (OwnFiles, InstalledFiles, PackageFiles):
        SourcesRegistry.instance().register(source)


def check_file(shown: str, name: str, content: Any, package: str | None) -> None:
    """Raise ConfigError for a file that names code or sets one of Hydra's own keys.

    Args:
        shown: name of the file in messages.
        name: path of the file below the folder, e.g. `experiment/mine.yaml`.
        content: content of the file; interpolations are text.
        package: package in the file's header `# @package ...`, if it has one.

    Raises:
        ConfigError: the message names the key.
    """
    for key in _keys(content, ""):
        if key.rpartition(".")[2] == "_target_":
            raise ConfigError(f"{shown}: {short(key)}: a configuration cannot name code; remove the key")
    group = os.path.dirname(name).replace(os.sep, ".")
    for where in (group, package or ""):
        if _is_hydra(where) and not where.startswith("hydra.help"):
            raise ConfigError(
                f"{shown}: files for {short(where)} are not allowed in your own conf/; remove the file"
            )
    if not isinstance(content, dict):
        return
    for entry in content.get("defaults") or ():
        for text in [entry] if isinstance(entry, str) else list(entry) if isinstance(entry, dict) else []:
            if "@" in str(text) and _is_hydra(str(text).partition("@")[2]):
                raise ConfigError(
                    f"{shown}: defaults: {short(text)}: must not set Hydra's own keys; remove it"
                )
    for key in _keys({"hydra": content.get("hydra")}, ""):
        if not any(
            f"{key}.".startswith(f"{allowed}.") or allowed.startswith(f"{key}.") for allowed in ALLOWED
        ):
            raise ConfigError(
                f"{shown}: {short(key)}: a file cannot set this key; valid: {', '.join(ALLOWED)}"
            )


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
