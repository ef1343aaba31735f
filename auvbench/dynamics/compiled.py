"""Compiling with a cache on disk that notices every change.

numba's own looks at the file of a function and not at what the function calls or which constants it imports: after a
change in another file it would go on running the old code. `compiled` makes the cache look at all the sources that a
function may reach into. What only other compiled functions call is compiled into them and not cached by itself: a
plain `njit` does for it.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit

PACKAGE = Path(__file__).parent.parent

F = TypeVar("F", bound=Callable[..., Any])


def inline(function: F) -> F:
    """Compile a small function of a kernel into its callers, so that its tuples cost nothing and their loops stay vectorised."""
    return cast(F, njit(nogil=True, forceinline=True)(function))


def compiled(*folders: str, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """`njit`, without the interpreter's lock and cached until a source changes that the function came from.

    Args:
        folders: of the package, besides the function's own, whose functions or constants it uses.
        options: more of `njit`'s.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher: Any = njit(cache=True, nogil=True, **options)(function)
        if dispatcher is function:  # NUMBA_DISABLE_JIT: a debugger wants to see the Python
            return function
        paths = (Path(function.__code__.co_filename).parent, *(PACKAGE / folder for folder in folders))
        # What the cache compares before it trusts its content: a stamp of the function's file. numba has no public
        # way to add to it; a cell in the function's closure would do, but takes a function around each function.
        index = dispatcher._cache._cache_file
        index._source_stamp = (index._source_stamp, *map(fingerprint, paths))
        _tell_of_compiling(dispatcher)
        return dispatcher

    return decorate


def _tell_of_compiling(dispatcher: Any) -> None:
    """Has a line printed, once in a process, when a function is not in the cache and so must be compiled."""
    stored = dispatcher._cache.load_overload

    def load(*arguments: Any) -> Any:
        found = stored(*arguments)
        if found is None:
            announce()
        return found

    dispatcher._cache.load_overload = load


@cache
def announce() -> None:
    """Says on standard error what takes so long."""
    print(
        "auvbench: compiling for this machine; the first use takes up to half a minute, later ones do not",
        file=sys.stderr,
        flush=True,
    )


@cache
def fingerprint(folder: Path) -> str:
    """A digest of the names and contents of all Python files in a folder."""
    digest = hashlib.sha256()
    for path in sorted(folder.glob("*.py")):
        digest.update(f"{path.name} {path.stat().st_size} ".encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()
