"""Name agents as briefly as the grouping allows: 'PPO K=1', or 'PPO' if K is the same for all agents."""

from __future__ import annotations

import hashlib
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from auvbench.config.algorithms.residual import BASES
from auvbench.registry import AGENTS
from auvbench.untrusted.text import plain

OF_THE_TEST = ("task.", "noise.", "disturbance.", "simulator.")
"""prefixes of keys that have the same value for all agents of a table, because the test sets them"""
OF_THE_AGENT = ("task.position_frame", "task.observation", "task.history", "task.preview")
"""prefixes of the observation's keys, which no test changes"""
OWN = "own"
"""protocol that tests each run with its own task, noise and disturbances"""
OBSERVATION = "task.observation"
FREQUENCY = "step.frequency"
"""Key of the step frequency. A test uses one frequency for all runs, or each run's own"""


def is_fixed(key: str, frequency_fixed: bool) -> bool:
    """Return whether the test of a table sets a key, so that the run's value only describes its training.

    >>> is_fixed("disturbance", True), is_fixed("task.goal_radius", True), is_fixed("algo.gamma", True)
    (True, True, False)
    >>> is_fixed("step.frequency", True), is_fixed("step.frequency", False)
    (True, False)
    """
    if key == FREQUENCY:
        return frequency_fixed
    return f"{key}.".startswith(OF_THE_TEST) and not key.startswith(OF_THE_AGENT)


LONGEST = 80
"""largest number of characters of a value in a label"""

VEHICLE = "vehicle"
"""key of the vehicle sheet that an agent was trained with or knows; agents of one table have different sheets only if
the test fixes the vehicle
"""
UNITS = {"reward.k": "K={}", FREQUENCY: "{} Hz", VEHICLE: "sheet {}", "simulator": "{}", "seed": "seed {}"}
"""templates of the texts for values that are shown without their key"""
CURRENT, WAVES, FAULT = "disturbance.current", "disturbance.waves", "disturbance.fault"
DRAWN = {
    f"{CURRENT}.speed_high": ("current speeds up to {} m/s", "no drawn current speeds"),
    f"{CURRENT}.direction": ("current towards {} rad", "drawn current directions"),
    f"{WAVES}.direction": ("waves towards {} rad", "drawn wave directions"),
    f"{WAVES}.spreading": ("wave spreading {}", "waves without spreading"),
    f"{FAULT}.actuator": ("faults of {}", "faults of drawn actuators"),
    f"{FAULT}.time_high": ("faults up to {} s", "faults at one time"),
}
"""texts of keys for which null has a meaning: the text for a value, and the text for null"""

BY = {FREQUENCY: "at", "simulator": "in"}
"""words between 'trained' and the value of a key; the values of other keys follow 'with'"""

Key = Mapping[str, Any]


def part(name: str, value: Any) -> str:
    """Return one value of the grouping as text for a label.

    >>> part("algo", "crossq"), part("reward.k", 1.0), part("step.frequency", 25.0), part("algo.n_envs", 32)
    ('CrossQ', 'K=1', '25 Hz', 'n_envs=32')
    >>> part("vehicle", "rexrov"), part("disturbance", "none"), part("train.total_steps", 300_000)
    ('sheet rexrov', 'disturbance=none', '300k steps')
    >>> part("task.observation", "['yaw_error', 'gravity']")
    'observation=yaw_error, gravity'
    >>> part("disturbance.waves.height", 0.88)
    'waves.height=0.88'
    >>> part("disturbance.current.speed_high", 1.2), part("disturbance.current.speed_high", None)
    ('current speeds up to 1.2 m/s', 'no drawn current speeds')
    >>> part("task.time_limit", None)
    'no time_limit'
    """
    if name == "algo":
        return title(str(value))
    _, *below = name.split(".")
    key = ".".join(below[-2:]) or name
    if value is None:
        return DRAWN[name][1] if name in DRAWN else f"no {key}"
    shown = f"{value:g}" if isinstance(value, float) else plain(str(value))
    if blocks := _words(value):
        shown = ", ".join(blocks)
    if len(shown) > LONGEST:  # such as a list: show its beginning, and a digest that distinguishes it
        shown = f"{shown[:LONGEST]}… ({hashlib.sha256(shown.encode()).hexdigest()[:6]})"
    if name == "train.total_steps" and isinstance(value, int | float):
        return f"{in_short(value)} steps"
    text = DRAWN[name][0] if name in DRAWN else UNITS.get(name, f"{key}={{}}")
    return text.replace("{}", shown)


def in_words(name: str, value: Any) -> bool:
    """Return whether a label needs a comma before the text of `part`: for 'no time_limit', but not for K=1 or 25 Hz."""
    return value is None or name == VEHICLE or name in DRAWN


def title(algorithm: str) -> str:
    """Return the name of an algorithm or preset in tables: the registry's title with the preset's suffix.

    >>> title("mpc_tuned"), title("ppo_residual"), title("ppo_tuned_60k"), title("my_agent")
    ('MPC, tuned', 'PPO added to PID', 'PPO, tuned 60k', 'my_agent')
    >>> title("ppo_residual_lqr"), title("sac_residual_tuned")
    ('PPO added to LQR', 'SAC added to PID, tuned')
    """
    base = max((n for n in AGENTS.own if f"{algorithm}_".startswith(f"{n}_")), key=len, default="")
    if not base:
        return plain(algorithm)
    shown, more = AGENTS[base].title, algorithm[len(base) + 1 :].replace("_", " ")
    added, _, remainder = more.partition(" ")
    if base.endswith("_residual") and added in BASES:
        shown, more = shown.replace(AGENTS["pid"].title, AGENTS[added].title), remainder
    return f"{shown}, {more}" if more else shown


def in_short(number: float) -> str:
    """Return a large number with k or M for thousands or millions.

    >>> in_short(300_000), in_short(1_000_000), in_short(1_500_000), in_short(512)
    ('300k', '1M', '1.5M', '512')
    """
    for size, letter in ((1e6, "M"), (1e3, "k")):
        if abs(number) >= size:
            return f"{number / size:.6g}{letter}"
    return f"{number:.6g}"


def labels(keys: Sequence[Key], learners: Sequence[bool], frequency_fixed: bool = True) -> list[str]:
    """Return a label for each agent, as short as possible, from the values of its keys.

    A learner's label leaves out values that are the same for all learners, and usual values (`usual`). A
    controller's label has only the values that vary among the agents of its algorithm. Values of keys that
    the test sets (`is_fixed`) follow "trained". `observed` shortens an observation.

    Args:
        keys: the key of each agent: its values by the short name of a configuration key.
        learners: whether each agent learns.
        frequency_fixed: whether the test has one step frequency for all agents.
    """
    if not keys:
        return []
    names = list(keys[0])
    short = []
    common = usual(keys, learners)
    observations = [key.get(OBSERVATION) for key in keys]
    for key, learner in zip(keys, learners, strict=True):
        peers = [
            k
            for k, is_learner in zip(keys, learners, strict=True)
            if (learner and is_learner) or k.get("algo") == key.get("algo")
        ]
        left_out = {n for n in common if learner and str(key[n]) == str(common[n])}
        shown = [
            n
            for n in names
            if n == "algo"
            or (n not in left_out and len({str(k[n]) for k in peers}) > 1 and not _foreign(n, key, keys))
        ]
        what, blocks = observed(key.get(OBSERVATION), observations)
        names_shown = [what if n == OBSERVATION else n for n in shown if n != OBSERVATION or blocks]
        short.append(label_of({**key, what: blocks}, names_shown, frequency_fixed))
    full = [label_of(key, list(key), frequency_fixed) for key in keys]
    return [s if short.count(s) == 1 else f for s, f in zip(short, full, strict=True)]


def observed(observation: Any, observations: Sequence[Any]) -> tuple[str, str]:
    """Return what distinguishes one of several observations, as a short list of blocks.

    The result is one of two pairs:

    * `unobserved`, and the blocks that this observation lacks but another observation has;
    * `observed`, and the blocks that this observation has but another observation lacks.

    The result is the `observed` pair under two conditions. Every observation has a block that another observation
    lacks, and the `observed` lists of all observations together are not longer than the `unobserved` lists.

    >>> observed("['yaw_error']", ["['yaw_error']", "['yaw_error', 'velocity', 'gravity']"])
    ('unobserved', 'velocity, gravity')
    >>> observed("['gravity', 'way']", ["['gravity', 'way']", "['gravity', 'range.ideal']"])
    ('observed', 'way')
    """
    own, others = _words(observation), [_words(other) for other in dict.fromkeys(map(str, observations))]
    blocks = dict.fromkeys(block for words in others for block in words)
    common = set(blocks).intersection(*others)
    special = [len(words) - len(common) for words in others]
    lacking = [len(blocks) - len(words) for words in others]
    if all(special) and sum(special) <= sum(lacking):
        return "observed", ", ".join(block for block in own if block not in common)
    return "unobserved", ", ".join(block for block in blocks if block not in own)


def usual(keys: Sequence[Key], learners: Sequence[bool]) -> dict[str, Any]:
    """Return the usual values by key: at least 75 % of the learners have the value, but not all learners.

    >>> ppo = [{"algo": "ppo", "task.history": n} for n in (1, 1, 1, 4)]
    >>> usual(ppo, [True] * 4), usual(ppo[1:], [True] * 3)
    ({'task.history': 1}, {})
    """
    trained = [key for key, learner in zip(keys, learners, strict=True) if learner]
    if len(trained) < 4:
        return {}
    values = {}
    for name in trained[0]:
        if name in ("algo", OBSERVATION):  # labels show an observation by its blocks
            continue
        value, count = Counter(str(key[name]) for key in trained).most_common(1)[0]
        first = next(key for key in trained if str(key[name]) == value)
        if 0.75 * len(trained) <= count < len(trained) and not _foreign(name, first, keys):
            values[name] = first[name]
    return values


def usual_sentence(keys: Sequence[Key], learners: Sequence[bool]) -> list[str]:
    """Return a list with one sentence on the usual values, which labels leave out; an empty list without usual values."""
    shown = ", ".join(part(name, value) for name, value in usual(keys, learners).items())
    return [f"Learners whose names do not say otherwise: {shown}."] if shown else []


def label_of(key: Key, names: Sequence[str], frequency_fixed: bool) -> str:
    """Return a label from the values of the keys `names`: 'PPO K=1, trained at 25 Hz in gazebo with disturbance=severe'."""
    fixed = [n for n in names if is_fixed(n, frequency_fixed)]
    own = _joined(key, [n for n in names if n not in fixed]) or "all runs"
    words = [f"{BY[n]} {part(n, key[n])}" for n in BY if n in fixed]
    having = _joined(key, [n for n in fixed if n not in BY])
    words += [f"with {having}"] if having else []
    return f"{own}, trained {' '.join(words)}" if words else own


def _joined(key: Key, names: Sequence[str]) -> str:
    """Return the values as text: short values separated by spaces, then words after commas: 'PPO K=1, no time_limit'."""
    values = " ".join(part(n, key[n]) for n in names if not in_words(n, key[n]))
    words = [part(n, key[n]) for n in names if in_words(n, key[n])]
    return ", ".join(filter(None, [values, *words]))


def _foreign(name: str, key: Key, keys: Sequence[Key]) -> bool:
    """Return whether the key `name` belongs to a configuration group, but the agent's option of this group lacks the key.

    An example is `simulator.hydrodynamics`, if no agent with the same simulator has a value of this key.
    """
    return any(
        name.startswith(f"{choice}.") and all(k[name] is None for k in keys if k[choice] == key[choice])
        for choice in key
    )


def _words(value: Any) -> list[str]:
    """Return the words of a list that is shown as text, such as an observation; empty for any other value."""
    return re.findall(r"'([\w.]+)'", value) if isinstance(value, str) and value.startswith("['") else []


def sort_key(value: Any) -> tuple[int, float, str]:
    """Return a key that sorts numbers by size, then words alphabetically, missing values last."""
    if isinstance(value, int | float) and not math.isnan(value):
        return 0, float(value), ""
    return (2, 0.0, "") if value is None else (1, 0.0, str(value))
