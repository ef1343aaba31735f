"""The one small hierarchy of errors.

Every message of a `UserError` names the offending value and what would be right: it is printed as one line
and the command ends with exit code 2. Anything else that is raised is a defect of auvbench: its traceback is
saved in a file that the command's one line names (cli.py).
"""

from __future__ import annotations

import difflib
import warnings
from collections.abc import Iterable


class AuvbenchError(Exception):
    """Base class of everything that auvbench raises on purpose."""

    exit_code = 1


class UserError(AuvbenchError):
    """Something the user typed, or a file the user named, is not right. Exit code 2."""

    exit_code = 2


class ConfigError(UserError):
    """A key, a type or a value of the configuration is not right."""


class PluginImportError(ConfigError):
    """The code of an installed package cannot be imported."""


class VehicleError(UserError):
    """A vehicle sheet breaks a rule; the message names the line and the rule."""


class RunError(UserError):
    """A run directory is missing, damaged, foreign or held by another process."""


class ReportError(UserError):
    """There is nothing to report on, or what was asked for is not in the runs."""


class MissingExtraError(UserError):
    """A part of auvbench needs packages that only come with one of its extras."""

    def __init__(self, package: str, *, extra: str, purpose: str) -> None:
        super().__init__(
            f"{package} is not installed (needed for {purpose}): pip install 'auvbench[{extra}]'"
        )


class TrainingError(AuvbenchError):
    """A run stopped for a reason of its own (a NaN, a full disk); its manifest says which. Exit code 1."""


class ActionError(AuvbenchError, ValueError):
    """What was given as an action is none: a NaN, an infinity, or another shape than the environment takes."""


class AgentError(AuvbenchError):
    """An agent, a simulator, a task or a reward of an installed package does not do what it must; the message names it."""


class AuvbenchWarning(UserWarning):
    """Something is not as it should be and is dealt with; the message says how."""


_python_s = warnings.formatwarning


def _one_line(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None
) -> str:
    if issubclass(category, AuvbenchWarning):
        # One line, and nothing in it that a terminal would obey: a warning may name files of a stranger's.
        text = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in str(message))
        return f"auvbench: warning: {text}\n"
    return _python_s(message, category, filename, lineno, line)


def plain_warnings() -> None:
    """Our warnings are for users: printed without the place in the code from which they come."""
    warnings.formatwarning = _one_line


def closest(name: str, valid: Iterable[str]) -> str:
    """The hint that ends an error message: the closest valid name, letter case aside, and all of them.

    >>> closest("bluerov", ["bluerov2", "rexrov"])
    "did you mean 'bluerov2'? valid: bluerov2, rexrov"
    >>> closest("zzz", ["pid", "ppo"])
    'valid: pid, ppo'
    >>> closest("pdi", ["PID", "SAC K=1"])
    "did you mean 'PID'? valid: PID, SAC K=1"
    """
    names = sorted(set(valid))
    by_letters = {known.casefold(): known for known in reversed(names)}
    near = difflib.get_close_matches(name.casefold(), by_letters, n=1, cutoff=0.5)
    hint = f"did you mean {by_letters[near[0]]!r}? " if near else ""
    return f"{hint}valid: {', '.join(names)}"
