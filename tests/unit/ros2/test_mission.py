"""What a pilot sees and records, against the compiled task."""

import csv
import math
import subprocess
import sys

import numpy as np
import pytest

from auvbench.cli import main
from auvbench.commands import pilot as command
from auvbench.config.compose import compose
from auvbench.config.validate import train_config
from auvbench.envs.batch import Batch
from auvbench.errors import ConfigError, RunError, UserError
from auvbench.record import record_columns
from auvbench.ros2.mission import Logbook, Mission
from auvbench.ros2.observation import observe
from auvbench.ros2.thrust import SheetThrust
from auvbench.tasks.kernels import F_REFERENCE
from tests.waiting import LIMIT


def flown(frame, vehicle, max_steps, seed):
    """An episode of the task and what a pilot makes of the same poses: observations, row, the compiled row."""
    overrides = [f"task.position_frame={frame}", f"vehicle={vehicle}", "noise=none", "algo=pid"]
    config = train_config(compose("train", [*overrides, f"task.max_steps={max_steps}"], folder=None))
    batch = Batch(config, 1, seed=seed, autoreset=False)
    seen = batch.reset()
    pose, waypoint = batch.simulator.pose, batch.task.F[0, F_REFERENCE : F_REFERENCE + 3].copy()
    thrust = SheetThrust(batch.vehicle)
    task = config.task
    mission = Mission(
        pose[0].copy(),
        waypoint,
        depth=(task.depth_low, task.depth_high),
        goal_radius=task.goal_radius,
        max_steps=max_steps,
        frequency=config.step.frequency,
    )
    agent = command.classical("pid", batch.vehicle, config.step.frequency) if frame == "world" else None
    if agent is not None:
        agent.reset(np.zeros(1, dtype=np.int64))
    rng = np.random.default_rng(0)
    action = np.zeros(len(thrust.actuators))
    while True:
        mine = observe(batch.task.spec, pose[0], waypoint, action)
        np.testing.assert_array_equal(mine, seen[0])
        action = (
            np.clip(np.asarray(agent.act(mine[None]), dtype=np.float64)[0], -1.0, 1.0)
            if agent is not None
            else rng.uniform(-1, 1, action.shape)
        )
        result = batch.step(action[None])
        seen = result.observation
        outcome = mission.advance(pose[0].copy(), action, thrust.force(action), thrust.power(action))
        assert bool(outcome) == bool(len(result.ended))
        if outcome:
            return mission, result.records[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("frame", "vehicle", "max_steps"),
    [("world", "bluerov2", 400), ("world", "bluerov2_heavy", 30), ("body", "rexrov", 40)],
)
def test_observations_are_the_same_bits_and_rows_the_same_numbers(frame, vehicle, max_steps):
    mission, compiled = flown(frame, vehicle, max_steps, seed=3)
    row = mission.record(0)
    assert tuple(row) == record_columns("waypoint")
    assert math.isnan(row.pop("return"))
    for name, value in row.items():
        if isinstance(value, str):
            assert value == compiled[name]
        else:
            assert value == pytest.approx(compiled[name], rel=1e-12, abs=1e-12), name


def test_a_logbook_is_whole_after_each_mission(tmp_path):
    mission, _ = flown("world", "bluerov2", 20, seed=3)
    log = Logbook(tmp_path / "log", {"frequency_hz": 10.0})
    log.add(mission, "timeout")
    mission.outcome = ""
    log.add(mission, "by the service stop")
    with open(tmp_path / "log" / "episodes.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["outcome"] for row in rows] == ["timeout", "aborted"]
    with np.load(tmp_path / "log" / "trajectories.npz") as arrays:
        assert arrays["position_mission_1"].shape == (21, 3)
        assert arrays["command_mission_0"].shape == (20, 6)
    with pytest.raises(RunError, match="holds missions already"):
        Logbook(tmp_path / "log", {"frequency_hz": 10.0})


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    """A policy as a file with its card: PPO, hardly trained."""
    folder = tmp_path_factory.mktemp("policy")
    learner = ["algo.n_envs=2", "algo.n_steps=32", "algo.batch_size=64", "train.total_steps=64"]
    assert main(["train", "algo=ppo", f"output={folder}", "train.progress=false", *learner]) == 0
    (run,) = (folder / "default").iterdir()
    assert main(["export", str(run), "--out", str(folder / "exports")]) == 0
    (file,) = (folder / "exports").glob("*.onnx")
    return file


@pytest.mark.slow
def test_a_policy_from_a_file_is_steered_by_as_its_card_says(policy):
    setup = command._setup(command.parser().read([str(policy)]))
    assert (setup.vehicle.name, setup.frequency, setup.spec.size) == ("bluerov2", 10.0, 10)
    limits = setup.limits
    assert (limits.depth_low, limits.depth_high, limits.goal_radius) == (-60.0, -1.0, 3.0)
    action = setup.controller.act(np.zeros((1, 10), dtype=np.float32))
    assert action.shape == (1, 6)
    with pytest.raises(UserError, match="--vehicle names another sheet"):
        command._setup(command.parser().read([str(policy), "--vehicle", "bluerov2_heavy"]))
    with pytest.raises(ConfigError, match="did you mean 'pid'"):
        command._setup(command.parser().read(["pidd"]))


@pytest.mark.slow
def test_a_pilot_needs_no_compiler_no_torch_and_no_hydra(policy):
    code = """
import sys
import numpy
from auvbench.cli import main
from auvbench.commands import pilot
for name in (*pilot.CONTROLLERS, sys.argv[2]):
    setup = pilot._setup(pilot.parser().read([name]))
    setup.controller.reset(numpy.zeros(1, dtype="int64"))
    setup.controller.act(numpy.zeros((1, 10), dtype="float32"))
import auvbench.ros2.pilot, auvbench.ros2.thrust, auvbench.ros2.mission, auvbench.runs.interruption
from auvbench.ros2 import middleware
middleware.load()
print(sorted({name.partition(".")[0] for name in sys.modules} & set(sys.argv[1].split())))
"""
    heavy = "torch stable_baselines3 sb3_contrib numba llvmlite hydra omegaconf gymnasium pandas matplotlib optuna casadi"
    done = subprocess.run(
        [sys.executable, "-c", "import sys; sys.argv[0] = 'auvbench'\n" + code, heavy, str(policy)],
        capture_output=True,
        text=True,
        timeout=LIMIT,
    )
    assert done.stdout.strip() == "[]", done.stdout + done.stderr
