"""Where failures lie: agent by agent, surface and floor apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import ttest_ind

from auvbench.analysis.failures import failures, places
from auvbench.analysis.records import NO_POLICY, Agent
from tests.unit.analysis.agents import agent

SURFACE, FLOOR = "below the upper depth limit", "above the lower depth limit"


def told(agents: list[Agent]) -> list[str]:
    return [finding.text for finding in failures(agents, 0.95)]


def failing_where(one: Agent, bad: np.ndarray, code: int = 1) -> Agent:
    """The agent with a failure wherever `bad` (E,), and its own outcomes elsewhere without collisions."""
    return replace(
        one, outcome=np.where(bad, code, np.where(one.outcome == 1, 0, one.outcome)).astype(np.int8)
    )


def depth(one: Agent) -> np.ndarray:
    return one.metrics["waypoint_z_m"][0]


def test_surface_and_floor_are_told_apart() -> None:
    plain = agent("sac", level=3, episodes=400)
    up = failing_where(plain, -1 - depth(plain) < 5)
    down = failing_where(agent("ppo", level=3, episodes=400), depth(plain) + 60 < 5)
    found = failures([up, down], 0.95)
    (high,) = [f for f in found if SURFACE in f.text]
    (low,) = [f for f in found if FLOOR in f.text]
    assert high.agents == (up.label,)
    assert low.agents == (down.label,)
    assert high.text.startswith(f"{up.label} fails with 100.0 % of the waypoints less than 5 m below")
    assert high.estimate is not None
    assert high.estimate.low > 0.8


def test_the_company_of_other_agents_changes_no_estimate() -> None:
    """Pooled, the sign of the effect of the depth limits depended on the other agents of the table."""
    plain = agent("sac", level=3, episodes=400)
    up = failing_where(plain, -1 - depth(plain) < 5)
    middle = failing_where(agent("ppo", level=3, episodes=400), (depth(plain) < -20) & (depth(plain) > -40))
    together = told([up, *[replace(middle, label=f"other {i}") for i in range(5)]])
    assert any(text.startswith(f"{up.label} fails with 100.0 %") and SURFACE in text for text in together)
    effects = {(p.label, p.where): p.difference.value for p in places([up], 0.95)}
    for p in places([up, middle], 0.95):
        if p.label == up.label:
            assert p.difference.value == effects[p.label, p.where]


def test_one_seed_is_welch_s_test() -> None:
    one = agent("sac", level=1, seeds=1, episodes=300)
    (place,) = [p for p in places([one], 0.95) if SURFACE in p.where]
    z = depth(one)
    failed = 1 - one.success[0]
    near, between = -1 - z < 5, (-1 - z >= 5) & (z + 60 >= 5)
    expected = ttest_ind(failed[near], failed[between], equal_var=False)
    assert place.p_value == pytest.approx(expected.pvalue, rel=1e-5)
    assert place.difference.value == pytest.approx(failed[near].mean() - failed[between].mean(), abs=1e-12)


def test_without_a_difference_few_agents_are_said_to_have_one() -> None:
    rng = np.random.default_rng(7)
    tables = wrong = 0
    for _ in range(60):
        agents = []
        for name in ("sac", "ppo", "ddpg"):
            one = agent(name, level=1.5, episodes=200)
            rates = 1 / (1 + np.exp(-(1.5 + 0.5 * rng.normal(size=(3, 1)) + rng.normal(size=200))))
            agents.append(replace(one, outcome=np.where(rng.random((3, 200)) < rates, 0, 2).astype(np.int8)))
        tables += 1
        wrong += bool(told(agents))
    assert wrong / tables <= 0.12, "5 % of the tables, and what 60 of them may show by chance"


def test_a_training_that_failed_is_no_place() -> None:
    one = agent("sac", level=1, seeds=3, episodes=300)
    outcome = one.outcome.copy()
    outcome[2] = NO_POLICY
    with_failed = replace(one, outcome=outcome)
    two = replace(
        one,
        outcome=one.outcome[:2],
        metrics={name: values[:2] for name, values in one.metrics.items()},
        runs=one.runs[:2],
    )
    assert [p.difference for p in places([with_failed], 0.95)] == [p.difference for p in places([two], 0.95)]
