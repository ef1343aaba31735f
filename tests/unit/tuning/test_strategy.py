"""Samplers and pruners: proposals stay in the space, learn, and survive a restart; pruners count rungs."""

from __future__ import annotations

import random
from collections import Counter
from pathlib import Path

import optuna
import pytest
from optuna.trial import TrialState

from auvbench.commands.tune import plan_of, split
from auvbench.config.compose import compose
from auvbench.tuning.folder import Plan
from auvbench.tuning.search import open_study, pruner

RANGES = [
    "algo.gamma=interval(0.9,0.999)",
    "algo.learning_rate=tag(log,interval(1e-4,1e-1))",
    "algo.n_epochs=interval(1,20)",
    "algo.activation=choice(tanh,relu)",
]
FIXED = [
    "algo.n_steps=64",
    "algo.batch_size=64",
    "algo.gae_lambda=0.9",
    "algo.clip_range=0.2",
    "algo.ent_coef=0",
]
FIXED += ["algo.log_std_init=0", "algo.net_arch=[8]"]


def plan(*words: str) -> Plan:
    typed, ranges, fixed = split(["algo=ppo", *FIXED, *RANGES, *words, "output=/nowhere"])
    return plan_of(compose("tune", typed), ranges, fixed)[0]


def value(params: dict[str, object]) -> float:
    return -abs(float(params["algo.n_epochs"]) - 12) / 20 - (params["algo.activation"] != "relu") * 0.3


def proposed(of: Plan, path: Path, count: int) -> list[dict[str, object]]:
    """Ask for `count` trials in one process and complete each."""
    study = open_study(of, path)
    found = []
    for _ in range(count):
        trial = study.ask({d.key: d.distribution for d in of.dimensions})
        found.append(trial.params)
        trial.set_user_attr(f"result {of.budgets[-1]}", [value(trial.params)] * 5)
        trial.report(value(trial.params), of.budgets[-1])
        study.tell(trial, value(trial.params))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tpe", "random"])
def test_a_restart_repeats_no_proposal_and_stays_in_the_space(name: str, tmp_path: Path) -> None:
    of = plan(f"tune.sampler={name}", "tune.startup=4", "tune.rungs=[100]")
    found = [params for _ in range(4) for params in proposed(of, tmp_path / "journal.log", 3)]
    assert len({tuple(params.values()) for params in found}) == len(found)
    for params in found:
        assert 0.9 <= params["algo.gamma"] <= 0.999
        assert 1e-4 <= params["algo.learning_rate"] <= 1e-1
        assert params["algo.n_epochs"] in range(1, 21)
        assert type(params["algo.n_epochs"]) is int
        assert params["algo.activation"] in ("tanh", "relu")


@pytest.mark.slow
def test_tpe_that_is_restarted_for_every_third_trial_beats_chance(tmp_path: Path) -> None:
    def mean_of_the_last(name: str) -> float:
        of = plan(f"tune.sampler={name}", "tune.startup=5", "tune.rungs=[100]")
        path = tmp_path / f"{name}.log"
        found = [value(params) for _ in range(20) for params in proposed(of, path, 3)]
        return sum(found[30:]) / 30

    assert mean_of_the_last("tpe") > mean_of_the_last("random") + 0.05


def climbed(of: Plan, values: list[float], at_once: int = 1) -> list[int]:
    """Return how many rungs each trial reaches when trial n shows values[n] on every rung."""
    study = optuna.create_study(direction="maximize", pruner=pruner(of), study_name="study")
    waiting, reached = [], [0] * len(values)
    generator = random.Random(0)
    while True:
        while len(waiting) < at_once and len(study.trials) < len(values):
            waiting.append(study.ask())
        if not waiting:
            return reached
        trial = waiting.pop(generator.randrange(len(waiting)))
        reached[trial.number] += 1
        trial.report(values[trial.number], of.budgets[reached[trial.number] - 1])
        if reached[trial.number] == len(of.budgets):
            study.tell(trial, values[trial.number])
        elif trial.should_prune():
            study.tell(trial, state=TrialState.PRUNED)
        else:
            waiting.append(trial)


@pytest.mark.slow
@pytest.mark.parametrize("at_once", [1, 4])
@pytest.mark.parametrize("rungs", ["[1,3,9]", "[100,120,5000]"])
def test_halving_lets_about_one_in_three_through_and_the_best_to_the_top(at_once: int, rungs: str) -> None:
    values = [float(v) for v in random.Random(3).sample(range(1000), 90)]
    reached = climbed(plan(f"tune.rungs={rungs}"), values, at_once)
    assert reached[values.index(max(values))] == 3
    counts = Counter(reached)
    assert 25 <= counts[2] + counts[3] <= 45
    assert counts[3] < counts[2] + counts[3]


@pytest.mark.slow
def test_of_equal_trials_only_the_first_goes_on() -> None:
    assert sum(n > 1 for n in climbed(plan("tune.rungs=[1,3]"), [0.0] * 12)) <= 4


def test_none_has_one_rung() -> None:
    assert plan("tune.rungs=[1,3,9]", "tune.pruner=none").budgets == (9,)
