"""What to type instead: the nearest key, the algorithm that has it, the right one of flag and override.

Imports nothing heavy: a command that finds a mistake in its flags answers at once.
"""

from __future__ import annotations

import dataclasses
import difflib
import typing
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any

from auvbench.config.agents import AGENTS
from auvbench.errors import closest

ELSEWHERE = {
    "device": "auvbench trains on the processor, a thread for each run: the networks are small",
    "cuda": "auvbench trains on the processor, a thread for each run: the networks are small",
    "gpu": "auvbench trains on the processor, a thread for each run: the networks are small",
    "env": "the task is task=, the vehicle vehicle=, the number of environments algo.n_envs=",
    "num_envs": "the number of environments is algo.n_envs=",
    "lr": "the learning rate is algo.learning_rate=",
    "n_timesteps": "the budget is train.total_steps=",
    "total_timesteps": "the budget is train.total_steps=",
    "timesteps": "the budget is train.total_steps=",
    "n_seeds": "seeds are an axis of a grid: -m seed=0,1,2",
    "seeds": "seeds are an axis of a grid: -m seed=0,1,2",
    "workers": "the runs at once are launcher.workers=",
    "jobs": "the runs at once are launcher.workers=",
    "experiment_name": "the folder of the runs is name=",
    "protocol": "a test is chosen where runs are tested: auvbench evaluate outputs protocol=NAME",
    "baseline": "a baseline is chosen where runs are ranked: auvbench report outputs --baseline pid",
    "log_dir": "runs lie in <output>/<name>/<run id>: output=FOLDER, name=NAME",
    "logdir": "runs lie in <output>/<name>/<run id>: output=FOLDER, name=NAME",
}
"""Keys that other programs have, and what stands for them here."""

RUN_KEYS = (
    "algo",
    "vehicle",
    "reward",
    "step",
    "noise",
    "disturbance",
    "task",
    "simulator",
    "train",
    "seed",
    "name",
)
"""The questions whose answers tell runs apart."""


def whole(text: str) -> int | None:
    """The whole number that a text stands for: 1e6 is one, 1.5 is not.

    >>> whole("1e6"), whole("2_000"), whole("1.5"), whole("many")
    (1000000, 2000, None, None)
    """
    try:
        return int(text)
    except ValueError:
        pass
    try:
        number = float(text)
    except ValueError:
        return None
    # Beyond 2^53 a float does not say which whole number is meant.
    return int(number) if number.is_integer() and abs(number) <= 2**53 else None


def nearest(key: str, known: Collection[str]) -> str | None:
    """The key that was probably meant: one with this last part, else one that is spelt alike.

    >>> nearest("learning_rate", ["algo.learning_rate", "seed"])
    'algo.learning_rate'
    >>> nearest("device", ["vehicle", "seed"]) is None
    True
    """
    if key in known:
        return key
    last = key.rpartition(".")[2]
    same = [name for name in known if name.rpartition(".")[2] == last]
    if same:
        return min(same, key=lambda name: (name.count("."), name))
    parent = key.rpartition(".")[0]
    siblings = {name.rpartition(".")[2]: name for name in known if name.rpartition(".")[0] == parent}
    near = difflib.get_close_matches(last, siblings, n=1, cutoff=0.65)
    if near:
        return siblings[near[0]]
    whole = difflib.get_close_matches(key, known, n=1, cutoff=0.7)
    return whole[0] if whole else None


def owners(key: str) -> list[str]:
    """The algorithms that have a key `algo.<name>`.

    >>> owners("algo.tau")
    ['sac', 'ddpg', 'td3', 'tqc', 'sac_residual']
    >>> owners("algo.residual.share")
    ['ppo_residual', 'sac_residual']
    """
    group, _, field = key.partition(".")
    if group != "algo":
        return []
    return [name for name, spec in AGENTS.items() if field in _keys(spec.schema)]


def _keys(schema: type[Any], prefix: str = "") -> Iterator[str]:
    """The keys of a schema and of those in it."""
    types = typing.get_type_hints(schema)
    for field in dataclasses.fields(schema):
        yield f"{prefix}{field.name}"
        if dataclasses.is_dataclass(types[field.name]):
            yield from _keys(types[field.name], f"{prefix}{field.name}.")


def unknown_key(key: str, known: Collection[str], chosen: Mapping[str, str], program: str) -> str:
    """What to say of a key that a configuration does not have.

    Args:
        key: as typed.
        known: the keys of the configuration.
        chosen: the answers that were chosen, by question: {"algo": "ppo"}.
        program: the command whose `--cfg job` shows all keys, `auvbench train`.
    """
    hint = f"{program} --cfg job shows all keys"
    having = owners(key)
    if having and key in known:  # of the first of several: the others lack it
        return f"{_and(having)}, not every algorithm of the grid"
    if having:
        return f"{chosen.get('algo', 'ppo')} has none; {_and(having)} (algo={having[0]})"
    if key in ELSEWHERE:
        return f"{ELSEWHERE[key]} ({hint})"
    near = nearest(key, {*known, *_of_all_algorithms()})
    if near is None:
        return hint
    whose = "" if near in known else f" of {', '.join(owners(near))}"
    return f"did you mean {near}{whose}? ({hint})"


def _and(names: Sequence[str]) -> str:
    """`sac, ddpg and td3 have it`."""
    if len(names) == 1:
        return f"{names[0]} has it"
    return f"{', '.join(names[:-1])} and {names[-1]} have it"


def _of_all_algorithms() -> list[str]:
    return sorted({f"algo.{key}" for spec in AGENTS.values() for key in _keys(spec.schema)})


def unknown_flag(
    command: str, word: str, flags: Iterable[str], keys: Collection[str] = (), value: str | None = None
) -> str:
    """What to say of a flag that a command does not have.

    Args:
        command: its name.
        word: the flag as typed, with `=VALUE` perhaps.
        flags: those it has.
        keys: of its configuration, which are typed key=value.
        value: the word that follows, if any.
    """
    flag, separator, own = word.partition("=")
    key = flag.lstrip("-").replace("-", "_")
    by_last = {name.rpartition(".")[2]: name for name in sorted(keys, key=lambda name: -name.count("."))}
    meant = key if key in keys else by_last.get(key)
    if meant is not None:
        shown = own if separator else value if value and not value.startswith("-") else "VALUE"
        return f"{flag}: {command} takes it as {meant}={shown} (key=value is configuration)"
    if key in ELSEWHERE and keys:
        return f"{flag}: {ELSEWHERE[key]}"
    return f"unknown option {flag!r} of {command}; {closest(flag, flags)}"
