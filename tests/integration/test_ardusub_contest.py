"""ArduSub as an agent: against a stand-in that speaks the same bytes, and the real SITL where there is one."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from auvbench.cli import main
from auvbench.config import schema
from auvbench.envs.batch import Batch
from auvbench.errors import ConfigError, TrainingError
from auvbench.evaluation.rollout import Rollout, roll_out
from auvbench.integrations.ardusub import dvl, sitl
from auvbench.integrations.ardusub.agent import ArduSubAgent, Piloted
from auvbench.integrations.ardusub.radio import Radio
from auvbench.integrations.ardusub.sensors import Vector
from auvbench.integrations.ardusub.sitl import VARIABLE
from auvbench.tasks.navigation.state import DVL
from auvbench.vehicles import sheet
from tests import configs
from tests.ardusub_stand_in import installed

pytestmark = pytest.mark.slow

REAL = os.environ.get(VARIABLE, "")
TASK = (
    *("task=station_keeping", "vehicle=bluerov2_heavy", "noise=none"),
    # Lowering to 5 m takes a quarter of the time of that to 20 m.
    *("task.station=[0,0,-5]", "task.time_limit=20", "task.settling=10", "task.hold_time=5"),
)


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return installed(tmp_path_factory.mktemp("ardusub"))


@pytest.fixture(autouse=True)
def named(program: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, str(program))


def contest(*overrides: str) -> schema.TrainConfig:
    return configs.training("algo=ardusub", *TASK, *overrides)


def flown(config: schema.TrainConfig, episodes: int = 1) -> Rollout:
    agent = ArduSubAgent(config, sheet.load(config.vehicle))
    return roll_out(config, agent, episodes=np.arange(episodes), seed=7, batch=50)


def rows(rollout: Rollout) -> list[dict[str, Any]]:
    return [dict(record) for record in rollout.records]


@pytest.mark.parametrize("mode", ["guided", "poshold", "alt_hold"])
@pytest.mark.parametrize("vehicle", ["bluerov2_heavy", "bluerov2"])
def test_each_mode_flies_to_the_station(program: Path, mode: str, vehicle: str) -> None:
    (record,) = rows(flown(contest(f"algo.mode={mode}", f"vehicle={vehicle}", "algo.stick=0.3")))
    assert record["initial_distance_m"] > 1.0
    # The stand-in has no integral action: it sinks by the vehicle's own weight, and its sticks have no rate feedback.
    assert record["final_distance_m"] < 0.5 * record["initial_distance_m"]
    assert record["energy_J"] > 0.0


def test_a_moving_reference_is_followed(program: Path) -> None:
    overrides = ("task=trajectory_tracking", "task.centre=[0,0,-12]", "task.time_limit=20")
    config = configs.training("algo=ardusub", "vehicle=bluerov2_heavy", "noise=none", *overrides)
    (record,) = rows(flown(config))
    assert record["outcome"] == "success"
    assert record["position_error_rms_m"] < 1.5


def test_rows_depend_on_the_episode_alone(program: Path) -> None:
    config = contest("task.time_limit=10", "task.settling=2")
    assert rows(flown(config, 3))[2] == rows(flown(config, 3))[2]
    agent = ArduSubAgent(config, sheet.load(config.vehicle))
    alone = roll_out(config, agent, episodes=np.array([2]), seed=7, batch=1)
    assert rows(alone)[0] == rows(flown(config, 3))[2]


@pytest.mark.parametrize("quirk", ["REPEATS", "CHANNELS"])
def test_repeated_packets_and_32_channels_change_nothing(program: Path, quirk: str) -> None:
    plain = contest("task.time_limit=10", "task.settling=2")
    other = contest("task.time_limit=10", "task.settling=2", f"+algo.parameters.SIM_{quirk}=1")
    assert rows(flown(plain)) == rows(flown(other))


def test_currents_waves_and_faults_reach_the_vehicle(program: Path) -> None:
    calm = rows(flown(contest()))[0]["position_error_rms_m"]
    for disturbance in (
        ("disturbance.current.speed=0.5",),
        ("disturbance=sea_state_3", "task.station=[0,0,-5]"),
        ("disturbance.fault.mode=dead",),
        ("disturbance.randomisation.thrust.low=0.5", "disturbance.randomisation.thrust.high=0.5"),
    ):
        assert rows(flown(contest(*disturbance)))[0]["position_error_rms_m"] != calm


ON_DVL = ("world=slope", "sensors=dvl_a50", "navigation=ekf")


def test_a_dvl_takes_the_place_of_gps(program: Path) -> None:
    # The stand-in refuses the mode without recent pings, and its position is their sum.
    (record,) = rows(flown(contest(*ON_DVL, "sensors.dvl.lever=[0.2,0,-0.1]")))
    assert record["final_distance_m"] < 0.5 * record["initial_distance_m"]
    assert 0.0 < record["navigation_error_rms_m"] < 1.0
    assert 1.0 < record["clearance_min_m"] < 12.0  # from the bottom, 8 m below the station
    # What it flies by is the DVL: without lock it gets no ping.
    (lost,) = rows(flown(contest(*ON_DVL, "sensors.dvl.lost=1")))
    assert lost["final_distance_m"] > record["final_distance_m"]


def test_a_ping_has_the_sensors_velocity_in_axes_of_ardusub() -> None:
    config = contest(*ON_DVL, "sensors.dvl.merit_low=1e-5", "sensors.dvl.merit_high=1e-5")
    batch = Batch(config, n=1, seed=3)
    batch.reset()
    assert batch.navigation is not None
    forwarder, radio = dvl.Forwarder(batch.navigation), Heard()
    forwarder.begin()
    for _ in range(20):
        batch.step(np.full((1, 8), 0.4))
        forwarder.forward(radio)
        forwarder.forward(radio)  # a ping is sent once
    d = batch.navigation.state[0]
    elapsed, (ahead, starboard, down), _, confidence = radio.heard[-1]
    assert (ahead, -starboard, -down) == pytest.approx(tuple(d.dvl_velocity))
    assert abs(down) > 1e-3
    assert confidence == pytest.approx(100.0, abs=0.01)
    assert len(radio.heard) <= 20
    assert sum(entry[0] for entry in radio.heard) == pytest.approx(float(d.stamp[DVL]))
    assert elapsed > 0.0


class Heard(Radio):
    """A radio that keeps what it is to send."""

    def __init__(self) -> None:
        self.heard: list[tuple[float, Vector, Vector, float]] = []

    def moved(self, elapsed: float, velocity: Vector, rates: Vector, confidence: float) -> None:
        self.heard.append((elapsed, velocity, rates, confidence))


@pytest.mark.parametrize(
    ("overrides", "key"),
    [
        (("sensors=bluerov2", "navigation=ekf"), "algo.mode=guided"),
        (("world=slope", "sensors=dvl_usbl", "navigation=ekf"), "sensors.usbl"),
        (("noise=thesis",), "noise=thesis"),
        (("disturbance=delay",), "disturbance.delay"),
        (("disturbance=sensor",), "disturbance.sensor"),
        (("disturbance.fault.mode=stuck",), "disturbance.fault.mode=stuck"),
        (("simulator=gazebo",), "simulator=gazebo"),
        (("vehicle=lrauv",), "vehicle=lrauv"),
        (("vehicle=rexrov",), "vehicle=rexrov"),
        (("algo.sha256=0123",), "algo.sha256="),
    ],
)
def test_what_cannot_be_is_refused(program: Path, overrides: tuple[str, ...], key: str) -> None:
    with pytest.raises(ConfigError, match=key):
        flown(contest(*overrides))


@pytest.mark.parametrize("name", ["", "/nowhere/ardusub"])
def test_a_program_that_is_not_there_is_named(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, name)
    with pytest.raises(ConfigError, match=VARIABLE):
        flown(contest())


@pytest.mark.parametrize(
    ("quirk", "said"),
    [
        ("NEVER_ARMS", "the stand-in was told not to arm"),
        ("NO_MODE", "take mode 4"),
        ("ENDS", "exit code 3; it said: PANIC: the stand-in was told to end"),
        ("COPTER", "is not ArduSub"),
        ("DISARMS", "disarmed in the episode"),
    ],
)
def test_an_ardusub_that_fails_is_named(
    program: Path, monkeypatch: pytest.MonkeyPatch, quirk: str, said: str
) -> None:
    monkeypatch.setattr(sitl, "SETTLING", 3.0)
    with pytest.raises(TrainingError, match=said):
        flown(contest(f"+algo.parameters.SIM_{quirk}=4"))


def test_a_parameter_that_ardusub_does_not_have_is_named(
    program: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sitl, "SETTLING", 3.0)
    with pytest.raises(TrainingError, match=r"did not confirm algo.parameters.NO_SUCH=2"):
        flown(contest("+algo.parameters.NO_SUCH=2"))


def test_a_program_that_is_no_ardusub_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sitl, "PATIENCE", 1.0)
    monkeypatch.setenv(VARIABLE, "/bin/false")
    with pytest.raises(TrainingError, match="ended with exit code 1"):
        flown(contest())
    monkeypatch.setenv(VARIABLE, "/etc/passwd")
    with pytest.raises(TrainingError, match="cannot be started"):
        flown(contest())


def test_the_commands_compare_it_with_others_and_name_its_version(
    program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = (
        "task=station_keeping",
        "vehicle=bluerov2_heavy",
        "noise=none",
        "task.time_limit=5",
        "task.settling=1",
    )
    words = (*words, "task.hold_time=2", "name=a")
    assert main(["train", "algo=pid", *words]) == 0
    assert main(["train", "algo=ardusub", *words]) == 0
    assert main(["evaluate", "outputs/a", "protocol=own", "protocol.episodes=3", "--workers", "2"]) == 0
    assert main(["report", "outputs/a", "--protocol", "own", "--format", "csv"]) == 0
    with open("outputs/a/report/table.csv", newline="") as file:
        # Both met the same test: one table, one comparison.
        assert {row["agent"] for row in csv.DictReader(file)} == {"PID", "ArduSub"}
    (run,) = Path("outputs/a").glob("ardusub*")
    assert json.loads((run / "manifest.json").read_text())["versions"]["ardusub"] == "4.7.0 (standin!)"
    program.write_text(program.read_text() + "\n# another program\n")
    assert main(["evaluate", "outputs/a", "protocol=own", "protocol.episodes=2"]) == 1


def test_a_process_ends_with_its_episode(program: Path) -> None:
    config = contest()
    vehicle = sheet.load(config.vehicle)
    agent = ArduSubAgent(config, vehicle)
    piloted = agent.simulator(config, vehicle, None)
    assert isinstance(piloted, Piloted)
    piloted.reset(np.arange(1), np.array([[1.0, 2.0, -5.0, 1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 6)))
    process = piloted.running._process
    assert process.poll() is None
    agent.ended(np.arange(1))
    assert process.poll() is not None


@pytest.mark.ardusub
@pytest.mark.skipif(not REAL, reason="AUVBENCH_ARDUSUB names no program of ArduSub's SITL")
@pytest.mark.parametrize("mode", ["guided", "poshold"])
def test_the_real_ardusub_holds_a_station(mode: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, REAL)
    config = contest(f"algo.mode={mode}", "task.time_limit=40", "task.hold_time=10")
    first = rows(flown(config))
    assert first[0]["outcome"] == "success"
    # The dead zone of the sticks is a quarter of their way.
    assert first[0]["position_error_rms_m"] < {"guided": 0.15, "poshold": 0.35}[mode]
    assert first == rows(flown(config))
