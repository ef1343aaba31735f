"""Keep the working directory out of what dependencies read, before any of them is imported.

The working directory may come from another person. auvbench reads `./conf` and the files that were typed; its
dependencies would read more: modules, numba's configuration (which names a cache of pickles), Matplotlib's style, and
the profiles of DDS. `isolate` runs first in each process of a command, and the processes that it starts inherit the
environment.
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
    "SKIP_DEFAULT_XML_FILE": "1",  # Fast DDS reads no DEFAULT_FASTRTPS_PROFILES.xml
    "SKIP_DEFAULT_XML": "1",  # the same since Fast DDS 3
}
ENVIRONMENT = {
    "PYTHONSAFEPATH": "1",  # no child imports modules of the working directory; multiprocessing starts two
    "MATPLOTLIBRC": os.devnull,  # no style but that of the figures
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
"""Variables of the user that name settings, libraries or caches; a relative path would be one of the working directory."""

HERE = Path(__file__).parent


def isolate() -> None:
    """Prepare this process; call it before any dependency is imported.

    Raises:
        UserError: a variable of `ABSOLUTE` has a relative path.
    """
    for name in ABSOLUTE:
        for path in _relative(os.environ.get(name, "")):
            raise UserError(
                f"{name}={path}: must be an absolute path; a relative one names files of the working directory"
            )
    os.environ.update(ENVIRONMENT)
    os.environ["MPLCONFIGDIR"] = str(_matplotlib_folder())
    # setuptools adds a relative placeholder for editable installations. The empty path is of a user's own program.
    sys.path[:] = [path for path in sys.path if not path or os.path.isabs(path)]
    if not any(isinstance(finder, _Sheltered) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Sheltered())


@contextmanager
def restored() -> Iterator[None]:
    """Restore the environment that `isolate` changes inside: a program that calls a command goes on with its own."""
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
    r"""Return the relative paths in a variable: one path, or for Cyclone DDS a list of URIs and XML.

    >>> _relative("file:///etc/dds.xml,a.xml"), _relative("<CycloneDDS>a,b</CycloneDDS>"), _relative("")
    (['a.xml'], [], [])
    """
    pieces = [] if value.lstrip().startswith("<") else re.split("[,:](?!//)", value)
    paths = [piece.strip().removeprefix("file://") for piece in pieces]
    return [path for path in paths if path and not path.startswith(("/", "<"))]


def _matplotlib_folder() -> Path:
    """Return a folder for Matplotlib's list of fonts, beside the folder with the styles of the user."""
    given = os.environ.get("MPLCONFIGDIR")
    cache = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    folder = Path(given) if given else Path(cache, "matplotlib")
    return folder if folder.name == "auvbench" else folder / "auvbench"


class _Sheltered(MetaPathFinder):
    """Import modules that read the working directory while they are imported, with another one.

    For these files no variable has precedence over the working directory.
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
    """Let numba look for no file at later compilations, when it reads its configuration again."""
    setattr(config, "_config_fname", os.devnull)  # noqa: B010, for mypy: not a regular file, so never read


@contextmanager
def _elsewhere() -> Iterator[None]:
    """Work in the folder of the package, which has no file that a dependency reads."""
    try:
        before = os.open(".", getattr(os, "O_PATH", os.O_RDONLY))  # also where the folder was removed
    except OSError:
        yield  # a folder that cannot be opened has no files to read
        return
    try:
        os.chdir(HERE)
        yield
    finally:
        os.fchdir(before)
        os.close(before)
