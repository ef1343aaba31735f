"""Over real DDS in lock-step, everything is the same to the last bit."""

import csv
import dataclasses
import json

import numpy as np
import pytest
import torch

from auvbench.cli import main
from auvbench.config.compose import compose
from auvbench.config.validate import train_config
from auvbench.envs.batch import Batch
from auvbench.errors import ConfigError
from auvbench.integrations.ros2 import simulator as ros2
from auvbench.integrations.ros2.spec import Ros2
from auvbench.runs.directory import RunDirectory
from tests import configs, dds
from tests.waiting import LIMIT

pytestmark = [dds.needs_ros, pytest.mark.slow]


@pytest.fixture(scope="module")
def two_vehicles():
    with dds.domain(), dds.serving("--lockstep", "--vehicles", "2") as server:
        yield server
        ros2.leave()


SETTINGS = Ros2(name="ros2", namespace=None, clock="lockstep", timeout=LIMIT)


def batches(*overrides, n=2):
    """The same environments in this process and over ROS 2."""
    config = train_config(compose("train", list(configs.original(*overrides)), folder=None))
    return Batch(config, n), Batch(dataclasses.replace(config, simulator=SETTINGS), n)


@pytest.mark.parametrize(
    "overrides",
    [
        ["noise=thesis"],
        ["disturbance=severe"],
        ["disturbance=depth_current"],
        ["disturbance=gauss_markov"],
        ["disturbance=fault", "disturbance.fault.probability=1.0", "disturbance.fault.time=0.3"],
        ["disturbance=delay"],
        ["disturbance=randomised", "step.frequency=25"],
        *(
            [f"task={task}", "noise=thesis", "disturbance=moderate", "task.time_limit=null"]
            for task in ("trajectory_tracking", "path_following", "docking")
        ),
        [
            *("task=station_keeping", "noise=thesis", "disturbance=moderate", "task.time_limit=null"),
            *("task.settling=1", "task.hold_time=1"),
        ],
    ],
    ids=lambda overrides: overrides[0],
)
def test_environments_are_the_same_bits(two_vehicles, overrides):
    here, there = batches(*overrides, "task.max_steps=25")
    rng = np.random.default_rng(0)
    np.testing.assert_array_equal(here.reset(), there.reset())
    ended = 0
    for _ in range(60):
        action = rng.uniform(-1.0, 1.0, (2, 6))
        one, two = here.step(action), there.step(action)
        np.testing.assert_array_equal(one.observation, two.observation)
        np.testing.assert_array_equal(one.reward, two.reward)
        np.testing.assert_array_equal(here.simulator.pose, there.simulator.pose)
        np.testing.assert_array_equal(here.simulator.velocity, there.simulator.velocity)
        assert one.records == two.records
        ended += len(one.ended)
    assert ended >= 4


def rows(folder, condition):
    with open(folder / "episodes.csv", newline="") as file:
        found = [row for row in csv.DictReader(file) if row.pop("condition") == condition]
    assert found
    return found


@pytest.mark.parametrize(
    ("algo", "task"), [("pid", "waypoint"), ("ppo", "waypoint"), ("lqr", "station_keeping")]
)
def test_a_test_has_the_same_rows_as_in_process(two_vehicles, algo, task, tmp_path):
    torch.set_num_threads(1)
    learner = ["algo.n_envs=8", "algo.batch_size=128", "train.total_steps=4096", "train.progress=false"]
    arguments = [
        "vehicle=bluerov2",
        f"output={tmp_path}",
        f"algo={algo}",
        f"task={task}",
        *(learner if algo == "ppo" else []),
    ]
    assert main(["train", *arguments]) == 0
    path = next((tmp_path / "default").glob("*/manifest.json")).parent
    wanted = ["protocol=ros2", "protocol.episodes=3", "--workers", "1"]
    assert main(["evaluate", str(path), *wanted]) == 0
    folder = RunDirectory(path).evaluation("ros2")
    assert rows(folder, "nominal") == rows(folder, "simulator=ros2")
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["clocks"] == {"simulator=ros2": "lockstep"}
    assert "clock lockstep; server: auvbench" in summary["versions"]["ros2"]
    with np.load(folder / "trajectories.npz") as paths:
        for episode in range(3):
            np.testing.assert_array_equal(
                paths[f"position_nominal_{episode}"], paths[f"position_simulator=ros2_{episode}"]
            )
    # Done is done, whichever clock the server offered.
    before = (folder / "summary.json").read_bytes()
    assert main(["evaluate", str(path), *wanted]) == 0
    assert (folder / "summary.json").read_bytes() == before


def test_more_vehicles_than_the_server_has(two_vehicles):
    config = train_config(compose("train", list(configs.ORIGINAL), folder=None))
    with pytest.raises(
        ConfigError, match="3 vehicles are needed at once, but the server has 2: start it with --vehicles 3"
    ):
        Batch(dataclasses.replace(config, simulator=SETTINGS), 3)
