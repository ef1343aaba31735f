"""Parse the command's name, import only the module of this command, and report each error in one line.

This module imports nothing heavy, so that help and completion answer at once. A test asserts that `--help`
does not import torch, hydra, numba or pandas.

For a user error, a full disk or an interruption, the line gives the reason. Any other exception is a defect of
auvbench: the traceback is saved in a file, the line names the file, and the exit code is 70 (EX_SOFTWARE of sysexits.h).
"""

from __future__ import annotations

import errno
import os
import platform
import shlex
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path

from auvbench import __version__, isolation
from auvbench.errors import (
    AgentError,
    AuvbenchError,
    PluginImportError,
    UserError,
    closest,
    plain_warnings,
)
from auvbench.registry import COMMANDS, resolve, telling
from auvbench.untrusted.text import forgiving, message, present, say, short, silence

CORRECTIONS = {
    **dict.fromkeys(("list", "ls", "status", "ps"), "runs"),
    **dict.fromkeys(("test", "eval", "benchmark"), "evaluate"),
    **dict.fromkeys(("rank", "table", "plot", "show"), "report"),
    **dict.fromkeys(("learn", "run", "fit", "start"), "train"),
    **dict.fromkeys(("view", "render", "play", "film"), "replay"),
    **dict.fromkeys(("continue", "extend"), "resume"),
    **dict.fromkeys(("optimise", "optimize", "search"), "tune"),
    **dict.fromkeys(("diff", "versus"), "compare"),
    **dict.fromkeys(("new", "create"), "init"),
}
"""Command names of similar programs, each with the auvbench command to suggest."""

DEFECT = 70

_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM, errno.EIO, errno.ESTALE)
_NAMED = (errno.ENAMETOOLONG, errno.ELOOP, errno.ENOTDIR, errno.EISDIR)


def usage() -> str:
    titles = {name: COMMANDS[name].title for name in COMMANDS.own}
    titles |= {point.name: f"of {point.release}" for point in COMMANDS.declared()}
    width = max(map(len, titles))
    lines = [f"  {name:<{width}}  {text}" for name, text in titles.items()]
    return "\n".join(
        [
            "usage: auvbench COMMAND [ARGUMENTS]",
            "",
            "A benchmark of classical control and reinforcement learning for underwater vehicles.",
            "",
            "commands:",
            *lines,
            "",
            "  auvbench COMMAND --help   what a command takes",
            "  auvbench --version        the version",
            "",
            "first steps:",
            "  auvbench train algo=ppo reward.k=1",
            "  auvbench train -m algo=pid,ppo seed=0,1,2,3,4",
            "  auvbench evaluate outputs && auvbench report outputs",
        ]
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code.

    Exit codes: 0 success, 1 failure, 2 user error, 70 defect of auvbench (see `guarded`), 130 interrupted.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    with isolation.restored():
        return guarded(lambda: _dispatch(arguments), arguments)


def _dispatch(arguments: Sequence[str]) -> int:
    isolation.isolate()
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(usage())
        return 0
    if arguments[0] == "-V" or (arguments[0] in (*COMMANDS.own, "--version") and "--version" in arguments):
        print(f"auvbench {__version__}")
        return 0
    plain_warnings()
    name, remaining = arguments[0], arguments[1:]
    point = None if name in COMMANDS.own else COMMANDS.find(name)
    if point is None and name not in COMMANDS.own:
        hint = (
            f"did you mean {CORRECTIONS[name]!r}?"
            if name in CORRECTIONS
            else closest(short(name), COMMANDS.names())
        )
        raise UserError(f"unknown command {short(name)!r}; {hint}")
    try:
        os.getcwd()
    except OSError as error:
        raise UserError(f"the working directory is gone ({error.strerror}): cd to another folder") from None
    if point is None:
        return int(resolve(COMMANDS[name].code)(remaining) or 0)
    spec = COMMANDS.enter(point)
    with telling(f"auvbench {name} of {point.release}", "fails"):
        return int(resolve(spec.code)(remaining) or 0)


def guarded(command: Callable[[], int], arguments: Sequence[str]) -> int:
    """Call `command` and return its exit code; if it raises an error, report the error and return the error's exit code.

    Args:
        command: function to call.
        arguments: command line, which the report of a defect quotes.
    """
    present()
    forgiving()
    code = _carried_out(command, arguments)
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        silence(sys.stdout)  # The reader of the pipe (head, less) closed the pipe: not an error.
    except (OSError, ValueError) as error:
        code = code or _failed(error, arguments)
        silence(sys.stdout)
    try:
        sys.stderr.flush()
    except (OSError, ValueError):
        silence(sys.stderr)
    return code


def _carried_out(command: Callable[[], int], arguments: Sequence[str]) -> int:
    try:
        return command()
    except SystemExit as leaving:  # argparse and Hydra exit this way after --help.
        return leaving.code if isinstance(leaving.code, int) else int(leaving.code is not None)
    except KeyboardInterrupt as interruption:
        # auvbench's own message names the signal and what was saved.
        say(f"auvbench: {message(str(interruption) or 'interrupted')}")
        return int(getattr(interruption, "exit_code", 130))
    except BrokenPipeError:
        silence(sys.stdout)
        return 0
    except Exception as error:
        return _failed(error, arguments)


def _failed(error: Exception, arguments: Sequence[str]) -> int:
    if isinstance(error, AuvbenchError):
        text = str(error)
        if isinstance(error, AgentError | PluginImportError):
            from auvbench.runs.error_file import naming_traceback

            text = naming_traceback(error)
        say(f"auvbench: {message(text)}")
        return error.exit_code
    if type(error).__module__.partition(".")[0] in ("omegaconf", "hydra"):
        # An interpolation such as ${nope} fails when its value is first read, which may be in any module.
        from auvbench.config.compose import translate

        say(f"auvbench: {message(translate(error))}")
        return 2
    if isinstance(error, MemoryError):
        say("auvbench: out of memory; files that were already written are intact")
        return 1
    if isinstance(error, OSError) and error.errno in _DISK:
        from auvbench.runs.atomic_io import storage_error

        say(f"auvbench: {message(storage_error(error, 'cannot go on'))}")
        return 1
    if isinstance(error, OSError) and error.errno in _NAMED:
        say(f"auvbench: {short(error.filename or 'a path')}: {error.strerror}")
        return 2
    saved = _save(error, arguments)
    where = f"; details: {saved}" if saved else " (and no details could be saved)"
    reason = short(f"{type(error).__name__}: {error}")
    say(f"auvbench: internal error, not caused by your input: {reason}{where}")
    return DEFECT


def _save(error: BaseException, arguments: Sequence[str]) -> Path | None:
    """Write versions, command and traceback into a new file; return None if no folder is writable."""
    from auvbench.runs import error_file

    return error_file.save(_details(error, arguments))


def _details(error: BaseException, arguments: Sequence[str]) -> str:
    from auvbench.runs import provenance

    lines = [
        f"auvbench {__version__} failed with an unexpected error. Please report this file: open an issue,",
        "or follow SECURITY.md if the error could be misused. Nothing in this file was sent anywhere.",
        "",
        f"command: {shlex.join(['auvbench', *arguments])}",
        f"folder: {os.environ.get('PWD', '')}",
        f"platform: {platform.platform()}",
        *(f"{name}: {version}" for name, version in provenance.versions().items()),
        "",
    ]
    return "\n".join(lines) + "\n" + "".join(traceback.format_exception(error))


if __name__ == "__main__":
    sys.exit(main())
