"""Check commands."""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from auvbench import cli
from auvbench.errors import ConfigError, closest
from auvbench.registry import COMMANDS
from auvbench.testing.draws import ConformanceError, run_checks

LONGEST = 100
"""Largest number of characters of a command's title, so that each command fits one line of `auvbench --help`"""


def called(*words: str) -> tuple[int, str, str]:
    """Return exit code, standard output and standard error of `auvbench WORDS`, called in an empty folder, which must stay empty."""
    out, err, before = io.StringIO(), io.StringIO(), os.getcwd()
    with tempfile.TemporaryDirectory(prefix="auvbench-testing-") as folder:
        os.chdir(folder)
        try:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                code = cli.main(list(words))
            files = [path.name for path in Path(folder).iterdir()]
        finally:
            os.chdir(before)
    if files:
        raise ConformanceError(f"auvbench {' '.join(words)} writes {files[0]}")
    return code, out.getvalue(), err.getvalue()


def its_title_is_one_line(name: str) -> None:
    """Check that the title fits one line of `auvbench --help`."""
    title = COMMANDS.choose(name).title
    if not title.strip() or "\n" in title or len(title) > LONGEST:
        raise ConformanceError(f"its title {title!r} must be one line of at most {LONGEST} characters")


def its_help_ends_well(name: str) -> None:
    """Check that `--help` prints something, writes no file, and ends with exit code 0."""
    code, out, err = called(name, "--help")
    if code != 0 or not out.strip():
        raise ConformanceError(
            f"auvbench {name} --help must print help and end with exit code 0, not {code}: {(err or out)[:200]!r}"
        )


def an_unknown_option_is_one_line(name: str) -> None:
    """Check that an unknown option ends with exit code 2 and one line on standard error."""
    option = "--no-such-option"
    code, _, err = called(name, option)
    if code != 2 or err.count("\n") != 1:
        raise ConformanceError(
            f"auvbench {name} {option} must end with exit code 2 and one line of error, not {code} and {err[:200]!r}"
        )


def importing_it_does_nothing(name: str) -> None:
    """Check that importing the command's module prints nothing and writes no file."""
    module = COMMANDS.choose(name).code.partition(":")[0]
    code = f"import importlib; importlib.import_module({module!r})"
    with tempfile.TemporaryDirectory(prefix="auvbench-testing-") as folder:
        paths = os.pathsep.join(path for path in sys.path if path)
        done = subprocess.run(
            [sys.executable, "-c", code],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": paths},
            capture_output=True,
            text=True,
            check=False,
        )
        files = [path.name for path in Path(folder).iterdir()]
    output = (done.stdout + done.stderr).strip()
    if done.returncode != 0 or output or files:
        what = f"writes {files[0]}" if files else f"says {output[-200:]!r}"
        raise ConformanceError(f"importing {module} {what}")


COMMAND_CHECKS: tuple[Callable[[str], None], ...] = (
    its_title_is_one_line,
    its_help_ends_well,
    an_unknown_option_is_one_line,
    importing_it_does_nothing,
)
"""Checks of every command."""


def check_command(name: str, only: Callable[[Any], None] | None = None) -> None:
    """Check a command against its contract (`auvbench.config.commands.CommandSpec`).

    Args:
        name: word after `auvbench`.
        only: one of `COMMAND_CHECKS`; default: all.

    Raises:
        ConformanceError: the command breaks its contract.
        ConfigError: the name is unknown.
    """
    if name not in COMMANDS.names():
        raise ConfigError(f"command={name}: unknown; {closest(name, COMMANDS.names())}")
    run_checks(COMMAND_CHECKS, only, (f"auvbench {name}",), lambda check: check(name))
