"""What is searched: the grammar, and what is refused in one line."""

from copy import deepcopy
from functools import cache

import pytest
from optuna.distributions import FloatDistribution, IntDistribution

from auvbench import cli
from auvbench.commands.tune import plan_of, split
from auvbench.config.compose import compose
from auvbench.errors import ConfigError, UserError


@cache
def composed(*words):
    """Composing takes most of the time, and most tests type the same words beside their ranges."""
    return compose("tune", list(words))


def planned(*arguments, tmp="/nowhere"):
    words, ranges, fixed = split([*arguments, f"output={tmp}"])
    return plan_of(deepcopy(composed(*words)), ranges, fixed)[0]


def searched(*arguments):
    return {dimension.key: dimension for dimension in planned(*arguments).dimensions}


@pytest.mark.slow
def test_the_space_is_that_of_the_algorithm_and_typed_keys_narrow_it():
    found = searched("algo=sac", "algo.gamma=0.99", "algo.tau=tag(log,interval(0.002,0.03))")
    assert "algo.gamma" not in found
    tau = found["algo.tau"]
    assert tau.distribution == FloatDistribution(0.002, 0.03, log=True)
    assert planned("algo=sac", "algo.gamma=0.99").base["algo"]["gamma"] == 0.99


@pytest.mark.slow
def test_kinds_follow_the_schema():
    found = searched(
        "algo=ppo",
        "algo.n_epochs=interval(2,6)",
        "algo.gae_lambda=range(0.8,1.0,0.05)",
        "algo.activation=choice(tanh,relu)",
        "algo.net_arch=choice([8,8],[16,16])",
        "algo.vf_coef=0.2,0.5",
    )
    assert found["algo.n_epochs"].distribution == IntDistribution(2, 6)
    assert found["algo.gae_lambda"].distribution == FloatDistribution(0.8, 0.95, step=0.05)
    assert found["algo.net_arch"].plain("[16,16]") == [16, 16]
    assert found["algo.activation"].plain("relu") == "relu"
    assert found["algo.vf_coef"].plain("0.5") == 0.5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["algo=random"], ["nothing to search"]),
        (["algo=ppo_thesis"], ["nothing to search", "./conf/search"]),
        (["algo=ppo", "algo.gamm=interval(0.9,0.99)"], ["algo.gamm", "algo.gamma"]),
        (["algo=ppo", "algo.tau=interval(0.01,0.02)"], ["algo.tau", "sac"]),
        (["algo=ppo", "algo.gamma=interval(0.99,0.9)"], ["algo.gamma=interval(0.99,0.9)", "empty"]),
        (["algo=ppo", "algo.gamma=choice()"], ["algo.gamma=choice()", "empty"]),
        (["algo=ppo", "algo.gamma=interval(0.9,"], ["algo.gamma=interval(0.9,", "interval(LOW,HIGH)"]),
        (["algo=ppo", "algo.n_epochs=range(5,2)"], ["algo.n_epochs=range(5,2)", "empty"]),
        (["algo=ppo", "algo.gamma=tag(log,interval(0,0.9))"], ["above 0"]),
        (["algo=ppo", "algo.gamma=tag(exp,interval(0.1,0.9))"], ["'exp'", "log"]),
        (["algo=ppo", "algo.gamma=0.9", "algo.gamma=interval(0.9,0.99)"], ["fixed", "searched"]),
        (["algo=ppo", "algo.gamma=interval(0.9,0.99)", "algo.gamma=interval(0.9,0.95)"], ["already"]),
        (["algo=ppo", "algo.gamma=interval(0.9,1.2)"], ["algo.gamma=1.2", "at most 1"]),
        (["algo=ppo", "algo.n_epochs=interval(2.5,8)"], ["whole numbers"]),
        (["algo=ppo", "algo.batch_size=choice(1000,512)"], ["contradicts itself", "algo.batch_size=1000"]),
        (["algo=ppo", "algo.activation=choice(tanh,softsign)"], ["softsign"]),
        (["algo=ppo", "reward.k=interval(1,40)"], ["reward.k", "settings of the algorithm"]),
        (["algo=ppo", "algo.gamma=range(0.5,0.9,0)"], ["algo.gamma=range(0.5,0.9,0)", "empty"]),
        (["algo=ppo", "algo.gamma=tag(log,range(0.1,0.9,0.1))"], ["logarithmic", "no step"]),
        (["algo=ppo", "algo.n_epochs=range(1,9,0.5)"], ["whole numbers"]),
        (
            ["algo=ppo", f"algo.net_arch=choice({'[' * 3000},1)"],
            ["algo.net_arch=choice", "interval(LOW,HIGH)"],
        ),
        (["algo=ppo", "tune.rungs=[100,50]"], ["tune.rungs=[100, 50]", "rising order"]),
        (["algo=ppo", "tune.rungs=[]"], ["tune.rungs=[]"]),
        (["algo=ppo", "tune.fresh_seeds=[0]"], ["tune.fresh_seeds", "fresh"]),
        (["algo=ppo", "tune.seeds=[]"], ["tune.seeds"]),
        (["algo=ppo", "tune.objective=succes_rate"], ["tune.objective", "success_rate"]),
        (["algo=ppo", "tune.sampler=tpee"], ["tune.sampler=tpee", "tpe"]),
        (
            ["algo=ppo", "algo.learning_rate_schedule=linear"],
            ["algo.learning_rate_schedule=linear", "tune.pruner=none"],
        ),
    ],
)
def test_what_is_no_space_is_refused_in_one_line(arguments, words):
    with pytest.raises(UserError) as caught:
        planned(*arguments)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.slow
def test_a_search_that_is_not_there_is_not_passed_over(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["tune", "algo=pid", "search=pdi", "algo.bandwidth=interval(1,2)"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "search=pdi: no such file" in error
    assert "did you mean 'pid'?" in error
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_one_command_gives_every_shipped_space_the_same_budget(monkeypatch):
    from auvbench.commands import tune
    from auvbench.config import folders

    seen = []
    monkeypatch.setattr(tune, "_studies", lambda jobs, *_: seen.extend(job.config for job in jobs) or 0)
    assert tune.main(["experiment=tune_all", "tune.trials=7"]) == 0
    plans = [plan_of(config, {}, {})[0] for config in seen]
    assert {plan.tune.trials for plan in plans} == {7}
    assert {tuple(plan.tune.rungs) for plan in plans} == {(50000, 150000, 400000)}
    of_some_tasks = {"alos", "apf"}
    assert {plan.name for plan in plans} == set(folders.options("search")) - of_some_tasks
    assert {"ppo", "sac", "ddpg", "td3", "pid", "lqr", "smc", "mpc", "mppi"} <= {plan.name for plan in plans}
    assert all(len(plan.dimensions) >= 3 for plan in plans)


def test_a_range_of_a_question_is_left_to_a_grid():
    words, ranges, _ = split(["algo=ppo,sac", "algo.gamma=interval(0.9,0.99)", "-m"])
    assert "algo=ppo,sac" in words
    assert ranges == {"algo.gamma": "interval(0.9,0.99)"}
    with pytest.raises(ConfigError, match="tune -m"):
        compose("tune", ["algo=ppo,sac"])
