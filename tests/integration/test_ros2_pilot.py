"""A pilot over real DDS: it steers when all is well, and zero thrust is its answer to everything else."""

import contextlib
import os
import signal
import time

import numpy as np
import pytest

from auvbench.cli import main
from auvbench.errors import RunError
from auvbench.integrations.commands import pilot as command
from auvbench.integrations.ros2 import discovery, interface
from auvbench.integrations.ros2.middleware import Session
from auvbench.integrations.ros2.pilot import Pilot
from auvbench.pilot.guard import Unsupervised
from auvbench.pilot.live_observation import observe
from auvbench.pilot.mission import Logbook
from auvbench.pilot.steering import Limits, Steering
from auvbench.tasks.observation_spec import observation_spec
from auvbench.vehicles.sheet import load
from tests import configs, dds
from tests.waiting import LIMIT

pytestmark = [dds.needs_ros, pytest.mark.slow]

SPEC = observation_spec(configs.training("algo=pid").task, load("bluerov2").actuators)
LIMITS = Limits(
    depth_low=-60.0,
    depth_high=-1.0,
    goal_radius=2.0,
    max_steps=1000,
    pose_timeout=0.3,
    lost_after=0.9,
    patience=LIMIT,
)
PUSH = 20.0  # N, of an action of one half
PATIENCE = 20.0  # s until a question is asked again


class Half:
    """Half thrust, whatever is seen; or what a test wants instead."""

    answer = np.full((1, 6), 0.5)
    error = None

    def reset(self, episodes):
        pass

    def act(self, observation):
        assert observation.shape == (1, 10)
        if self.error is not None:
            raise self.error
        return self.answer


class Clock:
    """Time of a pilot in this process: it goes on by steps, however busy the machine is."""

    def __init__(self):
        self.now = 0.0

    def monotonic(self):
        return self.now


class Tank:
    """A vehicle that lies still, a goal, and a listener to the commands.

    With a pilot in this process, `work` lets it go on by 20 ms of its own time, and a pose that is told arrives before
    more time passes.
    """

    def __init__(self, clock=None):
        self.clock = clock or Clock()
        self.session = session = Session()
        ros = session.ros
        node = self.node = session.node("tank")
        self.position = [0.0, 0.0, -10.0]
        self.tells, self.advances = True, True
        self.stamp = 0
        self.commands: dict[int, float] = {}
        self.history = [[] for _ in range(6)]
        self.states: list[str] = []
        for a in range(6):
            topic = f"/bluerov2/cmd_thruster{a + 1}"
            node.create_subscription(
                ros.std.Float64, topic, lambda m, a=a: self._heard(a, m.data), session.qos
            )
        node.create_subscription(
            ros.std.String, "/bluerov2/pilot/state", lambda m: self.states.append(m.data), session.qos
        )
        self._odometry = node.create_publisher(ros.nav.Odometry, "/bluerov2/odom", session.qos)
        self.goals = node.create_publisher(ros.geometry.PoseStamped, "/goal_pose", session.qos)
        self.arming = node.create_client(ros.services.SetBool, "/bluerov2/pilot/arm")
        self.stopping = node.create_client(ros.services.Trigger, "/bluerov2/pilot/stop")
        session.renew()
        self._told = 0.0
        self.pilot = None

    def _heard(self, actuator, value):
        self.commands[actuator] = value
        self.history[actuator].append(value)

    def work(self):
        self.clock.now += 0.02
        if self.tells and self.clock.now - self._told > 0.03:
            self._told = self.clock.now
            self.stamp += self.advances
            message = interface.odometry(self.session.ros, "bluerov2")
            interface.write_time(message.header.stamp, self.stamp * 1_000_000)
            interface.write_pose(message.pose.pose, [*self.position, 1.0, 0.0, 0.0, 0.0])
            heard = self._odometry.get_subscription_count() > 0 and np.all(np.isfinite(self.position))
            self._odometry.publish(message)
            if self.pilot is not None and heard:
                end = time.monotonic() + LIMIT
                while self.pilot._stamp != self.stamp * 1_000_000:
                    assert time.monotonic() < end, "the pose did not arrive"
                    self.pilot.spin_once()
        self.session.spin_once(0.0 if self.pilot is not None else 0.01)
        if self.pilot is not None:
            self.pilot.spin_once()

    def move(self, axis, value):
        """Put the vehicle elsewhere, ten seconds later by its own clock: no vehicle jumps."""
        self.position[axis] = value
        self.stamp += 10_000

    def until(self, condition):
        end = time.monotonic() + LIMIT
        while not condition():
            assert time.monotonic() < end, (self.commands, self.states)
            self.work()

    def wait(self, seconds):
        """Let the pilot's time go on by `seconds`."""
        end = self.clock.now + seconds
        while self.clock.now < end:
            self.work()

    def meet(self):
        """Wait until each end here has its other end in the pilot, and each end in the pilot its other end here."""
        here = [*self.node.subscriptions, self.goals, self.arming, self.stopping]
        theirs = [] if self.pilot is None else [self.pilot._state, *self.pilot.node.subscriptions]
        self.until(lambda: dds.matched(*here, *theirs))
        if self.pilot is not None:
            assert self.pilot.guard.wait_until_ready(LIMIT)

    def ask(self, client, request):
        """Return a service's answer; ask again where it is lost: a service waits 0.1 s to discover its client."""
        self.until(client.service_is_ready)
        asked = []
        for _ in range(int(LIMIT / PATIENCE)):
            asked.append(self.session.ask(client, request))
            end = time.monotonic() + PATIENCE
            while time.monotonic() < end:
                self.work()
                for answer in asked:
                    if answer.value is not None:
                        return answer.value
        pytest.fail(f"{client.srv_name} does not answer")

    def arm(self, data=True):
        return self.ask(self.arming, self.session.ros.services.SetBool.Request(data=data))

    def goal(self, x, y, z, frame="world"):
        message = self.session.ros.geometry.PoseStamped()
        message.header.frame_id = frame
        message.pose.position.x, message.pose.position.y, message.pose.position.z = x, y, z
        self.goals.publish(message)

    def pushes(self):
        return len(self.commands) == 6 and set(self.commands.values()) == {PUSH}

    def rests(self):
        return len(self.commands) == 6 and set(self.commands.values()) == {0.0}

    def said(self, text):
        return any(text in state for state in self.states)


@pytest.fixture(scope="module")
def domain():
    with dds.domain() as number:
        yield number


@pytest.fixture
def clock(monkeypatch):
    made = Clock()
    monkeypatch.setattr("auvbench.pilot.loop.time", made)
    return made


@pytest.fixture
def tank(domain, clock, tmp_path):
    tank = Tank(clock)
    tank.controller = Half()
    log = Logbook(tmp_path / "log", {"frequency_hz": 20.0})
    tank.pilot = Pilot(
        "bluerov2", Steering(tank.controller, load("bluerov2"), 20.0, SPEC, LIMITS, logbook=log)
    )
    tank.meet()
    tank.until(lambda: tank.pilot.age < 0.1)
    yield tank
    tank.pilot.close("the test is over")
    tank.session.close()


@pytest.fixture
def steering(tank):
    tank.goal(20.0, 0.0, -10.0)
    tank.until(lambda: tank.pilot.steering.waypoint is not None)
    tank.until(lambda: tank.arm().success)
    tank.until(tank.pushes)
    return tank


@pytest.fixture
def sent(tank, monkeypatch):
    """The commands that the pilot sends, before DDS delivers them."""
    made, send = [], tank.pilot._command
    monkeypatch.setattr(
        tank.pilot, "_command", lambda quantities: (made.append(quantities), send(quantities))
    )
    return made


def test_it_starts_disarmed_and_commands_nothing(tank, sent):
    tank.goal(20.0, 0.0, -10.0)
    tank.until(lambda: tank.pilot.steering.waypoint is not None)
    tank.wait(0.4)
    assert not sent
    tank.until(lambda: tank.arm().success)
    tank.until(tank.pushes)
    assert tank.arm(False).success
    tank.until(tank.rests)
    before = len(sent)
    tank.wait(0.4)
    assert len(sent) == before


def test_armed_without_a_waypoint_is_zero_thrust(tank):
    tank.until(lambda: tank.arm().success)
    tank.until(tank.rests)


def test_what_it_does_not_arm_with(tank):
    tank.move(2, -0.5)
    tank.until(lambda: tank.pilot.pose[2] == -0.5)
    answer = tank.arm()
    assert not answer.success
    assert "z = -0.50 m is not within -60 .. -1 m" in answer.message
    tank.tells = False
    tank.wait(0.4)
    assert "/bluerov2/odom is" in tank.arm().message
    tank.tells = True
    tank.move(2, -10.0)
    tank.until(lambda: tank.pilot.age < 0.1)
    company = tank.node.create_publisher(tank.session.ros.std.Float64, "/bluerov2/cmd_thruster3", 10)
    tank.until(lambda: tank.pilot.node.count_publishers("/bluerov2/cmd_thruster3") == 2)
    assert "cmd_thruster3: another client commands" in tank.arm().message
    tank.node.destroy_publisher(company)


def test_a_pose_too_old_is_zero_thrust_and_in_the_end_disarmed(steering, sent):
    tank = steering
    tank.tells = False
    tank.until(lambda: tank.pilot.state.startswith("holding"))
    assert tank.pilot.armed
    np.testing.assert_array_equal(sent[-1], tank.pilot.physical.neutral)
    tank.tells = True
    tank.until(lambda: np.any(sent[-1] != 0.0))
    tank.tells = False
    tank.until(lambda: not tank.pilot.armed)
    tank.until(tank.rests)
    tank.tells = True
    before = len(sent)
    tank.wait(0.3)
    assert len(sent) == before
    tank.until(lambda: tank.said("disarmed: /bluerov2/odom is"))


def test_the_same_pose_again_and_again_gets_no_younger(steering):
    steering.advances = False
    steering.until(steering.rests)
    steering.until(lambda: steering.said("holding: /bluerov2/odom is"))


def test_a_clock_that_goes_back_disarms_is_said_once_and_is_accepted(steering):
    tank = steering
    tank.stamp = 32_000  # ms
    tank.until(lambda: tank.pilot._stamp >= 32_000_000_000)
    tank.stamp = 0  # the server was restarted
    tank.until(lambda: not tank.pilot.armed)
    tank.until(tank.rests)
    tank.until(lambda: tank.pilot._stamp < 1_000_000_000 and tank.pilot.age < 0.1)
    tank.until(lambda: tank.said("the clock went back"))
    tank.goal(20.0, 0.0, -10.0)
    tank.until(lambda: tank.arm().success)
    tank.until(tank.pushes)
    assert sum("the clock went back" in state for state in tank.states) == 1


@pytest.mark.parametrize("z", [-0.9, -60.5, float("nan")])
def test_depth_limits(steering, z):
    steering.move(2, z)
    steering.until(lambda: not steering.pilot.armed)
    steering.until(steering.rests)
    if z == z:
        steering.until(lambda: steering.said("is not within -60 .. -1 m"))
        record = steering.pilot.steering.logbook._rows[0]
        assert record["outcome"] == "collision"


def test_the_stop_service(steering):
    answer = steering.ask(steering.stopping, steering.session.ros.services.Trigger.Request())
    assert answer.success
    steering.until(steering.rests)
    assert not steering.pilot.armed
    assert steering.pilot.steering.waypoint is None
    steering.until(lambda: steering.said("disarmed: by the service stop"))


@pytest.mark.parametrize(
    ("answer", "error", "message"),
    [
        (None, ZeroDivisionError("division by zero"), "division by zero"),
        (np.full((1, 6), np.nan), None, "not finite"),
        (np.zeros((1, 5)), None, r"shape \(1, 5\)"),
    ],
)
def test_a_controller_that_fails(steering, answer, error, message):
    steering.controller.answer, steering.controller.error = answer, error
    with pytest.raises(RunError, match=message):
        steering.wait(3.0)
    assert not steering.pilot.armed
    steering.pilot, pilot = None, steering.pilot
    steering.until(steering.rests)
    steering.pilot = pilot


def test_waypoints_that_are_none(tank):
    tank.goal(1.0, 2.0, 0.0)
    tank.until(lambda: tank.said("ignored: z = 0 m, must be within -60 .. -1 m"))
    tank.goal(1.0, 2.0, -5.0, frame="map")
    tank.until(lambda: tank.said("ignored: the frame is 'map', must be 'world'"))
    assert tank.pilot.steering.waypoint is None


def test_a_waypoint_that_is_reached(steering):
    steering.move(0, 18.5)
    steering.until(lambda: steering.said("waypoint reached"))
    steering.until(steering.rests)
    assert steering.pilot.armed
    (record,) = steering.pilot.steering.logbook._rows
    assert record["outcome"] == "success"
    assert record["path_length_m"] == pytest.approx(18.5)


def test_an_unfinished_mission_is_kept(steering):
    steering.until(lambda: steering.pilot.steering.mission.steps > 0)
    steering.pilot.close("the pilot was ended")
    steering.pilot, pilot = None, steering.pilot
    steering.until(steering.rests)
    assert pilot.steering.logbook._rows[0]["outcome"] == "aborted"
    assert pilot.steering.logbook._reasons == ["the pilot was ended"]
    steering.pilot = pilot


def test_a_policy_from_a_file_commands_what_it_answers(domain, clock, tmp_path):
    learner = ["algo.n_envs=2", "algo.n_steps=32", "algo.batch_size=64", "train.total_steps=64"]
    assert (
        main(["train", *configs.ORIGINAL, "algo=ppo", f"output={tmp_path}", "train.progress=false", *learner])
        == 0
    )
    assert main(["export", str(tmp_path / "default"), "--out", str(tmp_path / "exports")]) == 0
    (file,) = (tmp_path / "exports").glob("*.onnx")
    setup = command._setup(command.parser().read([str(file)]))
    tank = Tank(clock)
    tank.pilot = Pilot("bluerov2", setup)
    tank.meet()
    tank.goal(5.0, -4.0, -12.0)
    tank.until(lambda: tank.pilot.steering.waypoint is not None)
    tank.until(lambda: tank.arm().success)
    tank.until(lambda: min(map(len, tank.history)) >= 4)
    pose, previous = np.array([0.0, 0.0, -10.0, 1.0, 0.0, 0.0, 0.0]), np.zeros(6)
    for step in range(4):
        seen = observe(
            setup.spec,
            pose,
            np.zeros(6),
            np.array([5.0, -4.0, -12.0]),
            previous,
            yaw=None,
            depth=(-60.0, -1.0),
        )
        previous = np.asarray(setup.controller.act(seen[None])[0], dtype=np.float64)
        assert [values[step] for values in tank.history] == tank.pilot.physical.of_action(previous).tolist()
    tank.pilot.close("the test is over")
    tank.session.close()


def test_without_its_supervisor_a_pilot_commands_zero_thrust_and_ends(steering):
    pilot = steering.pilot
    os.kill(pilot.guard._process.pid, signal.SIGKILL)
    with pytest.raises(Unsupervised, match="a pilot does not steer without a supervisor"):
        steering.until(lambda: False)
    with contextlib.suppress(Unsupervised):
        pilot.close("the pilot was ended")
    steering.pilot = None
    steering.until(steering.rests)
    steering.pilot = pilot


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_pilot_that_dies_or_halts_ends_with_zero_thrust(number):
    with dds.domain():
        tank = Tank()
        pilot = dds.Process("pilot", "pid", "--goal", "20", "5", "-12", "--pose-timeout", "5")
        try:
            pilot.says("arm it")
            tank.meet()
            tank.until(lambda: tank.arm().success)
            tank.until(lambda: len(tank.commands) == 6 and any(tank.commands.values()))
            pilot.send(number)
            tank.until(tank.rests)
            pilot.says("zero thrust was sent")
        finally:
            pilot.process.kill()
            pilot.ends()
            tank.session.close()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_mission_from_command_to_replay(number, tmp_path, capsys):
    with dds.domain(), dds.serving("--pace", "6", "step.frequency=20"):
        tank = Tank()  # whose own pose is not told: the server has the vehicle
        tank.tells = False
        tank.node.destroy_publisher(tank._odometry)
        folder = tmp_path / "missions"
        words = ["--sim-time", "--goal", "6", "0", "-20", "--record", str(folder), "--pose-timeout", "60"]
        pilot = dds.Process("pilot", "pid", *words)
        try:
            pilot.says("arm it")
            tank.meet()
            tank.until(lambda: tank.arm().success)
            pilot.says("waypoint reached")
            tank.goal(-15.0, 0.0, -30.0)
            pilot.says("steering to (-15.0, 0.0, -30.0)")
            before = len(tank.history[0])
            # Beyond what queues may hold of the first mission: the second has steps.
            tank.until(lambda: len(tank.history[0]) > before + 5 * interface.DEPTH)
            pilot.send(number)
            assert pilot.ends() == 0, pilot.output
            tank.until(tank.rests)
        finally:
            pilot.stop()
            tank.session.close()
    assert main(["replay", str(folder)]) == 0
    assert "success after" in capsys.readouterr().out
    assert (folder / "replays" / "mission-0.png").stat().st_size > 10_000
    assert main(["replay", str(folder), "--episode", "1"]) == 0
    assert "aborted after" in capsys.readouterr().out
    assert main(["replay", str(folder), "--episode", "2"]) == 2
    assert "has missions 0 to 1" in capsys.readouterr().err


def test_a_namespace_without_a_vehicle_is_reported_with_those_there_are():
    said = []
    with dds.domain(), dds.serving("--namespace", "beta"):
        started = dds.Process("pilot", "pid", "--namespace", "alpha")
        steering = Steering(Half(), load("bluerov2"), 20.0, SPEC, LIMITS)
        pilot = Pilot("alpha", steering, say=said.append)
        try:
            started.says("/alpha/odom: no publisher")
            assert pilot.session.discovered(lambda: discovery.list_namespaces(pilot.node) == ["beta"], LIMIT)
            assert not pilot.wait_for_odometry(0.0)
            assert said[-1].startswith("/alpha/odom: no publisher")
            assert said[-1].endswith("valid: beta")
        finally:
            pilot.close("the test is over")
            started.stop()
