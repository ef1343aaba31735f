"""A failed episode counts as its bound in every error, and no task is accepted whose measure has no step."""

from __future__ import annotations

import dataclasses
import math

import gymnasium
import numpy as np
import pytest

from auvbench.agents.base import make
from auvbench.analysis import grouping
from auvbench.envs.batch import Batch
from auvbench.errors import ConfigError
from auvbench.evaluation.protocol import resolve_conditions
from auvbench.evaluation.rollout import roll_out
from auvbench.record import OUTCOMES, record_columns
from auvbench.registry import TASKS
from auvbench.tasks import rows
from auvbench.vehicles import sheet
from tests import configs
from tests.unit.tasks.test_tasks import HEAVY, advance, batch_of, put

LOST = {
    "station_keeping": {"position_error_rms_m": 10.0, "yaw_error_rms_rad": math.pi, "settling_time_s": 60.0},
    "trajectory_tracking": {"position_error_rms_m": 5.0, "yaw_error_rms_rad": math.pi, "lag_s": 60.0},
    "path_following": {"cross_track_rms_m": 10.0, "yaw_error_rms_rad": math.pi, "speed_error_m_per_s": 0.8},
    "docking": {"final_position_error_m": 25.0, "yaw_error_rms_rad": math.pi, "final_yaw_error_rad": math.pi},
    "tracking": {"position_error_rms_m": 8.0, "yaw_error_rms_rad": math.pi, "target_error_rms_m": 8.0},
    "rendezvous": {"final_gap_m": 25.0, "yaw_error_rms_rad": math.pi, "final_course_error_rad": math.pi},
}


@pytest.mark.parametrize("task", LOST)
@pytest.mark.parametrize("place", [(0.0, 0.0, -0.5), (400.0, 0.0, -20.0)], ids=["collision", "out of bounds"])
def test_an_episode_lost_in_its_first_step_counts_as_the_bounds(
    task: str, place: tuple[float, float, float]
) -> None:
    batch = batch_of(task)
    put(batch, place, yaw=float(batch.task.episodes[0].reference_yaw))
    assert advance(batch)[1] in (rows.COLLISION, rows.OUT_OF_BOUNDS)
    record = batch.task.records(np.array([0]))[0]
    assert {name: record[name] for name in LOST[task]} == LOST[task]


def test_a_path_that_times_out_counts_as_the_bounds_of_yaw_too() -> None:
    batch = batch_of("path_following", "task.time_limit=null", "task.max_steps=1")
    put(batch, batch.task.reference[0], yaw=float(batch.task.episodes[0].reference_yaw))
    assert advance(batch)[1] == rows.TIMEOUT
    record = batch.task.records(np.array([0]))[0]
    assert (record["cross_track_rms_m"], record["yaw_error_rms_rad"]) == (10.0, math.pi)


@pytest.mark.slow
def test_random_commands_are_not_ahead_of_pid_in_yaw() -> None:
    means = []
    for algo in ("random", "pid"):
        config = configs.training("task=station_keeping", f"algo={algo}", HEAVY)
        records = roll_out(
            config, make(config, sheet.load(config.vehicle)), episodes=np.arange(10), seed=123, batch=10
        ).records
        means.append(np.mean([record["yaw_error_rms_rad"] for record in records]))
    assert means[0] > means[1]


def test_rows_of_earlier_versions_count_as_bounds_in_tables() -> None:
    outcome = np.array(
        [[OUTCOMES.index(name) for name in ("success", "collision", "out_of_bounds", "timeout")]]
    )
    measured = {
        "yaw_error_rms_rad": np.array([[0.1, 0.0, 0.0, 0.2]]),
        "settling_time_s": np.array([[4.0, 3.0, 2.0, 60.0]]),
        "frequency_hz": np.array([[10.0, 10.0, 10.0, 10.0]]),
        "energy_J": np.array([[1.0, 1.0, 1.0, 1.0]]),
    }
    grouping._count_failures("station_keeping", outcome, measured, 600.0)
    assert measured["yaw_error_rms_rad"].tolist() == [[0.1, math.pi, math.pi, 0.2]]
    assert measured["settling_time_s"].tolist() == [[4.0, 60.0, 60.0, 60.0]]
    assert measured["energy_J"].tolist() == [[1.0] * 4]
    measured = {"yaw_error_rms_rad": np.array([[0.1, 0.0, 0.0, 0.2]])}
    grouping._count_failures("path_following", outcome, measured, 600.0)
    assert measured["yaw_error_rms_rad"].tolist() == [[0.1, math.pi, math.pi, math.pi]]


def test_every_error_of_a_task_says_what_a_failure_counts_as() -> None:
    for task, counted in LOST.items():
        names = record_columns(task)
        errors = {name for name in names if "error" in name or name in ("lag_s", "settling_time_s")}
        assert errors <= counted.keys(), task
        assert {"collision", "out_of_bounds"} <= set(TASKS[task].failures)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (("task.settling=60",), r"task.settling=60: must be less than the 60 s of an episode \(task.time_limit at 10 Hz\)"),
        (("task.settling=59.96",), "task.settling=59.96"),
        (
            ("task.time_limit=null", "task.max_steps=90"),
            r"task.settling=10: must be less than the 9 s of an episode \(task.max_steps=90 at 10 Hz\)",
        ),
        (("task.time_limit=20",), "task.hold_time=30: must be at most the 20 s"),
        (("task.hold_time=0.01",), "task.hold_time=0.01: must be at least a step, 0.1 s"),
        (("task.time_limit=null", "step.frequency=100"), "task.settling=10: must be less than the 6 s"),
    ],
)  # fmt: skip
def test_a_station_without_a_step_that_counts_is_refused(overrides: tuple[str, ...], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        configs.training("task=station_keeping", HEAVY, *overrides)


def test_the_last_step_is_enough() -> None:
    batch = batch_of("station_keeping", "task.settling=59.9")
    for _ in range(600):
        put(batch, [0.2, 0.0, -20.0])
        advance(batch)
    assert batch.task.records(np.array([0]))[0]["position_error_rms_m"] == pytest.approx(0.2)


def test_the_length_is_checked_in_gymnasium_and_at_the_frequency_of_a_protocol() -> None:
    with pytest.raises(
        ConfigError, match=r"max_episode_steps=90: task.settling=10: must be less than the 9 s"
    ):
        gymnasium.make_vec(
            "auvbench/StationKeeping-v0", num_envs=2, vehicle="bluerov2_heavy", max_episode_steps=90
        )
    gymnasium.make_vec(
        "auvbench/StationKeeping-v0", num_envs=2, vehicle="bluerov2_heavy", max_episode_steps=400
    )
    run = configs.plain("task=station_keeping", HEAVY)
    fast = dataclasses.replace(
        configs.protocol("protocol=test"), overrides=["task=same", "task.time_limit=null"], frequency=100.0
    )
    with pytest.raises(ConfigError, match=r"condition nominal: task.settling=10: must be less than the 6 s"):
        resolve_conditions(fast, run)


@pytest.mark.parametrize(
    ("overrides", "length"),
    [(("task.curve=helix", "task.time_limit=200"), 31.4), (("task.curve=any", "task.centre=[0,0,-5]"), 9.41)],
)
def test_a_curve_that_leaves_the_water_is_refused(overrides: tuple[str, ...], length: float) -> None:
    with pytest.raises(
        ConfigError, match=f"task.centre=.*must have a z of at least .*rises by up to {length} m"
    ):
        configs.training("task=trajectory_tracking", HEAVY, *overrides)


def test_accepted_curves_stay_in_the_water() -> None:
    seconds = 90.0
    for curve in ("helix", "random"):
        rise = 0.8 * seconds * 0.2 / math.hypot(1.0, 0.2) if curve == "helix" else 0.3 * 6.0
        top = -1.0 - rise - 1e-6
        batch = Batch(
            configs.training(
                *("task=trajectory_tracking", HEAVY, f"task.curve={curve}", f"task.centre=[0,0,{top}]"),
                f"task.time_limit={seconds}",
            ),
            200,
            seed=1,
        )
        batch.reset()
        idle, highest = np.zeros((200, 8)), -math.inf
        for _ in range(900):
            batch.task.advance(batch.simulator.pose, batch.simulator.velocity, idle, idle, np.zeros(200))
            highest = max(highest, float(batch.task.reference[:, 2].max()))
        assert -1.0 - rise < highest <= -1.0
