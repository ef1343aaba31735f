"""Findings: resolved effects, returns that mislead, trainings that differ."""

from dataclasses import replace

import numpy as np
import pytest

from auvbench.analysis.findings import effects, find, matched, mean_difference
from auvbench.analysis.formatting import turned
from auvbench.analysis.measures import measure
from auvbench.analysis.ranking import rank
from auvbench.analysis.records import Agent
from tests.unit.analysis.agents import agent

SUCCESS = measure("success_rate")


def told(agents, **options):
    return [finding.text for finding in find(rank(agents, **options), agents)]


def kinds(agents, **options):
    return [finding.kind for finding in find(rank(agents, **options), agents)]


def grid(sac=3.0, ppo=1.0, per_k=0.0, **options):
    return [
        agent(algo, k, f, level=level - per_k * (k > 1), **options)
        for algo, level in (("sac", sac), ("ppo", ppo))
        for k in (1, 40)
        for f in (10, 25)
    ]


def test_effects_are_averaged_over_matched_cells():
    agents = grid()
    found = {(e.first, e.second): e for e in effects(agents, SUCCESS)}
    assert set(found) == {("SAC", "PPO"), ("K=40", "K=1"), ("25 Hz", "10 Hz")}
    by_cell = [typical(a) - typical(b) for a, b in matched(agents, "algo", "sac", "ppo")]
    assert len(by_cell) == 4
    assert found["SAC", "PPO"].difference.value == pytest.approx(np.mean(by_cell))
    assert found["SAC", "PPO"].difference.low > 0


def test_cells_without_a_partner_are_left_out():
    agents = grid()[:-1]
    assert len(matched(agents, "algo", "sac", "ppo")) == 3
    assert matched(agents[:4], "algo", "sac", "ppo") == []


def typical(agent):
    return np.median(agent.success.mean(axis=1))


FOUR = ("ddpg", "ppo", "sac", "td3")


def test_of_many_algorithms_no_pair_is_chosen_by_its_name():
    """First and last of an alphabet are no extremes; and of one cell the table itself has every pair, corrected for all."""
    agents = [agent(algo, level=level) for algo, level in zip(FOUR, (4, 1, 1, -2), strict=True)]
    assert effects(agents, SUCCESS) == []
    both = [
        agent(algo, k, level=level) for k in (1, 40) for algo, level in zip(FOUR, (4, 1, 1, -2), strict=True)
    ]
    found = {(e.first, e.second) for e in effects(both, SUCCESS) if e.factor == "algo"}
    assert found == {
        ("PPO", "DDPG"),
        ("SAC", "DDPG"),
        ("TD3", "DDPG"),
        ("SAC", "PPO"),
        ("TD3", "PPO"),
        ("TD3", "SAC"),
    }


def test_of_many_numbers_the_largest_is_set_against_the_smallest():
    agents = [agent("sac", k, level=level) for k, level in ((1, 2), (10, 1), (40, 1), (100, -1))]
    assert [(e.first, e.second) for e in effects(agents, SUCCESS)] == [("K=100", "K=1")]


def test_a_controller_that_does_not_learn_has_no_part_in_effects():
    agents = [*grid(), agent("pid", 1, 10, seeds=1)]
    assert {(e.first, e.second) for e in effects(agents, SUCCESS)} == {
        ("SAC", "PPO"),
        ("K=40", "K=1"),
        ("25 Hz", "10 Hz"),
    }


def test_the_interval_of_an_effect_covers_its_truth():
    """Two cells of two agents with six seeds each, no effect: rarely is one seen."""
    rng, hits, n = np.random.default_rng(0), 0, 200
    base = [agent(a, k, seeds=6, episodes=60) for a in ("sac", "ppo") for k in (1, 40)]
    for _ in range(n):
        hard = rng.normal(size=60)
        made = []
        for one in base:
            success = rng.random((6, 60)) < 1 / (1 + np.exp(-(1 + 0.5 * rng.normal(size=(6, 1)) - hard)))
            made.append(replace(one, outcome=np.where(success, 0, 2).astype(np.int8)))
        estimate, p = mean_difference([(made[0], made[2]), (made[1], made[3])], SUCCESS, 0.95)
        hits += estimate.low <= 0 <= estimate.high
        assert (p < 0.05) == (not estimate.low <= 0 <= estimate.high)
    assert hits / n > 0.95 - 3.5 * np.sqrt(0.95 * 0.05 / n)


def test_effects_say_better_or_worse_by_the_direction_of_the_measure():
    agents = [agent(a, k, steps=s, level=3) for a, s in (("sac", 200), ("ppo", 600)) for k in (1, 40)]
    (found,) = [f for f in find(rank(agents, rank_by="mean_steps"), agents) if f.kind == "effect"]
    assert found.text.startswith("The typical training of SAC is better than that of PPO in PAR-1 steps: -")
    assert "16 of 16 trainings of SAC are better than the typical one of PPO." in found.text
    assert found.estimate.high < 0


def test_effects_that_are_not_resolved_are_no_finding():
    assert "effect" not in kinds(grid(sac=1.5, ppo=1.5))


def test_a_factor_has_no_effect_that_single_seeds_could_show():
    """Whatever two single trainings differ by, the factor is not said to have done it."""
    agents = [agent("ppo", 1, level=5, seeds=1), agent("ppo", 100, level=-2, seeds=1)]
    assert "effect" not in kinds(agents)
    several = [agent("ppo", k, level=level, seeds=5, seed_sd=0.1) for k, level in ((1, 3), (100, -2))]
    assert "effect" in kinds(several)


def test_a_difference_of_two_agents_has_one_interval() -> None:
    pair = [agent("sac", 1, level=3.0), agent("sac", 100, level=-1.0), agent("pid", seeds=1)]
    ranking = rank(pair)
    (comparison,) = (c for c in ranking.comparisons if "PID" not in c.first + c.second)
    (found,) = [f for f in find(ranking, pair) if f.kind == "effect"]
    seen = comparison.difference
    assert found.estimate == (seen if comparison.first.endswith("K=100 25 Hz") else turned(seen))


def test_the_agent_whose_trainings_differ_most():
    wild, calm = agent("sac", seed_sd=2.0, level=1), agent("ppo", seed_sd=0.0)
    (found,) = [f for f in find(rank([wild, calm]), [wild, calm]) if f.kind == "seed_variance"]
    means = 100 * wild.success.mean(axis=1)
    assert found.agents == (wild.label,)
    assert f"{means.min():.1f} to {means.max():.1f} %" in found.text
    assert "seed_variance" not in kinds([calm, agent("pid", seeds=1)])


def greedy(**metrics: float) -> list[Agent]:
    """PPO with K = 100, which returns much and arrives seldom, and PPO with K = 1."""
    good = agent("ppo", 1, level=6, seeds=5, seed_sd=0)
    bad = agent("ppo", 100, level=-2, seeds=5, seed_sd=0.2)
    values = {"return": 33_900.0, "final_distance_m": 3.4} | metrics
    bad = replace(bad, metrics=bad.metrics | {k: np.full(bad.outcome.shape, v) for k, v in values.items()})
    config = {"task.goal_radius": 3.0}
    runs = tuple(replace(run, config={**run.config, **config}) for run in bad.runs)
    return [good, replace(bad, runs=runs), agent("pid", level=6, seeds=1)]


def test_a_return_that_misleads_is_the_first_finding() -> None:
    agents = greedy()
    found = find(rank(agents), agents)[0]
    assert (found.kind, found.agents) == ("return_misleads", (agents[1].label, agents[0].label))
    assert found.estimate.high < 0
    assert "a return of 33,900 against" in found.text
    assert "3.4 m from it at the median timeout (goal radius 3 m)" in found.text
    far = find(rank(greedy(final_distance_m=12.0)), greedy(final_distance_m=12.0))[0]
    assert far.kind == "return_misleads"
    assert "goal radius" not in far.text


def test_a_return_that_agrees_with_success_is_no_finding() -> None:
    assert "return_misleads" not in kinds(greedy(**{"return": -100.0}))
    alike = [agent("ppo", k, level=3) for k in (1, 100)]  # the higher return reaches as many waypoints
    assert "return_misleads" not in kinds(alike)


def test_the_first_of_each_kind_comes_before_the_second_of_any() -> None:
    agents = grid(sac=4.0, ppo=-1.0, per_k=3.0, seed_sd=0.0, seeds=5)
    found = kinds(agents)
    assert found.count("effect") > 1
    first = [found.index(kind) for kind in dict.fromkeys(found)]
    assert first == sorted(first) == list(range(len(first)))
