"""The closest valid key or flag, for error messages. Imports nothing heavy: a mistake in a flag is answered at once."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable

from auvbench.config import schema
from auvbench.config.agents import AGENTS
from auvbench.errors import closest


def nearest(key: str, known: Collection[str]) -> str | None:
    """Return the key that was probably meant: one with this last part, else one that is spelt alike.

    >>> nearest("learning_rate", ["algo.learning_rate", "seed"])
    'algo.learning_rate'
    >>> nearest("device", ["vehicle", "seed"]) is None
    True
    """
    last = key.rpartition(".")[2]
    same = [name for name in known if name.rpartition(".")[2] == last]
    if same:
        return min(same, key=lambda name: (name != key, name.count("."), name))
    return next(iter(difflib.get_close_matches(key, known, n=1, cutoff=0.7)), None)


def owners(key: str) -> list[str]:
    """Return the agents that have a key `algo.<name>`.

    >>> owners("algo.residual.share")
    ['ppo_residual', 'sac_residual']
    """
    return [name for name, spec in AGENTS.items() if key in schema.keys(spec.schema, "algo.")]


def unknown_key(key: str, known: Collection[str], program: str) -> str:
    """Return the hint for a key that a configuration does not have.

    Args:
        key: as typed.
        known: the keys of the configuration.
        program: the command whose `--cfg job` shows all keys, `auvbench train`.
    """
    if having := owners(key):
        return f"only {', '.join(having)} {'has' if len(having) == 1 else 'have'} it"
    near = nearest(key, known)
    question = f"did you mean {near}? " if near else ""
    return f"{question}({program} --cfg job shows all keys)"


def unknown_flag(
    command: str, word: str, flags: Iterable[str], keys: Collection[str] = (), value: str = "-"
) -> str:
    """Return the hint for a flag that a command does not have.

    Args:
        command: its name.
        word: the flag as typed, with `=VALUE` perhaps.
        flags: the valid flags.
        keys: of its configuration, which are typed key=value.
        value: the word that follows.
    """
    flag, separator, own = word.partition("=")
    key = flag.lstrip("-").replace("-", "_")
    meant = min((name for name in keys if f".{name}".endswith(f".{key}")), key=len, default=None)
    if meant is not None:
        shown = own if separator else "VALUE" if value.startswith("-") else value
        return f"{flag}: {command} takes it as {meant}={shown} (key=value is configuration)"
    return f"unknown option {flag!r} of {command}; {closest(flag, flags)}"
