"""What the Tab key offers for commands whose words Hydra does not read: names, flags and their values.

Imports nothing heavy, because a user waits: a test holds what is listed here against what the commands accept.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from auvbench.commands.grammar import WHERE, Parser
from auvbench.config import options
from auvbench.metrics import METRICS
from auvbench.record import measure_names

STATES = ("pending", "running", "interrupted", "failed", "complete")
SORTS = ("name", "id", "state", "algo", "seed", "progress", "success", "wall", "created")
KEYS = ("algo", "vehicle", "reward.k", "step.frequency", "seed", "disturbance", "noise", "train.total_steps")
"""of a configuration, that runs are told apart by"""


def _protocols() -> list[str]:
    return options.names("protocol")


def _algorithms() -> list[str]:
    return options.names("algo")


def _formats() -> list[str]:
    from auvbench.commands.report_options import FORMATS

    return list(FORMATS)


def _studies() -> list[str]:
    from auvbench.commands.report_options import STUDIES

    return list(STUDIES)


FURTHER = tuple(metric.name for metric in METRICS if metric.kind == "agent")
"""of `report --columns`; those of `analysis.optional_columns`, whose import takes too long for a key press"""

VALUES: dict[str, Callable[[], Sequence[str]]] = {
    "--protocol": _protocols,
    "--rank-by": measure_names,
    "--then": measure_names,
    "--metric": measure_names,
    "--format": _formats,
    "--study": _studies,
    "--group-by": lambda: KEYS,
    "--columns": lambda: KEYS,
    "--baseline": _algorithms,
    "--vehicle": lambda: options.names("vehicle"),
    "--algo": _algorithms,
    "--state": lambda: STATES,
    "--sort": lambda: SORTS,
}
"""Of flags of any command."""

OVERRIDES: dict[str, dict[str, Callable[[], Sequence[str]]]] = {
    "evaluate": {
        "protocol": _protocols,
        "force": lambda: ("true",),
        "workers": lambda: (),
        "protocol.episodes": lambda: (),
    },
    "serve": {
        "vehicle": lambda: options.names("vehicle"),
        "simulator": lambda: options.names("simulator"),
        "disturbance": lambda: options.names("disturbance"),
        "step.frequency": lambda: (),
        "task.start": lambda: (),
    },
    "bound": {
        "protocol": _protocols,
        "vehicle": lambda: options.names("vehicle"),
        "workers": lambda: (),
        "passes": lambda: ("1", "2"),
        "output": lambda: (),
        "force": lambda: ("true",),
    },
    "resume": {"train.total_steps": lambda: ()},
}
"""Of commands that take some `key=value`."""

TERMS: dict[str, Callable[[], Sequence[str]]] = {
    **{key: (lambda: ()) for key in KEYS},
    "algo": _algorithms,
    "vehicle": lambda: options.names("vehicle"),
    "disturbance": lambda: options.names("disturbance"),
    "noise": lambda: options.names("noise"),
    "state": lambda: STATES,
    "id": lambda: (),
    "experiment": lambda: (),
}
"""What `--where` asks for."""


HYDRA_FLAGS = {
    "train": ("-m", "--cfg", "--help"),
    "tune": ("--cfg", "--trust", "--help"),
    "evaluate": (WHERE, "--cfg", "--trust", "--help"),
    "bound": ("--check", "--help"),
}
"""Flags of the commands that Hydra parses."""


def candidates(words: Sequence[str]) -> list[str]:
    """What the last word may become.

    Args:
        words: those typed after `auvbench`; the last is the one being typed, perhaps empty.

    >>> candidates(["evaluate", "outputs", "protocol=th"])
    ['protocol=thesis']
    >>> candidates(["runs", "--state", "failed,pe"])
    ['failed,pending']
    >>> candidates(["tune", "--t"])
    ['--trust']
    """
    if len(words) < 2:
        return []
    command, *before, word = words
    parser = _parser(command)
    offered = [name for name in parser.flags() if word.startswith("-")] if parser is not None else []
    if word.startswith("-"):
        offered += HYDRA_FLAGS.get(command, ())
    flag = before[-1] if before else ""
    known = parser.flags() if parser is not None else []
    if (command, flag) == ("report", "--columns"):
        offered = _listed(FURTHER, word)
    elif flag in VALUES and flag in known:
        offered = _listed(VALUES[flag](), word)
    elif _in_where(before):
        offered += _assignments(TERMS, word)
    else:
        offered += _assignments(OVERRIDES.get(command, {}), word)
        if command == "vehicles":
            offered += options.names("vehicle")
    return sorted({name for name in offered if name.startswith(word)})


def _parser(command: str) -> Parser | None:
    from importlib import import_module

    modules = {"report": "report_options", "evaluate": "", "bound": ""}
    name = modules.get(command, command)
    made = getattr(import_module(f"auvbench.commands.{name}"), "parser", None) if name else None
    found = made() if made is not None else None
    return found if isinstance(found, Parser) else None


def _in_where(before: Sequence[str]) -> bool:
    """Whether the word being typed is a term: only terms stand between it and `--where`."""
    for word in reversed(before):
        if word == WHERE:
            return True
        if "=" not in word:
            return False
    return False


def _assignments(keys: dict[str, Callable[[], Sequence[str]]], word: str) -> list[str]:
    """`key=` while the key is typed, then `key=value`."""
    key, separator, value = word.partition("=")
    if not separator:
        return [f"{name}=" for name in keys]
    return [f"{key}={one}" for one in _listed(keys.get(key, lambda: ())(), value)]


def _listed(values: Sequence[str], word: str) -> list[str]:
    """The values behind those of a comma list that are typed already."""
    done, comma, _ = word.rpartition(",")
    taken = done.split(",")
    return [f"{done}{comma}{value}" for value in values if value not in taken]
