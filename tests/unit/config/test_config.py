"""Every answer composes; every mistake is one line that says what to type instead."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import pytest
import yaml
from omegaconf import open_dict

from auvbench.commands.tune import plan_of
from auvbench.config.algorithms import AgentConfig
from auvbench.config.compose import compose, typed
from auvbench.config.fields import number, require
from auvbench.config.rewards import RewardConfig
from auvbench.config.validate import check_across, evaluate_config, train_config
from auvbench.errors import ConfigError
from auvbench.registry import TASKS
from tests import configs


@dataclass(kw_only=True)
class Gains(AgentConfig):
    low: float = number(0.0)
    high: float = number(0.0)

    def check(self) -> None:
        require(self.low < self.high, "algo.low", self.low, f"be below algo.high={self.high:g}")


@dataclass(kw_only=True)
class Prices(RewardConfig):
    def check(self) -> None:
        require(self.k < 9.0, "reward.k", self.k, "be below 9")


CONF = Path(__file__).resolve().parents[3] / "conf"


def options(group: str) -> list[str]:
    return sorted(path.stem for path in (CONF / group).glob("*.yaml"))


def test_the_schemas_of_packages_agents_and_rewards_refuse_values_that_contradict_each_other():
    config = configs.training("algo=pid")
    gains = Gains(name="mine", agent="mine", n_envs=1, package="mine==1", learns=False, low=1.0, high=1.0)
    with pytest.raises(ConfigError, match=r"algo\.low=1: must be below algo\.high=1"):
        check_across(replace(config, algo=gains))
    prices = Prices(name="thesis", package="mine==1", k=9.0)
    with pytest.raises(ConfigError, match=r"reward\.k=9: must be below 9"):
        check_across(replace(config, reward=prices))


@pytest.mark.slow
@pytest.mark.parametrize("algo", options("algo"))
@pytest.mark.parametrize("vehicle", ["bluerov2"])
def test_every_algorithm_composes_and_is_valid(algo, vehicle):
    config = compose("train", [f"algo={algo}", f"vehicle={vehicle}"])
    result = train_config(config)
    # Gains for the tasks of one vehicle are one agent of the study of all tasks, those for one vehicle one agent of its studies.
    same = {"pid_heavy": "pid_per_task"} | {
        f"{name}_2026": f"{name}_tuned" for name in ("pid", "lqr", "smc", "adrc", "mpc")
    }
    shared = [agent for preset, agent in same.items() if algo.startswith(preset)]
    assert result.algo.name == (shared[0] if shared else algo)
    assert typed(config) == result


@pytest.mark.parametrize(
    "override",
    [
        f"{g}={o}"
        for g in ("vehicle", "task", "reward", "step", "noise", "disturbance", "train")
        for o in options(g)
    ],
)
def test_every_answer_composes_and_is_valid(override):
    tasks = {
        "reward=thesis": "waypoint",
        "reward=tracking": "waypoint",
        "reward=path": "path_following",
        "reward=goal": "docking",
        "reward=transit": "transit",
        "reward=gym_auv_path": "path_following",
        "reward=gym_dockauv": "docking",
        "reward=gym_dockauv_radar": "docking",
    }
    whole = [f"task={tasks.get(override, 'station_keeping')}"] if override.startswith("reward=") else []
    train_config(compose("train", [*whole, override]))


@pytest.mark.parametrize(
    "experiment", [name for name in options("experiment") if not name.startswith("tune_")]
)
def test_every_experiment_composes_and_is_valid(experiment):
    assert train_config(compose("train", [f"experiment={experiment}"])).name == experiment


@pytest.mark.parametrize("protocol", options("protocol"))
def test_every_protocol_composes_and_is_valid(protocol):
    assert evaluate_config(compose("evaluate", [f"protocol={protocol}"])).protocol.name == protocol


def test_every_file_begins_with_a_comment_that_says_what_it_is() -> None:
    paths = [path for path in sorted(CONF.rglob("*.yaml")) if "hydra" not in path.parts]
    assert len(paths) > 100
    assert [str(path) for path in paths if not path.read_text(encoding="utf-8").startswith("# ")] == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("reward.k=-1", "reward.k=-1: must be at least 0"),
        ("reward.k=inf", "reward.k=inf: must be a finite number"),
        ("reward.k=nan", "reward.k=nan: must be a finite number"),
        ("reward.k=a", "reward.k: 'a' is not a number"),
        ("reward.kk=1", r"reward.kk: unknown key; did you mean reward.k\?"),
        ("+reward.kk=1", r"reward.kk: unknown key; did you mean 'k'\?"),
        (
            "analysis.measure=success",
            r"analysis.measure=success: an analysis is declared in the file of an experiment",
        ),
        ("rewards=thesis", r"rewards: unknown key; did you mean reward\?"),
        (
            "algo=dqn",
            "algo=dqn: no such option; .*valid: adrc, .*alos, apf, ardusub, crossq, .*ddpg, .*pid, .*ppo",
        ),
        ("reward=thesiss", "reward=thesiss: no such option; did you mean 'thesis'"),
        ("step.frequency=0", "step.frequency=0: must be more than 0 and at most 1000"),
        ("seed=abc", "seed: 'abc' is not a whole number"),
        ("seed=-1", "seed=-1: must be at least 0 and at most 4294967295"),
        ("seed=1.5", "seed: '1.5' is not a whole number"),
        ("algo.batch_size=1000", "algo.batch_size=1000: must divide .* = 4096"),
        ("task.depth_low=-0.5", "task.depth_low=-0.5: must be below task.depth_high=-1"),
        ("task.start=[0,0]", r"task.start=\[0.0, 0.0\]: must be three finite numbers"),
        ("task.start=[0,0,-70]", "must have a z within the depth limits"),
        ("noise.yaw.low=0.2", "noise.yaw.low=0.2: must be at most noise.yaw.high=0.1"),
        ("noise.sign=up", "noise.sign=up: unknown; valid: both, positive"),
        ("name=a/b", "name='a/b': must be a plain name"),
        ("train.total_steps=0", "train.total_steps=0: must be at least 1"),
        ("reward.k=1,2", r"reward.k=1,2: several values make a grid: auvbench train -m reward.k=1,2"),
        ("reward.name=\u00ad3", r"reward.name=.*: contains U\+00AD"),
        ("nonsense", "'nonsense': an override must be key=value"),
        ("train.progress=maybe", "train.progress: .*'maybe'"),
        ("algo.gamma=(1", r"algo.gamma=\(1: the value cannot be read"),
    ],
)
def test_a_mistake_is_one_line(override, message):
    with pytest.raises(ConfigError, match=message) as caught:
        train_config(compose("train", [override]))
    assert "\n" not in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("algo", "override", "message"),
    [
        ("tqc", "top_quantiles_to_drop_per_net=25", "must be less than algo.n_quantiles=15"),
        ("tqc", "n_quantiles=0", "must be at least 1 and at most 10000"),
        ("tqc", "ent_coef=low", "must be auto"),
        ("crossq", "batch_size=1", "must be at least 2 for batch normalisation"),
        ("crossq", "ent_coef=low", "must be auto"),
        ("crossq", "critic_net_arch=[64,0]", "must have widths of at least 1"),
        ("crossq", "batch_norm_momentum=0", "must be more than 0 and at most 1"),
        ("crossq", "tau=0.1", "only sac, ddpg, td3, tqc, sac_residual have it"),
        ("trpo", "batch_size=1000", "must divide .* = 4096"),
        ("trpo", "target_kl=0", "must be more than 0 and at most 10"),
        ("trpo", "line_search_shrinking_factor=1", "must be less than 1"),
        ("trpo", "sub_sampling_factor=4000", "must leave at least 2 of the .* = 4096 samples"),
        ("recurrent_ppo", "lstm_size=0", "must be at least 1 and at most 16384"),
        ("ppo_residual", "base=null", "name an option"),
    ],
)
def test_a_mistake_in_an_algorithm_is_one_line(algo, override, message):
    with pytest.raises(ConfigError, match=rf"algo\.{override.partition('=')[0]}.*{message}") as caught:
        train_config(compose("train", [f"algo={algo}", f"algo.{override}"]))
    assert "\n" not in str(caught.value)


def test_a_value_of_a_base_is_not_refused_as_a_key_of_other_agents():
    with pytest.raises(ConfigError, match=r"algo\.base: unknown key; algo\.base=NAME chooses"):
        compose("train", ["algo=ppo_residual", "algo.base.name=lqr"])


@pytest.mark.parametrize("task", TASKS)
def test_a_search_has_the_reward_and_the_measure_of_its_task(task):
    search, run = compose("tune", [f"task={task}", "vehicle=bluerov2_heavy", "algo=pid"]), f"task={task}"
    assert search.reward == compose("train", [run]).reward
    plan, _ = plan_of(search, {}, {})
    assert plan.tune.objective == TASKS[task].primary
    other = compose("tune", [run, "vehicle=bluerov2_heavy", "algo=pid", "tune.objective=par1_steps"])
    assert plan_of(other, {}, {})[0].tune.objective == "par1_steps"


def test_several_values_of_a_test_are_no_grid():
    with pytest.raises(ConfigError, match="protocol=thesis,validation: takes one value"):
        compose("evaluate", ["protocol=thesis,validation"])


@pytest.mark.slow
def test_an_algorithms_own_keys_are_suggested():
    with pytest.raises(ConfigError, match=r"did you mean algo.buffer_size\?"):
        compose("train", ["algo=sac", "algo.bufer_size=3"])


def test_the_working_directory_adds_answers(tmp_path, monkeypatch):
    (tmp_path / "conf" / "reward").mkdir(parents=True)
    (tmp_path / "conf" / "reward" / "mine.yaml").write_text(
        (CONF / "reward" / "thesis.yaml").read_text(encoding="utf-8").replace("k: 1.0", "k: 7.0"),
        encoding="utf-8",
    )
    monkeypatch.chdir(tmp_path)
    assert compose("train", ["reward=mine"]).reward.k == 7.0


def test_changing_a_composed_configuration_leaves_the_next_one_alone():
    first = compose("train", ["algo=sac"])
    with open_dict(first):
        first.algo.gamma = 0.5
        del first["noise"]
    second = compose("train", ["algo=sac"])
    assert second.algo.gamma != 0.5
    assert "noise" in second


def test_a_file_of_ones_own_is_read_each_time(tmp_path):
    own = tmp_path / "reward" / "mine.yaml"
    own.parent.mkdir()
    for k in (2.0, 3.0):
        own.write_text(f"defaults: [thesis]\nk: {k}\n")
        assert compose("train", ["reward=mine"], folder=tmp_path).reward.k == k


def test_a_study_is_tuned_with_the_groups_of_a_training() -> None:
    """A trial with other groups would be another run than the one that its settings give when typed."""
    groups = {
        name: [
            next(iter(entry))
            for entry in yaml.safe_load((CONF / f"{name}.yaml").read_text())["defaults"]
            if isinstance(entry, dict)
        ]
        for name in ("train", "tune")
    }
    lacking = [group for group in groups["train"] if group not in groups["tune"]]
    assert lacking == []
