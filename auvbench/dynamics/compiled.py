"""Compile functions with a cache on disk that notices every change of their sources.

numba's cache checks only the file of a function, not the functions that it calls or the constants that it imports:
after a change in another file it would run the old code. `compiled` makes the cache check all sources that a function
may use. Functions that only compiled functions call are compiled into them and need no cache: for these, a plain
`njit` is enough.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from llvmlite.ir import Constant
from numba import njit, types
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.core.sigutils import normalize_signature
from numba.extending import intrinsic

INTERPRETED = bool(numba.config.DISABLE_JIT)  # type: ignore[attr-defined]
"""Whether NUMBA_DISABLE_JIT is set, so that Python runs all functions"""

PACKAGE = Path(__file__).parent.parent

F = TypeVar("F", bound=Callable[..., Any])

NO_C: dict[str, Any] = {"no_cfunc_wrapper": True}
"""Options of numba that leave out the entry point for C, which nothing calls"""
INLINED: dict[str, Any] = {"forceinline": True, "no_cpython_wrapper": True, **NO_C}
"""Options of functions that only compiled functions call."""


class Inlined(CPUDispatcher):
    """A compiled function without an entry point for Python; a call from Python runs the source.

    Entry points for all small functions would take a third of the time that a loop needs to compile.
    """

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        return self.py_func(*arguments, **named)


def inline(function: F) -> F:
    """Compile a small function into its callers; a call from Python runs the source.

    The function's tuples then cost nothing, and the callers' loops stay vectorised.
    """
    return _inner(function, INLINED)


def called(function: F) -> F:
    """Compile a larger function that only compiled functions call; a call from Python runs the source."""
    return _inner(function, {**INLINED, "forceinline": False})


def _inner(function: F, options: dict[str, Any]) -> F:
    dispatcher: Any = njit(nogil=True, **options)(function)
    if dispatcher is not function:  # NUMBA_DISABLE_JIT
        dispatcher.__class__ = Inlined
    return cast(F, dispatcher)


@intrinsic
def _borrowed(typing: Any, array: Any) -> Any:
    def without_owner(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        view = context.make_array(array)(context, builder, values[0])
        view.meminfo = Constant(view.meminfo.type, None)
        view.parent = Constant(view.parent.type, None)
        return view._getvalue()

    return array(array), without_owner


@inline
def borrowed(array: Any) -> Any:
    """Return an array without a reference to its owner; the caller must keep the owner alive.

    With a reference to the owner, numba would update the reference count for each row. That update costs more than the rest of a
    loop over episodes.
    """
    return array if INTERPRETED else _borrowed(array)  # type: ignore[call-arg]


def compiled(*folders: str, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator like `njit` that releases the interpreter's lock and whose disk cache becomes invalid if any source changes.

    Args:
        folders: folders of the package whose functions or constants the function uses, in addition to its own folder.
        options: further options of `njit`.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher: Any = njit(cache=True, nogil=True, **NO_C, **options)(function)
        if dispatcher is function:  # NUMBA_DISABLE_JIT is set: a debugger needs the Python function
            return function
        dispatcher.__class__ = Stored
        paths = (Path(function.__code__.co_filename).parent, *(PACKAGE / folder for folder in folders))
        # The cache trusts its content only if the stamp of the function's file is the same. numba has no public way to
        # extend this stamp. A cell in the function's closure would work too, but needs a function around each function.
        index = dispatcher._cache._cache_file
        index._source_stamp = (index._source_stamp, *map(fingerprint, paths))
        _compile_alone(dispatcher)
        return dispatcher

    return decorate


class Stored(CPUDispatcher):
    """A function whose compiled code is stored on disk, for tables of any stride."""

    def compile(self, sig: Any) -> Any:
        arguments, result = normalize_signature(sig)  # type: ignore[no-untyped-call]
        general = tuple(map(_of_any_stride, arguments))
        with global_compiler_lock, ExitStack() as self._locks:
            entry = super().compile(general if result is None else result(*general))
        if general != arguments:  # so that the next call with these types finds the compiled code at once
            self._insert([kind._code for kind in arguments], entry, False)  # type: ignore[attr-defined]
        return entry


def _of_any_stride(kind: Any) -> Any:
    """Return the type of a column or a table, changed so that any number of rows has the same type.

    NumPy calls a column with one row contiguous, but not a column with two rows; numba would compile the function twice.
    """
    if isinstance(kind, types.UniTuple) and isinstance(kind.dtype, types.Array) and kind.count > 1:
        return types.UniTuple(kind.dtype.copy(layout="A"), kind.count)  # type: ignore[no-untyped-call]
    is_column = isinstance(kind, types.Array) and kind.ndim == 1
    if is_column and isinstance(kind.dtype, types.Record | types.Integer):
        return kind.copy(layout="A")
    return kind


PATIENCE = 300.0
"""Longest wait for another process that compiles the same function, s"""


def _compile_alone(dispatcher: Any) -> None:
    """Let one process at a time compile a function that is not in the cache, and announce the compilation.

    The workers of a command need the same functions at the same time: one worker compiles, the other workers wait for its cache.
    """
    stored = dispatcher._cache.load_overload
    index = Path(dispatcher._cache._cache_file._index_path)

    def load(*arguments: Any) -> Any:
        found = stored(*arguments)
        if found is not None:
            return found
        announce()
        from filelock import FileLock  # imported late: rarely needed

        # If the lock fails (a read-only folder, a file system without locks, a process that hangs), compile without it.
        with suppress(OSError, NotImplementedError):
            index.parent.mkdir(parents=True, exist_ok=True)
            dispatcher._locks.enter_context(
                FileLock(index.with_suffix(".lock"), timeout=PATIENCE, fallback_to_soft=False)
            )
        return stored(*arguments)

    dispatcher._cache.load_overload = load


@cache
def announce() -> None:
    """Print on standard error that functions are being compiled."""
    print(
        "auvbench: compiling for this machine; the first use takes up to half a minute, later ones do not",
        file=sys.stderr,
        flush=True,
    )


@cache
def fingerprint(folder: Path) -> str:
    """Return a digest of the names and contents of all Python files in a folder."""
    digest = hashlib.sha256()
    for path in sorted(folder.glob("*.py")):
        digest.update(f"{path.name} {path.stat().st_size} ".encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()
