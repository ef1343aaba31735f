"""What a pilot sees and records, against the compiled task."""

import csv
import math
import re
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from auvbench.cli import main
from auvbench.config.compose import compose
from auvbench.config.validate import train_config
from auvbench.envs.batch import Batch
from auvbench.errors import ConfigError, RunError, UserError
from auvbench.evaluation.replay import read_mission
from auvbench.integrations.commands import pilot as command
from auvbench.integrations.commands.pilot import task_of, task_of_policy
from auvbench.pilot.excite import Excite
from auvbench.pilot.live_observation import observe, supplied
from auvbench.pilot.mission import Logbook, Mission
from auvbench.pilot.steering import Limits, Steering
from auvbench.record import record_columns
from auvbench.registry import TASKS
from auvbench.tasks.observation_spec import observation_spec
from auvbench.vehicles.sheet import load
from tests import configs
from tests.waiting import LIMIT


def seen_by_pilot(batch, goal, action, yaw=None):
    simulator, task = batch.simulator, batch.config.task
    depth = (task.depth_low, task.depth_high)
    return observe(
        batch.task.spec, simulator.pose[0], simulator.velocity[0], goal, action, yaw=yaw, depth=depth
    )


def flown(frame, vehicle, max_steps, seed):
    """An episode of the task and what a pilot makes of the same poses: observations, row, the compiled row."""
    overrides = [f"task.position_frame={frame}", f"vehicle={vehicle}", "noise=none", "algo=pid"]
    config = train_config(compose("train", [*overrides, f"task.max_steps={max_steps}"], folder=None))
    batch = Batch(config, 1, seed=seed, autoreset=False)
    seen = batch.reset()
    pose, waypoint = batch.simulator.pose, batch.task.episodes[0].reference.copy()
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
    action = np.zeros(len(batch.vehicle.actuators))
    while True:
        mine = seen_by_pilot(batch, waypoint, action)
        np.testing.assert_array_equal(mine, seen[0])
        action = (
            np.clip(np.asarray(agent.act(mine[None]), dtype=np.float64)[0], -1.0, 1.0)
            if agent is not None
            else rng.uniform(-1, 1, action.shape)
        )
        result = batch.step(action[None])
        seen = result.observation
        outcome = mission.advance(
            pose[0].copy(), action, batch.vehicle.force(action), float(batch.vehicle.power(action))
        )
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


@pytest.mark.parametrize("task", ["waypoint", "station_keeping"])
def test_every_block_that_topics_supply_has_the_same_bits(task):
    blocks = [name for name in supplied() if name in TASKS[task].blocks]
    assert len(blocks) >= len(supplied()) - 1
    words = [f"task={task}", "vehicle=bluerov2_heavy", "noise=none", f"task.observation=[{','.join(blocks)}]"]
    station = ["task.yaw=-2.0", "task.station=[1.0,2.0,-7.0]"] if task == "station_keeping" else []
    batch = Batch(train_config(compose("train", [*words, *station], folder=None)), 1, seed=5)
    seen = batch.reset()
    goal, yaw = batch.task.reference[0].copy(), -2.0 if station else None
    rng = np.random.default_rng(1)
    action = np.zeros(8)
    for _ in range(30):
        np.testing.assert_array_equal(seen_by_pilot(batch, goal, action, yaw), seen[0])
        action = rng.uniform(-1.0, 1.0, 8)
        seen = batch.step(action[None]).observation


def steering(logbook, holds):
    vehicle = load("bluerov2_heavy")
    task = task_of("station_keeping" if holds else "waypoint", "--task")
    limits = Limits(-60.0, -1.0, goal_radius=3.0, max_steps=5, holds=holds)
    return Steering(
        command.classical("pid", vehicle, 10.0, task),
        vehicle,
        frequency=10.0,
        spec=observation_spec(task, vehicle.actuators),
        limits=limits,
        logbook=logbook,
    )


def test_a_station_is_held_on_and_becomes_several_missions(tmp_path, monkeypatch):
    log = Logbook(tmp_path / "log", {"frequency_hz": 10.0})
    pilot = steering(log, holds=True)
    resets = []
    monkeypatch.setattr(
        pilot.controller, "reset", lambda e, reset=pilot.controller.reset: resets.append(reset(e))
    )
    pilot.waypoint, pilot.yaw = np.array([0.0, 0.0, -10.0]), 1.0
    pose = np.array([0.0, 0.0, -10.0, 1.0, 0.0, 0.0, 0.0])
    for _ in range(12):
        assert pilot.advance(pose) == ""
        action = pilot.act(pose, np.zeros(6))
        assert np.abs(action).max() > 0.0  # it turns to the yaw
    pilot.end("by the service stop")
    pilot.write()
    assert [row["steps"] for row in log._rows] == [5, 5, 1]
    assert [row["outcome"] for row in log._rows] == ["timeout", "timeout", "aborted"]
    assert len(resets) == 1
    there = steering(None, holds=False)
    there.waypoint = pilot.waypoint
    there.act(pose, np.zeros(6))
    assert there.advance(pose) == "success"


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
    with pytest.raises(RunError, match="already has missions"):
        Logbook(tmp_path / "log", {"frequency_hz": 10.0})


def test_a_mission_that_was_ended_is_read_again(tmp_path):
    about = {
        "controller": "pid",
        "vehicle": "bluerov2",
        "actuators": list(load("bluerov2").actuators),
        "frequency_hz": 10.0,
        "goal_radius_m": 1.0,
        "depth_low_m": -60.0,
        "depth_high_m": -1.0,
        "max_steps": 100,
    }
    pose = np.array([0.0, 0.0, -10.0, 1.0, 0.0, 0.0, 0.0])
    limits = {"depth": (-60.0, -1.0), "goal_radius": 1.0, "max_steps": 100, "frequency": 10.0}
    mission = Mission(pose, np.array([5.0, 0.0, -10.0]), **limits)
    mission.advance(pose, np.zeros(6), np.zeros(6), 0.0)
    Logbook(tmp_path / "log", about).add(mission, "by the service stop")
    replay = read_mission(tmp_path / "log", 0)
    assert replay.position.shape == (2, 3)


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    """A policy as a file with its card: PPO, hardly trained."""
    folder = tmp_path_factory.mktemp("policy")
    learner = ["algo.n_envs=2", "algo.n_steps=32", "algo.batch_size=64", "train.total_steps=64"]
    assert (
        main(["train", *configs.ORIGINAL, "algo=ppo", f"output={folder}", "train.progress=false", *learner])
        == 0
    )
    (run,) = (folder / "default").glob("*/")
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
    with pytest.raises(UserError, match="choose another sheet with --vehicle"):
        command._setup(command.parser().read([str(policy), "--vehicle", "bluerov2_heavy"]))
    with pytest.raises(ConfigError, match="did you mean 'pid'"):
        command._setup(command.parser().read(["pidd"]))


CARD = {"position_frame": "body", "depth_low_m": -60.0, "depth_high_m": -1.0, "max_steps": 600}


def card_of(task, observation, **named):
    return SimpleNamespace(
        observed=observation,
        task=SimpleNamespace(position_frame="body"),
        document={"task": {"name": task} | CARD | named},
    )


def labels_of(task, *overrides):
    config = train_config(
        compose("train", [f"task={task}", "vehicle=bluerov2_heavy", *overrides], folder=None)
    )
    return tuple(e["name"] for e in observation_spec(config.task, load("bluerov2_heavy").actuators).card())


def test_a_policy_of_a_station_is_steered_by_as_its_card_says():
    labels = labels_of("station_keeping")
    task, spec = task_of_policy("x.onnx", card_of("station_keeping", labels), None, load("bluerov2_heavy"))
    assert task.name == "station_keeping"
    assert tuple(entry["name"] for entry in spec.card()) == labels


@pytest.mark.parametrize(
    ("task", "overrides", "named", "asked", "words"),
    [
        ("docking", [], {}, None, "docking"),
        ("path_following", [], {}, None, "path_following"),
        ("station_keeping", ["task.history=2"], {}, None, "position_error_x_1_steps_ago"),
        ("station_keeping", [], {}, "waypoint", "--task waypoint"),
        ("station_keeping", [], {"max_steps": "many"}, None, "an invalid task entry"),
        ("waypoint", [], {}, None, "goal_radius_m"),
    ],
)
def test_a_policy_that_a_pilot_cannot_steer_by_is_refused(task, overrides, named, asked, words):
    card = card_of(task, labels_of(task, *overrides), **named)
    with pytest.raises(UserError, match=words):
        task_of_policy("x.onnx", card, asked, load("bluerov2_heavy"))


def test_a_number_that_topics_do_not_supply_is_named():
    card = card_of("waypoint", ("sonar", "depth"), goal_radius_m=3.0)
    with pytest.raises(UserError, match="observes sonar"):
        task_of_policy("x.onnx", card, None, load("bluerov2_heavy"))


@pytest.mark.slow
def test_a_pilot_needs_no_compiler_no_torch_and_no_hydra(policy):
    code = """
import sys
import numpy
from auvbench.cli import main
from auvbench.integrations.commands import pilot
station = ["--task", "station_keeping", "--vehicle", "bluerov2_heavy"]
for words in (*([name] for name in pilot.controllers()), [sys.argv[2]], ["lqr", *station]):
    setup = pilot._setup(pilot.parser().read(words))
    setup.controller.reset(numpy.zeros(1, dtype="int64"))
    setup.controller.act(numpy.zeros((1, setup.spec.size), dtype="float32"))
import auvbench.integrations.ros2.pilot, auvbench.pilot.mission, auvbench.runs.interruption
import auvbench.integrations.mavlink.pilot
from auvbench.integrations.ardusub.frames import motors_of
from auvbench.integrations.ardusub.radio import dialect
from auvbench.integrations.mavlink import mixer
from auvbench.integrations.ros2 import middleware
from auvbench.vehicles import sheet
middleware.load()
dialect()
mixed = mixer.Mixer(motors_of(sheet.load("bluerov2")))
mixed.sticks(mixed.axes(numpy.ones(6), mixed.limits(0.5)), 0.5)
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


def test_a_manoeuvre_is_the_telegraph_signal_of_its_axis_and_ends_at_rest():
    vehicle = load("bluerov2_2026")
    manoeuvre = Excite(vehicle, ["surge", "yaw"], 0.2, 10.0, 20.0)
    assert manoeuvre.steps == 400
    seen = np.zeros((1, 3), dtype=np.float32)
    actions = np.array([manoeuvre.act(seen)[0] for _ in range(401)])
    wrench = vehicle.force(actions) @ vehicle.allocation.T
    # Half a second in which it only balances weight and buoyancy.
    np.testing.assert_allclose(
        wrench[:10], np.tile([0, 0, vehicle.weight - vehicle.buoyancy, 0, 0, 0], (10, 1)), atol=0.05
    )
    surge, yaw = wrench[10:200], wrench[200:400]
    assert min(surge[:, 0]) < 0 < max(surge[:, 0])
    assert np.max(np.abs(surge[:, 5])) < 1e-3 * np.max(np.abs(surge[:, 0]))
    assert min(yaw[:, 5]) < 0 < max(yaw[:, 5])
    assert not np.any(actions[400])
    manoeuvre.reset(np.zeros(1, dtype=np.int64))
    np.testing.assert_array_equal(manoeuvre.act(seen)[0], actions[0])


def protected(*arguments):
    given = command.parser().read(["pid", *arguments])
    setup = command._setup(given)
    setup.filter = command.protection(given, setup)
    return setup


def test_a_filter_keeps_a_pilot_off_the_walls_of_a_tank_and_says_how_often(tmp_path):
    tank = ["--filter", "cbf", "--tank", "8", "8", "30", "--depth", "-60", "-1"]
    setup = protected(*tank)
    log = setup.logbook = Logbook(tmp_path / "log", {"frequency_hz": 10.0})
    overrides = [f"vehicle={setup.vehicle.name}", "algo=pid", "noise=none", "disturbance=none"]
    ends = []
    for kept in (setup.filter, None):
        batch = Batch(train_config(compose("train", overrides, folder=None)), 1, seed=3, autoreset=False)
        batch.reset()
        pose, velocity = batch.simulator.pose[0], batch.simulator.velocity[0]
        x, y, z = pose[:3]
        # Beyond the wall, which a pilot does not accept as a waypoint.
        setup.filter, setup.waypoint = kept, np.array([x + 12.0, y, z])
        for _ in range(120):
            setup.advance(pose)
            batch.step(setup.act(pose.copy(), velocity.copy())[None])
        setup.end("the test is over")
        setup.write()
        ends.append(protected(*tank).filter._room(pose[:3]))
    # Without the filter the vehicle is through the wall; with it, it waits at the margin of 0.1 m.
    assert ends[1] < -1.0
    assert -0.1 < ends[0] < 0.1
    filtered, plain = log._reasons
    assert re.search(r"; the filter changed [1-9]\d* commands, 0 of them beyond", filtered)
    assert plain == "the test is over"


def test_a_filter_knows_the_bottom_of_a_file_where_the_poses_are(tmp_path):
    heights = {(x, y): -10.0 + 0.5 * x for x in range(-8, 9) for y in range(92, 109)}
    file = tmp_path / "bottom.csv"
    file.write_text("x_m,y_m,z_m\n" + "".join(f"{x},{y},{z}\n" for (x, y), z in heights.items()))
    filtered = protected("--filter", "cbf", "--bottom", str(file)).filter
    deep, shallow = (filtered._room(np.array([x, 102.0, -8.0])) for x in (-4.0, 2.0))
    hull = (4.0 / math.sqrt(1.25)) - deep  # at x = -4 the plane is 4 m below, and its slope is 1 in 2
    assert 0.2 < hull < 0.6
    assert shallow == pytest.approx(1.0 / math.sqrt(1.25) - hull, abs=1e-6)
    assert filtered.refusal(np.array([-4.0, 102.0, -8.0])) == ""
    assert "too near to a solid" in filtered.refusal(np.array([4.0, 102.0, -8.0]))
    assert "outside the grid" in filtered.refusal(np.array([-4.0, 2.0, -8.0]))
    assert "depth limit" in filtered.refusal(np.array([-4.0, 102.0, -1.05]))


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--tank", "8", "8", "30"], "--tank: needs --filter cbf"),
        (["--filter", "cbf", "--tank", "8", "8", "30", "--bottom", "b.csv"], "leave out --tank or --bottom"),
        (["--filter", "cbf", "--bottom", "b.csv"], "--bottom b.csv: "),
        (["--filter", "cbf", "--vehicle", "lrauv"], "needs a vehicle with only thrusters"),
        (["--filter", "cbf", "--tank", "8", "8", "30", "--goal", "3.9", "0", "-9"], "too near to a solid"),
        (["--filter", "cbf", "--depth", "-1", "-0.9"], "must be more than 0.2 m apart"),
        (["--filter", "cfb"], "cbf"),
    ],
)
def test_a_filter_that_cannot_protect_is_refused(arguments, text, capsys):
    assert main(["pilot", "pid", *arguments]) == 2
    assert text in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["excite"], "needs --axis"),
        (["excite", "--axis", "pitch"], "--axis pitch: bluerov2_2026 cannot push along it"),
        (["excite", "--axis", "yaw", "--goal", "1", "2", "-3"], "--goal: is not for excite"),
        (["excite", "--axis", "yaw", "--yaw", "90"], "--yaw: is not for excite"),
        (["excite", "--axis", "yaw", "--frequency", "1"], "--frequency 1: must be at least 5 Hz for excite"),
        (["excite", "--axis", "yaw", "--amplitude", "0.05"], "0.05"),
        (["exite", "--axis", "yaw"], "did you mean 'excite'?"),
        (["pid", "--reach", "3"], "--reach: is for excite"),
        (["pid", "--yaw", "90"], "--yaw 90: needs --goal"),
    ],
)
def test_a_manoeuvre_that_cannot_be_flown_is_refused(arguments, text, capsys):
    assert (
        main(
            ["pilot", *arguments, "--mavlink", "udp:127.0.0.1:1"]
            if "pid" not in arguments
            else ["pilot", *arguments]
        )
        == 2
    )
    assert text in capsys.readouterr().err
