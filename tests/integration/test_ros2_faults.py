"""What goes wrong between a run and its server, over real DDS: one line that names the topic, and nothing lost."""

import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import torch

from auvbench.cli import main
from auvbench.config.simulators import Ros2
from auvbench.errors import TrainingError
from auvbench.ros2.connection import Connection
from auvbench.ros2.middleware import InterfaceError, Session
from auvbench.runs.directory import RunDirectory
from auvbench.simulators import ros2
from auvbench.vehicles.sheet import load
from tests import dds

pytestmark = dds.needs_ros

THRUSTERS = tuple(f"thruster{i}" for i in range(1, 7))
STILL = np.zeros((1, 6))


@pytest.fixture(scope="module")
def domain():
    with dds.domain() as number:
        yield number
        ros2._leave()


@pytest.fixture(scope="module")
def server(domain):
    with dds.serving() as process:
        yield process


@pytest.fixture
def elsewhere(domain):
    """A domain of its own, beside that of the server that the other tests share."""
    with dds.domain():
        yield
        ros2._leave()


def connected(namespace="bluerov2", clock="auto", timeout=20.0):
    return Connection(namespace, THRUSTERS, clock, timeout)


def test_a_server_that_starts_late_is_waited_for_and_one_that_stops_is_said(elsewhere):
    found = []
    waiting = threading.Thread(target=lambda: found.append(connected(timeout=60.0)))
    waiting.start()
    time.sleep(1.0)
    with dds.serving():
        waiting.join(60.0)
        (connection,) = found
        assert connection.clock == "lockstep"
        connection.step(STILL, 0.1)
    connection.timeout = 1.0
    with pytest.raises(TrainingError, match=r"/bluerov2/odom: silent for 1 s; the server has stopped"):
        connection.step(STILL, 0.1)
    connection.close()


def test_nobody_there(elsewhere):
    with pytest.raises(
        InterfaceError, match=r"/bluerov2/odom: nobody publishes it within 0.2 s.*ROS_DOMAIN_ID"
    ):
        connected(timeout=0.2)


def test_another_namespace_another_vehicle_and_company(server):
    with pytest.raises(
        InterfaceError, match=r"/bluerov3/odom: .* simulator.namespace: did you mean 'bluerov2'"
    ):
        connected("bluerov3", timeout=15.0)
    with pytest.raises(InterfaceError, match=r"/bluerov2/cmd_thruster9: nobody listens"):
        Connection("bluerov2", ("thruster1", "thruster9"), "auto", 8.0)
    first = connected()
    with pytest.raises(InterfaceError, match=r"/bluerov2/cmd_thruster1: somebody else commands this vehicle"):
        connected()
    first.step(STILL, 0.1)
    # A second server in the same namespace sees the first one and leaves.
    second = dds.Process("serve")
    try:
        assert second.ends() == 2
    finally:
        second.stop()
    assert "/bluerov2/odom: somebody else publishes it too" in second.output
    assert "--namespace" in second.output
    # Somebody else moves the clock of a server in lock-step.
    stranger = Session()
    node = stranger.node("stranger")
    client = node.create_client(stranger.ros.services.Trigger, "/bluerov2/step")
    stranger.renew()
    assert stranger.seen(client.service_is_ready, 10.0)
    answer = stranger.ask(client, stranger.ros.services.Trigger.Request())
    assert stranger.until(lambda: answer.value is not None, 10.0)
    stranger.close()
    time.sleep(0.3)
    with pytest.raises(TrainingError, match=r"/bluerov2/odom: is 0.1 s ahead .* somebody else"):
        first.step(STILL, 0.1)
    first.close()


BLIND = (
    "from auvbench.ros2.server import Server; Server.alone = lambda *_: None; from auvbench.cli import main; "
)


def test_a_server_that_sees_the_first_one_late_leaves_and_the_first_one_stays(server):
    first = connected()
    first.step(STILL, 0.1)
    code = f"{BLIND}raise SystemExit(main(['serve']))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 2
    assert "/bluerov2/odom: somebody else publishes it too" in done.stderr
    assert "--namespace" in done.stderr
    assert server.process.poll() is None
    first.close()
    connected().close()


def test_two_servers_that_both_live(domain):
    stranger = Session()
    node = stranger.node("stranger")
    for _ in range(2):
        node.create_publisher(stranger.ros.nav.Odometry, "/twins/odom", stranger.qos)
    with pytest.raises(InterfaceError, match=r"/twins/odom: 2 publish it: several servers"):
        connected("twins")
    stranger.close()


def test_what_the_server_refuses(server):
    connection = connected()
    assert connection.clock == "lockstep"
    with pytest.raises(InterfaceError, match=r"start_pose: its quaternion .* has length 2, must be 1"):
        connection.set({0: {"start_pose": [0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0]}})
    with pytest.raises(InterfaceError, match=r"effectiveness: has 2 numbers, must have 6"):
        connection.set({0: {"effectiveness": [1.0, 1.0]}})
    with pytest.raises(InterfaceError, match=r"step_duration: 0.0 is not in 0.0001 .. 60 s"):
        connection.step(STILL, 0.0)
    connection.close()


def test_delayed_is_not_lost_and_halted_is_said(server):
    connection = connected()
    connection.step(STILL, 0.1)
    before = connection._stamp.copy()
    server.send(signal.SIGSTOP)
    threading.Timer(1.0, server.send, (signal.SIGCONT,)).start()
    begun = time.monotonic()
    connection.step(STILL, 0.1)
    assert time.monotonic() - begun > 0.5
    np.testing.assert_array_equal(connection._stamp - before, 100_000_000)
    connection.timeout = 0.5
    server.send(signal.SIGSTOP)
    with pytest.raises(
        TrainingError, match=r"/bluerov2/odom: silent for 0.5 s; was the server killed or halted"
    ):
        connection.step(STILL, 0.1)
    with pytest.raises(TrainingError, match=r"/bluerov2/reset: no answer within 0.5 s"):
        connection.reset([0], {})
    connection.close()


LEARNER = [
    "algo=ppo",
    "algo.n_envs=1",
    "algo.n_steps=64",
    "algo.batch_size=64",
    "train.total_steps=320",
    "train.checkpoint.steps=64",
    "train.progress=false",
    "simulator=ros2",
    "simulator.timeout=10",  # DDS announces itself again every 3 s: on a busy machine the first ones may be lost
    "task.max_steps=30",
]


def test_a_training_whose_server_is_killed_goes_on_with_the_next_one(elsewhere, tmp_path, capsys):
    torch.set_num_threads(1)
    command = ["train", f"output={tmp_path}", *LEARNER]
    with dds.serving("--lockstep") as server:
        watcher = threading.Thread(target=_kill_after_checkpoint, args=(tmp_path, server))
        watcher.start()
        assert main(command) == 1
        watcher.join()
    (path,) = (tmp_path / "default").glob("ppo-*")
    error = capsys.readouterr().err
    assert "/bluerov2/" in error
    assert "for 10 s" in error or "within 10 s" in error
    manifest = RunDirectory(path).manifest()
    assert manifest["state"] == "failed"
    assert "/bluerov2/" in manifest["error"]["message"]
    assert 0 < manifest["steps"] < 320
    with dds.serving("--lockstep"):
        assert main(command) == 0
    manifest = RunDirectory(path).manifest()
    assert (manifest["state"], manifest["steps"]) == ("complete", 320)
    assert manifest["episodes_begun_again"]
    assert "clock lockstep" in manifest["versions"]["ros2"]


def _kill_after_checkpoint(folder, server):
    end = time.monotonic() + 60.0
    while time.monotonic() < end and not list(folder.glob("default/ppo-*/checkpoints/*/*")):
        time.sleep(0.01)
    server.send(signal.SIGKILL)


def test_a_restarted_server_gets_a_new_connection(elsewhere):
    settings = Ros2(name="ros2", namespace=None, clock="lockstep", timeout=20.0)
    vehicle = load("bluerov2")
    with dds.serving("--lockstep"):
        first = ros2.connect(settings, vehicle)
        for _ in range(3):
            first.step(STILL, 0.1)
        assert ros2.connect(settings, vehicle) is first
    with dds.serving("--lockstep"):
        odometry = first.names[0].odometry
        assert first.session.seen(lambda: first.node.count_publishers(odometry) == 1, 60.0)
        ros2.connect(settings, vehicle).step(STILL, 0.1)


def test_no_validation_on_a_servers_vehicles(tmp_path, capsys):
    assert main(["train", f"output={tmp_path}", *LEARNER, "train.evaluate_every=64"]) == 2
    assert "train.evaluate_every=64: with simulator=ros2" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("environment", "message"),
    [
        ({"ROS_DOMAIN_ID": "400"}, "ROS_DOMAIN_ID=400: must be a whole number from 0 to 232"),
        ({"RMW_IMPLEMENTATION": "rmw_nope_cpp"}, "RMW_IMPLEMENTATION=rmw_nope_cpp: not installed"),
    ],
)
def test_a_middleware_that_does_not_start(domain, environment, message):
    done = subprocess.run(
        [sys.executable, "-m", "auvbench", "serve"],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 2, done.stderr
    said = [line for line in done.stderr.splitlines() if line.startswith("auvbench: ")]
    assert len(said) == 1
    assert message in said[0]


@pytest.mark.parametrize("module", ["rclpy", "nav_msgs"])
def test_without_the_extra(module):
    code = (
        f"import sys; sys.modules[{module!r}] = None\n"
        "from auvbench.cli import main\n"
        "sys.exit(main(['serve']))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert f"{module} (ROS 2 Jazzy) is not installed" in done.stderr
    assert "pip install 'auvbench[ros2]'" in done.stderr
