"""Composing without leaving a trace in Hydra's global state.

Who makes an environment inside a program of their own may use Hydra for that program: its initialisation, its
version base and the schemas it stored are theirs, and are found afterwards as they were.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hydra import version
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.config_search_path_impl import ConfigSearchPathImpl
from hydra.core.config_store import ConfigStore
from hydra.core.plugins import Plugins
from hydra.types import RunMode
from omegaconf import DictConfig, open_dict

from auvbench.config import restricted_yaml

# What is borrowed below belongs to the process.
_LOCK = threading.RLock()


def load(
    module: str,
    entry: str,
    overrides: Sequence[str],
    *,
    folder: Path | None,
    register: Callable[[], None],
) -> DictConfig:
    """The configuration `entry` of the package `module` with overrides applied.

    Args:
        module: the package whose YAML files are composed.
        entry: the entry configuration's name.
        overrides: in Hydra's grammar.
        folder: searched before the package.
        register: stores the schemas that the files name.

    Raises:
        HydraException, OmegaConfBaseException: as Hydra does.
    """
    path = ConfigSearchPathImpl()
    if folder is not None:
        path.append("own", f"{restricted_yaml.SCHEME}://{folder}")
    path.append("hydra", "pkg://hydra.conf")
    for provider, installed in restricted_yaml.installed_sources():
        path.append(provider, installed)
    path.append("main", f"pkg://{module}")
    path.append("schema", "structured://")
    with _LOCK, _borrowed():
        register()
        config = ConfigLoaderImpl(config_search_path=path).load_configuration(
            config_name=entry, overrides=list(overrides), run_mode=RunMode.RUN, from_shell=False
        )
    with open_dict(config):
        del config["hydra"]
    return config


@contextmanager
def _borrowed() -> Iterator[None]:
    """Hydra's version base and store of schemas, given back as they were."""
    Plugins.instance()  # stores schemas of its own, once; they are to stay
    store, base = ConfigStore.instance(), version.VersionBase.instance()
    theirs, repository = base.version_base, store.repo
    store.repo = _copied(repository)
    try:
        version.setbase("1.3")
        yield
    finally:
        store.repo, base.version_base = repository, theirs


def _copied(tree: dict[str, Any]) -> dict[str, Any]:
    return {name: _copied(node) if isinstance(node, dict) else node for name, node in tree.items()}
