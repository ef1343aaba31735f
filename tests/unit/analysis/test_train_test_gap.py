"""Where training and test tell different stories, the report says so; where they agree, it does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from auvbench.analysis.ranking import rank
from auvbench.analysis.records import Agent
from auvbench.analysis.train_test_gap import train_test_gaps
from tests.unit.analysis.agents import agent


def with_rates(label: str, trained: list[float], tested: list[float], episodes: int = 200) -> Agent:
    """An agent whose seeds have these success rates at the end of training and in the test."""
    made = agent(label=label, seeds=len(tested), episodes=episodes)
    outcome = np.array([[0] * round(p * episodes) + [2] * round((1 - p) * episodes) for p in tested], np.int8)
    runs = tuple(
        replace(run, manifest={**run.manifest, "success_rate": rate, "episodes": 5000})
        for run, rate in zip(made.runs, trained, strict=True)
    )
    return replace(made, runs=runs, outcome=outcome)


def texts(*agents: Agent, condition: str = "nominal") -> list[str]:
    ranking = replace(rank(agents), condition=condition)
    return [finding.text for finding in train_test_gaps(ranking, agents)]


def test_a_training_that_promised_more_than_the_test_kept_is_named() -> None:
    bad = with_rates("PPO K=100", [0.86], [0.11])
    good = with_rates("PPO K=1", [0.99, 0.97], [0.995, 0.98])
    assert texts(bad, good) == [
        "PPO K=100 looks better in training than in the test: 86 % against 11 % success."
    ]


def test_only_the_seeds_that_differ_count_and_the_largest_gap_is_named() -> None:
    some = with_rates("SAC", [0.9, 0.9, 0.95], [0.9, 0.5, 0.6])
    more = with_rates("TD3", [0.9, 0.9], [0.1, 0.9])
    assert texts(some, more) == [
        "TD3 looks better in training than in the test: 90 % against 10 % success, seed 0; so does 1 more agent."
    ]


def test_a_test_that_is_better_than_training_is_another_sentence() -> None:
    (text,) = texts(with_rates("TD3", [0.3, 0.35], [0.9, 0.95]))
    assert text.startswith("TD3 looks worse in training than in the test")


def test_what_chance_explains_or_nobody_knows_is_not_said() -> None:
    few = with_rates("A", [0.8, 0.8], [0.6, 0.6], episodes=10)  # intervals that meet
    near = with_rates("B", [0.95, 0.95], [0.8, 0.8], episodes=2000)  # resolved, and small
    unknown = with_rates("C", [float("nan"), 0.9], [0.1, 0.9])
    assert texts(few) == texts(near) == texts(unknown) == []


def test_of_a_disturbed_condition_nothing_is_said() -> None:
    assert texts(with_rates("A", [0.9, 0.9], [0.1, 0.1]), condition="current=1") == []


def told_of(one: Agent, **manifest: object) -> Agent:
    return replace(one, runs=tuple(replace(run, manifest={**run.manifest, **manifest}) for run in one.runs))


def test_the_episodes_are_those_that_there_were() -> None:
    bad = with_rates("PPO", [0.9], [0.1])
    (found,) = train_test_gaps(rank([bad]), [told_of(bad, episodes=60)])
    assert found.basis.startswith("last 60 training episodes")
    assert texts(told_of(bad, episodes=29)) == [], "a rate of so few is not shown anywhere"


def test_episodes_that_had_no_time_to_be_long_are_no_sample() -> None:
    bad = with_rates("PPO", [0.9], [0.1])
    runs = tuple(replace(run, config={**run.config, "algo.n_envs": 32}) for run in bad.runs)
    many = replace(bad, runs=runs)
    assert texts(told_of(many, steps=32 * 2000, episodes=500)) != []
    assert texts(told_of(many, steps=32 * 1999, episodes=500)) == []
