"""Whether a policy's file may enter: it answers with actions, the same each time, to each observation by itself."""

from __future__ import annotations

import numpy as np

from auvbench.agents.policy_file import PolicyFile
from auvbench.config import schema
from auvbench.evaluation import observations
from auvbench.policies.cards import PolicyError
from auvbench.policies.exported import SLACK, Policy

STEPS = 32
"""of the episodes on which it is tried"""


def admit(config: schema.TrainConfig, agent: PolicyFile) -> None:
    """Tries the policy of a run on observations of episodes and on the edges of what can be observed.

    Raises:
        PolicyError: it answers with what is no action, differently the second time, or to one observation depending on
            the others beside it.
    """
    policy = agent.policy
    assert policy is not None
    policy.act(observations.of_edges(config))
    seen = observations.of_episodes(config, agent, STEPS, scenarios="validation")
    first = policy.act(seen)
    if not np.array_equal(first, policy.act(seen)):
        raise PolicyError(f"{policy.where}: answers the same observations differently the second time")
    _apart(policy, seen)


def _apart(policy: Policy, seen: np.ndarray[tuple[int, int], np.dtype[np.float32]]) -> None:
    """Each observation in other company, and in another place among them."""
    rows = seen[:: max(1, len(seen) // 64)][:64]
    together, turned = policy.act(rows), policy.act(rows[::-1])[::-1]
    alone = np.concatenate([policy.act(row[None]) for row in rows[:8]])
    differs = max(float(np.abs(together - turned).max()), float(np.abs(together[:8] - alone).max()))
    if differs > SLACK:
        raise PolicyError(
            f"{policy.where}: its action for one observation depends on the others beside it (it differs by {differs:.2g}); "
            "each row of the input must be answered by itself"
        )
