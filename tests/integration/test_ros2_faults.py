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
from auvbench.errors import TrainingError
from auvbench.integrations.ros2 import discovery, interface
from auvbench.integrations.ros2 import simulator as ros2
from auvbench.integrations.ros2.connection import Connection
from auvbench.integrations.ros2.middleware import InterfaceError, Session
from auvbench.integrations.ros2.spec import Ros2
from auvbench.runs.directory import RunDirectory
from auvbench.training.checkpoint.store import CheckpointStore
from auvbench.vehicles.sheet import load
from tests import configs, dds
from tests.waiting import LIMIT, until

pytestmark = [dds.needs_ros, pytest.mark.slow]

THRUSTERS = tuple(f"thruster{i}" for i in range(1, 7))
STILL = np.zeros((1, 6))


@pytest.fixture(scope="module")
def domain():
    with dds.domain() as number:
        yield number
        ros2.leave()


@pytest.fixture(scope="module")
def server(domain):
    with dds.serving() as process:
        yield process


@pytest.fixture
def elsewhere(domain):
    """A domain of its own, beside that of the server that the other tests share."""
    with dds.domain():
        yield
        ros2.leave()


def connected(namespace="bluerov2", clock="auto", timeout=LIMIT):
    return Connection(namespace, THRUSTERS, clock, timeout)


def test_a_server_that_starts_late_is_waited_for_and_one_that_stops_is_said(elsewhere):
    found = []
    waiting = threading.Thread(target=lambda: found.append(connected()))
    waiting.start()
    with dds.serving():
        waiting.join(LIMIT)
        (connection,) = found
        assert connection.clock == "lockstep"
        connection.step(STILL, 0.1)
    odometry = connection.names[0].odometry
    assert connection.session.discovered(lambda: connection.node.count_publishers(odometry) == 0, LIMIT)
    connection.timeout = 1.0
    with pytest.raises(TrainingError, match=r"/bluerov2/odom: silent for 1 s; the server has stopped"):
        connection.step(STILL, 0.1)
    connection.close()


def test_nobody_there(elsewhere):
    with pytest.raises(InterfaceError, match=r"/bluerov2/odom: .*ROS_DOMAIN_ID"):
        connected(timeout=0.2)


@pytest.fixture
def client(server):
    connection = connected()
    yield connection
    connection.close()


@pytest.fixture
def stranger(domain):
    session = Session()
    yield session
    session.close()


def test_another_namespace_is_refused_with_those_there_are(server, stranger):
    node = stranger.node("stranger")
    assert stranger.discovered(lambda: discovery.list_namespaces(node) == ["bluerov2"], LIMIT)
    with pytest.raises(InterfaceError, match=r"/bluerov3/odom: .* did you mean 'bluerov2'"):
        discovery.find_server(stranger, node, "bluerov3", 0.0)


def ends_of(session, node, *actuators):
    """This end of a vehicle, once its server and other clients are discovered."""
    ros, names = session.ros, interface.Names("bluerov2")
    commands = {
        topic: node.create_publisher(ros.std.Float64, topic, session.qos)
        for topic in map(names.command, actuators)
    }
    reset = node.create_client(ros.services.Trigger, names.reset)
    session.renew()
    first = commands[names.command("thruster1")]
    assert session.discovered(lambda: dds.matched(first, reset), LIMIT)
    assert session.discovered(lambda: node.count_publishers(names.odometry) > 0, LIMIT)
    return discovery.Endpoints(names, commands, reset, reset)


def call(session, client, request):
    assert session.discovered(client.service_is_ready, LIMIT)
    answer = session.ask(client, request)
    assert session.until(lambda: answer.value is not None, LIMIT)
    return answer.value


def test_an_actuator_that_the_server_lacks_is_named(server, stranger):
    node = stranger.node("stranger")
    ends = ends_of(stranger, node, "thruster1", "thruster9")
    with pytest.raises(InterfaceError, match=r"^/bluerov2/cmd_thruster9: "):
        discovery.check_endpoints(stranger, node, [ends], 0.1)


def test_a_second_client_refuses_and_is_refused(server, stranger):
    first = connected()
    node = stranger.node("stranger")
    topic = "/bluerov2/cmd_thruster1"
    assert stranger.discovered(lambda: node.count_publishers(topic) == 1, LIMIT)
    ends = ends_of(stranger, node, "thruster1")
    with pytest.raises(InterfaceError, match=rf"^{topic}: "):
        discovery.check_endpoints(stranger, node, [ends], 0.1)
    lockstep = node.create_client(stranger.ros.services.SetBool, "/bluerov2/lockstep")
    stranger.renew()
    wanted = stranger.ros.services.SetBool.Request(data=True)
    refused = until(lambda: None if (a := call(stranger, lockstep, wanted)).success else a, "a refusal")
    assert refused.message.startswith(topic)
    first.close()


def test_a_server_that_another_client_moves(server, stranger):
    first = connected()
    node = stranger.node("stranger")
    client = node.create_client(stranger.ros.services.Trigger, "/bluerov2/step")
    stranger.renew()
    assert call(stranger, client, stranger.ros.services.Trigger.Request()).success
    assert first.session.until(lambda: first._stamp[0] > first._reached, LIMIT)
    with pytest.raises(TrainingError, match=r"/bluerov2/odom: is 0.1 s ahead"):
        first.step(STILL, 0.1)
    assert not first.usable
    first.close()


KILLED = """
import os, signal
from auvbench.integrations.ros2.connection import Connection
Connection("bluerov2", tuple(f"thruster{i}" for i in range(1, 7)), "lockstep", 300.0)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_client_that_was_killed_keeps_nobody_away(server):
    done = subprocess.run([sys.executable, "-c", KILLED], timeout=LIMIT, check=False)
    assert done.returncode == -signal.SIGKILL
    connection = connected()
    connection.step(STILL, 0.1)
    connection.close()


def test_the_second_server_of_a_namespace_leaves_and_the_first_stays(server):
    first = connected()
    second = dds.Process("serve")
    try:
        assert second.ends() == 2, second.output
    finally:
        second.stop()
    assert "/bluerov2/odom: another server publishes this topic" in second.output
    assert "--namespace" in second.output
    first.step(STILL, 0.1)
    assert server.process.poll() is None
    first.close()


def test_two_servers_that_both_live(domain, stranger):
    node = stranger.node("stranger")
    for _ in range(2):
        node.create_publisher(stranger.ros.nav.Odometry, "/twins/odom", stranger.qos)
    assert stranger.discovered(lambda: node.count_publishers("/twins/odom") == 2, LIMIT)
    with pytest.raises(InterfaceError, match=r"^/twins/odom: 2 "):
        discovery.check_endpoints(
            stranger, node, [discovery.Endpoints(interface.Names("twins"), {}, None, None)], 0.1
        )


@pytest.mark.parametrize(
    ("name", "value", "allowed", "found"),
    [
        ("start_pose", [0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0], "7 doubles", "length 2"),
        ("start_pose", [0, 0, 0, 1, 0, 0, 0], "7 doubles", "an integer array"),
        ("effectiveness", [1.0, 1.0], "a double in 0 .. 1 for each actuator", "has 2"),
        ("step_duration", 0.0, "0.0001 .. 60 s", "is 0.0"),
        ("pace", 1, "a double in 0 .. 1000000", "an integer"),
        ("steps", 2.0, "an integer in 1 .. 1000000", "a double"),
        ("pace", None, "a double", "a not set"),
    ],
)
def test_a_wrong_parameter_is_answered_with_type_and_range(client, name, value, allowed, found):
    with pytest.raises(InterfaceError) as caught:
        client.set({0: {name: value}})
    reason = str(caught.value).partition(f"{name}: must be ")[2]
    assert allowed in reason
    assert found in reason


def test_delayed_is_not_lost_and_halted_is_said(server):
    connection = connected()
    connection.step(STILL, 0.1)
    before = connection._stamp.copy()
    server.send(signal.SIGSTOP)
    begun = time.monotonic()
    threading.Timer(1.0, server.send, (signal.SIGCONT,)).start()
    connection.step(STILL, 0.1)
    assert time.monotonic() - begun > 0.9
    np.testing.assert_array_equal(connection._stamp - before, 100_000_000)
    connection.timeout = 0.5
    server.send(signal.SIGSTOP)
    with pytest.raises(
        TrainingError, match=r"/bluerov2/odom: silent for 0.5 s; was the server killed or halted"
    ):
        connection.step(STILL, 0.1)
    with pytest.raises(TrainingError, match=r"/bluerov2/reset: no answer within 0.5 s"):
        connection.reset([0], {})
    server.send(signal.SIGCONT)
    connection.close()


LEARNER = [
    *configs.ORIGINAL,
    "algo=ppo",
    "algo.n_envs=1",
    "algo.n_steps=64",
    "algo.batch_size=64",
    "train.total_steps=320",
    "train.checkpoint.steps=64",
    "train.progress=false",
    "simulator=ros2",
    f"simulator.timeout={LIMIT:g}",
    "task.max_steps=30",
]


def test_a_training_whose_server_is_killed_goes_on_with_the_next_one(
    elsewhere, tmp_path, capsys, monkeypatch
):
    torch.set_num_threads(1)
    command = ["train", f"output={tmp_path}", *LEARNER]
    save = CheckpointStore.save

    def save_and_kill(*arguments):
        """Kill the server at the first checkpoint; only then is the patience short."""
        saved = save(*arguments)
        server.send(signal.SIGKILL)
        ros2._connection().timeout = 1.0
        return saved

    with dds.serving("--lockstep") as server, monkeypatch.context() as patch:
        patch.setattr(CheckpointStore, "save", save_and_kill)
        assert main(command) == 1
    (path,) = (tmp_path / "default").glob("ppo-*")
    error = capsys.readouterr().err
    assert "/bluerov2/" in error
    assert "1 s" in error
    manifest = RunDirectory(path).manifest()
    assert manifest["state"] == "failed"
    assert "/bluerov2/" in manifest["error"]["message"]
    assert manifest["steps"] == 64
    with dds.serving("--lockstep"):
        assert main(command) == 0
    manifest = RunDirectory(path).manifest()
    assert (manifest["state"], manifest["steps"]) == ("complete", 320)
    assert manifest["episodes_begun_again"]
    assert "clock lockstep" in manifest["versions"]["ros2"]


def test_a_mistyped_namespace_is_corrected_by_the_next_command(elsewhere, tmp_path, capsys):
    torch.set_num_threads(1)
    command = ["train", f"output={tmp_path}", *LEARNER, "simulator.timeout=1", "train.total_steps=64"]
    assert main([*command, "simulator.namespace=blurov2"]) == 2
    path = next((tmp_path / "default").glob("*/manifest.json")).parent
    ros2.leave()
    with dds.serving("--lockstep"):
        words = ["simulator.namespace=bluerov2", f"simulator.timeout={LIMIT:g}"]
        assert main([*command, *words]) == 0
    assert RunDirectory(path).manifest()["state"] == "complete"
    capsys.readouterr()


def test_a_restarted_server_gets_a_new_connection(elsewhere):
    settings = Ros2(name="ros2", namespace=None, clock="lockstep", timeout=LIMIT)
    vehicle = load("bluerov2")
    with dds.serving("--lockstep"):
        first = ros2.connect(settings, vehicle)
        for _ in range(3):
            first.step(STILL, 0.1)
        assert ros2.connect(settings, vehicle) is first
    with dds.serving("--lockstep"):
        odometry = first.names[0].odometry
        assert first.session.discovered(lambda: first.node.count_publishers(odometry) == 1, LIMIT)
        ros2.connect(settings, vehicle).step(STILL, 0.1)


def test_no_validation_on_a_servers_vehicles(tmp_path, capsys):
    assert main(["train", f"output={tmp_path}", *LEARNER, "train.evaluate_every=64"]) == 2
    assert "train.evaluate_every=64: must be 0 with simulator=ros2" in capsys.readouterr().err


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
        timeout=LIMIT,
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
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=LIMIT)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert f"{module} (ROS 2 Jazzy) is not installed" in done.stderr
    assert "pip install 'auvbench[ros2]'" in done.stderr
