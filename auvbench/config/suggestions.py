"""Suggest the closest valid key or flag in error messages.

Imports nothing heavy, so that a wrong flag is reported at once.
"""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable, Sequence

from auvbench.config import schema
from auvbench.errors import closest
from auvbench.registry import AGENTS


def nearest(key: str, names: Collection[str]) -> str | None:
    """Return the key that was probably meant; None if no key is similar.

    A key with the same last part is preferred to the key with the most similar spelling.

    >>> nearest("learning_rate", ["algo.learning_rate", "seed"])
    'algo.learning_rate'
    >>> nearest("device", ["vehicle", "seed"]) is None
    True
    """
    last = key.rpartition(".")[2]
    same = [name for name in names if name.rpartition(".")[2] == last]
    if same:
        return min(same, key=lambda name: (name != key, name.count("."), name))
    return next(iter(difflib.get_close_matches(key, names, n=1, cutoff=0.7)), None)


def owners(key: str) -> list[str]:
    """Return the agents whose configuration has a key, for example `algo.residual.share`.

    >>> owners("algo.residual.share"), owners("algo.base")
    (['ppo_residual', 'sac_residual'], ['ppo_residual', 'sac_residual'])
    """
    # algo.base chooses a file and is not a key of a configuration.
    key = "algo.residual" if key == "algo.base" else key
    return [name for name in AGENTS.own if key in schema.keys(AGENTS[name].schema, "algo.")]


CORRECTIONS = {
    **dict.fromkeys(("agent", "algorithm", "controller", "policy", "learner"), "algo"),
    **dict.fromkeys(("env", "environment", "scenario"), "task"),
    **dict.fromkeys(("robot", "auv", "sheet", "model"), "vehicle"),
    **dict.fromkeys(("sim", "engine", "physics"), "simulator"),
    **dict.fromkeys(("steps", "timesteps", "total_timesteps", "budget"), "train.total_steps"),
    **dict.fromkeys(("lr", "algo.lr"), "algo.learning_rate"),
    **dict.fromkeys(("k", "K", "reward.K"), "reward.k"),
    **dict.fromkeys(("hz", "freq", "rate", "dt"), "step.frequency"),
    **dict.fromkeys(("current", "current_speed", "disturbance.current_speed"), "disturbance.current.speed"),
    **dict.fromkeys(("waves", "wave", "sea", "wave_height"), "disturbance.waves.height"),
    **dict.fromkeys(("fault", "faults"), "disturbance.fault.mode"),
    **dict.fromkeys(("tune.method", "tune.algorithm"), "tune.sampler"),
    **dict.fromkeys(("out", "output_dir", "out_dir", "folder", "dir"), "output"),
    **dict.fromkeys(("experiment_name", "run_name"), "name"),
    **dict.fromkeys(("jobs", "processes", "n_jobs"), "launcher.workers"),
    "evaluation": "protocol",
    "episodes": "protocol.episodes",
    "trials": "tune.trials",
}
"""Names that other programs use for a setting, each with auvbench's key of this setting."""


OF_COMMANDS = {
    "protocol": "evaluate",
    "tune": "tune",
    "search": "tune",
    "input": "simulate",
    "duration": "simulate",
}
"""Keys, or first parts of keys, that only one command accepts, each with this command."""


def unknown_key(key: str, keys: Collection[str], program: str) -> str:
    """Return the hint for a key that a configuration does not have.

    Args:
        key: key as typed.
        keys: keys of the configuration.
        program: command whose `--cfg job` shows all keys, e.g. `auvbench train`.
    """
    if key == "algo.base" and "algo.residual" in keys:
        return "algo.base=NAME chooses the controller; its values are keys of algo.residual"
    if (suggestion := CORRECTIONS.get(key)) in keys:
        return f"did you mean {suggestion}? ({program} --cfg job shows all keys)"
    command = OF_COMMANDS.get(key.partition(".")[0])
    if command and not program.endswith(f" {command}"):
        return f"it is a key of auvbench {command} (auvbench {command} --help)"
    if having := owners(key):
        return f"only {', '.join(having)} {'has' if len(having) == 1 else 'have'} it"
    shows = f"{program} --cfg job shows all keys"
    of_algorithms: set[str] = set()
    # A command without an algorithm has no algorithm keys.
    if any(name.startswith("algo.") for name in keys):
        of_algorithms = {name for agent in AGENTS.own for name in schema.keys(AGENTS[agent].schema, "algo.")}
    near = nearest(key, {*keys, *of_algorithms})
    if near is None:
        return shows
    whose = "" if near in keys else f" of {', '.join(owners(near))}"
    return f"did you mean {near}{whose}? ({shows})"


def unknown_flag(
    command: str, word: str, flags: Iterable[str], keys: Collection[str], typed: Sequence[str]
) -> str:
    """Return the hint for a flag that a command does not have.

    Args:
        command: name of the command.
        word: flag as typed, possibly with `=VALUE`.
        flags: valid flags.
        keys: keys of the command's configuration, which are set by key=value words.
        typed: all words of the command line.
    """
    flag, separator, own = word.partition("=")
    key = flag.lstrip("-").replace("-", "_")
    suggestion = CORRECTIONS.get(key)
    if suggestion not in keys:
        suggestion = min((name for name in keys if f".{name}".endswith(f".{key}")), key=len, default=None)
    if suggestion is not None:
        following = next(iter(typed[typed.index(word) + 1 :]), "-")
        shown = own if separator else "VALUE" if following.startswith("-") else following
        return f"{flag}: {command} takes it as {suggestion}={shown} (key=value is configuration)"
    return f"unknown option {flag!r} of {command}; {closest(flag, flags)}"
