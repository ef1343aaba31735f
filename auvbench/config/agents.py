"""What a configuration alone tells of its agent; nothing of the agent is imported."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from auvbench.config import algorithms
from auvbench.config.hints import CLASSES


def learns(algo: Any, *, unknown: bool = False) -> bool:
    """Whether the agent of an `algo` configuration, typed or plain, has anything to learn; `unknown` for one that is not known.

    >>> learns({"agent": "ppo"}), learns({"agent": "pid"})
    (True, False)
    """
    agent = algo.get("agent") if isinstance(algo, Mapping) else getattr(algo, "agent", None)
    schema = CLASSES.get(str(agent))
    if schema is not None:
        return issubclass(schema, algorithms.Network)
    # Of an installed package: its configuration says so, whether or not the package is still there.
    declared = algo.get("learns") if isinstance(algo, Mapping) else getattr(algo, "learns", None)
    return declared if isinstance(declared, bool) else unknown
