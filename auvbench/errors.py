"""Define the error classes of auvbench.

The message of a `UserError` names the wrong value and the allowed values. The command prints the message as one
line and ends with exit code 2. An exception that auvbench does not raise on purpose is a defect: its traceback is
saved in a file, and the command prints one line that names the file (cli.py).
"""

from __future__ import annotations

import difflib
import warnings
from collections.abc import Iterable


class AuvbenchError(Exception):
    """Base class of every error that auvbench raises on purpose."""

    exit_code = 1


class UserError(AuvbenchError):
    """An argument, or a file that the user named, is wrong. Exit code 2."""

    exit_code = 2


class ConfigError(UserError):
    """A key, type or value of the configuration is wrong."""


class PluginImportError(ConfigError):
    """The code of an installed package cannot be imported."""


class VehicleError(UserError):
    """A vehicle sheet breaks a rule; the message names the sheet, the key and the rule."""


class RunError(UserError):
    """A run directory is missing, damaged or locked by another process, or auvbench did not create it."""


class ReportError(UserError):
    """The runs contain nothing to report, or lack the data that an option needs."""


class MissingExtraError(UserError):
    """A feature needs an optional package: install auvbench with the extra that contains it."""

    def __init__(self, package: str, *, extra: str, purpose: str) -> None:
        super().__init__(
            f"{package} is not installed (needed for {purpose}): pip install 'auvbench[{extra}]'"
        )


class TrainingError(AuvbenchError):
    """A training stopped because of an error such as a NaN or a full disk; the run's manifest names the error.

    Exit code 1.
    """


class ActionError(AuvbenchError, ValueError):
    """An array is not a valid action: it contains a NaN or infinity, or has the wrong shape."""


class AgentError(AuvbenchError):
    """A part of an installed package (agent, task, reward, simulator, ...) breaks its contract; the message names the part."""


class AuvbenchWarning(UserWarning):
    """A problem that auvbench works around; the message says how."""


_python_s = warnings.formatwarning


def _one_line(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None
) -> str:
    if issubclass(category, AuvbenchWarning):
        # One printable line: a warning may quote file names from an untrusted source, with control characters.
        text = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in str(message))
        return f"auvbench: warning: {text}\n"
    return _python_s(message, category, filename, lineno, line)


def plain_warnings() -> None:
    """Print auvbench's warnings without the source line that raised them."""
    warnings.formatwarning = _one_line


def closest(name: str, valid: Iterable[str]) -> str:
    """Return the hint that ends an error message: the closest valid name, then all valid names.

    Upper and lower case count as equal.

    >>> closest("bluerov", ["bluerov2", "rexrov"])
    "did you mean 'bluerov2'? valid: bluerov2, rexrov"
    >>> closest("zzz", ["pid", "ppo"])
    'valid: pid, ppo'
    >>> closest("pdi", ["PID", "SAC K=1"])
    "did you mean 'PID'? valid: PID, SAC K=1"
    """
    names = sorted(set(valid))
    by_letters = {valid_name.casefold(): valid_name for valid_name in reversed(names)}
    near = difflib.get_close_matches(name.casefold(), by_letters, n=1, cutoff=0.5)
    hint = f"did you mean {by_letters[near[0]]!r}? " if near else ""
    return f"{hint}valid: {', '.join(names)}"
