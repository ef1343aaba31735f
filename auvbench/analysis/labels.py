"""Names of agents, as short as the grouping allows: 'PPO K=1 25 Hz', or 'PPO' where K and f are all the same."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from typing import Any

from auvbench.untrusted.text import plain

LONGEST = 60
"""characters of a value in a label"""

Key = Mapping[str, Any]


def part(name: str, value: Any) -> str:
    """One value of the grouping as it stands in a label.

    >>> part("algo", "ppo"), part("reward.k", 1.0), part("step.frequency", 25.0), part("algo.n_envs", 32)
    ('PPO', 'K=1', '25 Hz', 'n_envs=32')
    >>> part("vehicle", "rexrov"), part("disturbance", "none"), part("train.total_steps", 300_000)
    ('rexrov', 'disturbance=none', '300k steps')
    """
    if name == "algo":
        text = str(value)
        return text.upper() if len(text) <= 4 else text
    shown = f"{value:g}" if isinstance(value, float) else "unset" if value is None else plain(str(value))
    if len(shown) > LONGEST:  # a list, say: its beginning and what tells it from others
        shown = f"{shown[:LONGEST]}… ({hashlib.sha256(shown.encode()).hexdigest()[:6]})"
    if name == "reward.k":
        return f"K={shown}"
    if name == "step.frequency":
        return f"{shown} Hz"
    if name == "train.total_steps" and isinstance(value, int | float):
        return f"{in_short(value)} steps"
    if name in ("vehicle", "simulator"):  # a name that says what it names
        return shown
    if name == "seed":
        return f"seed {shown}"
    return f"{name.rpartition('.')[2]}={shown}"


def in_short(number: float) -> str:
    """A large number with its thousands or millions as a letter.

    >>> in_short(300_000), in_short(1_000_000), in_short(1_500_000), in_short(512)
    ('300k', '1M', '1.5M', '512')
    """
    for size, letter in ((1e6, "M"), (1e3, "k")):
        if abs(number) >= size:
            return f"{number / size:.6g}{letter}"
    return f"{number:.6g}"


def factor_name(name: str) -> str:
    """A key of the grouping as it stands in a sentence.

    >>> factor_name("algo"), factor_name("reward.k"), factor_name("step.frequency"), factor_name("algo.n_envs")
    ('algorithm', 'K', 'frequency', 'n_envs')
    """
    return {"algo": "algorithm", "reward.k": "K"}.get(name, name.rpartition(".")[2])


def labels(keys: Sequence[Key], learners: Sequence[bool]) -> list[str]:
    """A unique label per key.

    A value is left out where it is the same for all learners; a classical controller shows only what varies
    among the agents of its own algorithm (K means nothing to a PID).
    """
    if not keys:
        return []
    names = list(keys[0])
    short = []
    for key, learner in zip(keys, learners, strict=True):
        peers = [
            k
            for k, is_learner in zip(keys, learners, strict=True)
            if (learner and is_learner) or k.get("algo") == key.get("algo")
        ]
        parts = [
            part(n, key[n])
            for n in names
            if n == "algo" or (len({str(k[n]) for k in peers}) > 1 and not _foreign(n, key, keys))
        ]
        short.append(" ".join(parts) or "all runs")
    full = [" ".join(part(n, v) for n, v in key.items()) or "all runs" for key in keys]
    return [s if short.count(s) == 1 else f for s, f in zip(short, full, strict=True)]


def _foreign(name: str, key: Key, keys: Sequence[Key]) -> bool:
    """Whether a value belongs to another choice: `simulator.hydrodynamics` of a simulator of which none has it."""
    return any(
        name.startswith(f"{choice}.") and all(k[name] is None for k in keys if k[choice] == key[choice])
        for choice in key
    )


def sort_key(key: Key) -> tuple[tuple[int, float, str], ...]:
    """Numbers in order of size, words in order of the alphabet, nothing last."""
    return tuple(_sortable(v) for v in key.values())


def _sortable(value: Any) -> tuple[int, float, str]:
    if isinstance(value, int | float) and not math.isnan(value):
        return 0, float(value), ""
    return (2, 0.0, "") if value is None else (1, 0.0, str(value))
