"""Keep auvbench's dependencies from reading files in the working directory.

The working directory may come from another person. auvbench reads only `./conf` and the files that the user
names. By default, its dependencies also read modules, numba's configuration (which names a cache of pickles),
Matplotlib's style and DDS profiles from the working directory. So each process of a command calls `isolate` before
it imports a dependency. Child processes inherit the environment variables that `isolate` sets.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

from auvbench.errors import UserError

DDS = {
    "SKIP_DEFAULT_XML_FILE": "1",  # Fast DDS: skip DEFAULT_FASTRTPS_PROFILES.xml
    "SKIP_DEFAULT_XML": "1",  # new name of this variable in Fast DDS 3
}
ENVIRONMENT = {
    # Child processes do not import modules from the working directory, nor do the two helper processes of
    # multiprocessing.
    "PYTHONSAFEPATH": "1",
    "MATPLOTLIBRC": os.devnull,  # no style file of the user: figures have only auvbench's style
    "MPLBACKEND": "Agg",
    **DDS,
}
"""Variables that auvbench sets in each of its processes."""

ABSOLUTE = (
    "CASADIPATH",
    "CYCLONEDDS_URI",
    "FASTDDS_DEFAULT_PROFILES_FILE",
    "FASTDDS_ENVIRONMENT_FILE",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "MPLCONFIGDIR",
    "NUMBA_CACHE_DIR",
    "ROS_SECURITY_KEYSTORE",
    "XDG_CACHE_HOME",
    "XDG_CONFIG_HOME",
    "XDG_STATE_HOME",
)
"""Environment variables in which the user names settings, libraries or caches. Each path must be absolute, since a relative path
would point into the working directory.
"""

HERE = Path(__file__).parent


def isolate() -> None:
    """Isolate this process; call it before any dependency is imported.

    Raises:
        UserError: a variable of `ABSOLUTE` has a relative path.
    """
    for name in ABSOLUTE:
        for path in _relative(os.environ.get(name, "")):
            raise UserError(
                f"{name}={path}: must be an absolute path; a relative path would point into the working directory"
            )
    os.environ.update(ENVIRONMENT)
    os.environ["MPLCONFIGDIR"] = str(_matplotlib_folder())
    # Remove relative paths, for example the placeholder that setuptools adds for an editable installation. Keep the
    # empty path: only a program that imports auvbench can have added it.
    sys.path[:] = [path for path in sys.path if not path or os.path.isabs(path)]
    if not any(isinstance(finder, _Sheltered) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Sheltered())


@contextmanager
def restored() -> Iterator[None]:
    """Restore the environment variables on exit, since a command may be called by a program that needs its own values."""
    before = {name: os.environ.get(name) for name in (*ENVIRONMENT, "MPLCONFIGDIR")}
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _relative(value: str) -> list[str]:
    r"""Return the relative paths in the value of a variable: a path or, for Cyclone DDS, a list of URIs and XML.

    >>> _relative("file:///etc/dds.xml,a.xml"), _relative("<CycloneDDS>a,b</CycloneDDS>"), _relative("")
    (['a.xml'], [], [])
    """
    pieces = [] if value.lstrip().startswith("<") else re.split("[,:](?!//)", value)
    paths = [piece.strip().removeprefix("file://") for piece in pieces]
    return [path for path in paths if path and not path.startswith(("/", "<"))]


def _matplotlib_folder() -> Path:
    """Return auvbench's own folder for Matplotlib's font list, since the user's Matplotlib folder may contain styles."""
    configured = os.environ.get("MPLCONFIGDIR")
    cache = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    folder = Path(configured) if configured else Path(cache, "matplotlib")
    return folder if folder.name == "auvbench" else folder / "auvbench"


class _Sheltered(MetaPathFinder):
    """Finder that changes to another directory while it imports modules that read files in the working directory.

    No environment variable makes these modules ignore the files.
    """

    modules: dict[str, Callable[[ModuleType], None]]

    def __init__(self) -> None:
        self.modules = {"matplotlib": lambda _: None, "numba.core.config": _forget_numba_file}

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name not in self.modules:
            return None
        specs = (finder.find_spec(name, path, target) for finder in sys.meta_path if finder is not self)
        spec = next((spec for spec in specs if spec is not None), None)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def sheltered(module: ModuleType) -> None:
                with _elsewhere():
                    execute(module)
                self.modules[name](module)

            setattr(spec.loader, "exec_module", sheltered)  # noqa: B010, for mypy
        return spec


def _forget_numba_file(config: ModuleType) -> None:
    """Keep numba from searching for its configuration file when numba reloads the configuration."""
    setattr(config, "_config_fname", os.devnull)  # noqa: B010, for mypy: not a regular file, so never read


@contextmanager
def _elsewhere() -> Iterator[None]:
    """Change to auvbench's own folder, which has no file that a dependency reads; change back on exit."""
    try:
        before = os.open(".", getattr(os, "O_PATH", os.O_RDONLY))  # works even if the folder was removed
    except OSError:
        yield  # A folder that cannot be opened has no files to read.
        return
    try:
        os.chdir(HERE)
        yield
    finally:
        os.fchdir(before)
        os.close(before)
