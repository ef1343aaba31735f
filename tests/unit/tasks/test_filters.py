"""The filter of commands `cbf`: its programme, its model, and what it keeps vehicles from (docs/safety.md)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from omegaconf import OmegaConf
from scipy.optimize import lsq_linear

from auvbench.agents.base import make
from auvbench.cli import main
from auvbench.config.compose import compose, typed
from auvbench.dynamics.frames import rotation
from auvbench.envs.batch import Batch
from auvbench.envs.gym_env import AuvEnv
from auvbench.envs.settings import configuration
from auvbench.errors import ConfigError
from auvbench.evaluation.rollout import roll_out
from auvbench.integrations.ardusub import agent as ardusub
from auvbench.metrics import METRICS
from auvbench.record import record_columns
from auvbench.runs import identity
from auvbench.simulators.fossen import FossenSimulator
from auvbench.tasks import filters
from auvbench.tasks.filters.echoes import SCANS, Echoes
from auvbench.tasks.filters.quadratic import PENALTY, nearest
from auvbench.tasks.filters.rows import command_of, force_of, largest_speed, still_acceleration
from auvbench.tasks.observation_spec import observation_spec
from auvbench.vehicles import sheet
from auvbench.vehicles.vehicle_model import VehicleModel
from auvbench.worlds.solids import sphere

Floats = NDArray[np.float64]
VEHICLE = "vehicle=bluerov2_2026"
BLIND = "task.observation=[position_error,yaw_error,velocity,angular_velocity,gravity,previous_action]"
"""without a sonar: the agent meets what is in its way"""
OWN = {metric.name for metric in METRICS if metric.filtered}


def batch(*words: str, n: int = 4, **own: Any) -> Batch:
    chosen = ["task=transit", VEHICLE, "algo=pid", BLIND, "filter=cbf", *words]
    return Batch(configuration(overrides=chosen), n, **own)


# --- The programme ---------------------------------------------------------------------------------------------------------------------


def test_the_programme_has_the_solution_of_scipy() -> None:
    rng = np.random.default_rng(0)
    slacks = []
    for trial in range(200):
        n, m = int(rng.integers(3, 9)), int(rng.integers(1, 8))
        A, b = 3.0 * rng.normal(size=(m, n)), (3.0 if trial % 2 else 15.0) * rng.normal(size=m)
        if trial % 3 == 0:
            A[-1] = 1.0001 * A[0]  # nearly parallel rows
        B = rng.normal(size=(3, n))
        H = np.eye(n) + 3.0 / n * B.T @ B
        limits = rng.uniform(0.5, 1.0, (n, 2)) * [-1.0, 1.0]
        wanted, x = rng.uniform(*limits.T), np.empty(n)
        slack = nearest(A, b, m, np.linalg.inv(H), *limits.T.copy(), wanted, x)
        # The same as bounded least squares: |L (x - wanted)|^2 + PENALTY |A x - b - w|^2 with w >= 0.
        L, weight = np.linalg.cholesky(H).T, math.sqrt(PENALTY)
        matrix = np.block([[L, np.zeros((n, m))], [weight * A, -weight * np.eye(m)]])
        goal = np.concatenate([L @ wanted, weight * b])
        bounds = np.r_[limits[:, 0], np.zeros(m)], np.r_[limits[:, 1], np.full(m, np.inf)]
        found = lsq_linear(matrix, goal, bounds, method="bvls", tol=1e-14, max_iter=5000).x[:n]
        np.testing.assert_allclose(x, found, atol=1e-6)
        assert slack == pytest.approx(max(0.0, float((b - A @ x).max())), abs=1e-6)
        slacks.append(slack)
    assert 20 < np.sum(np.array(slacks) > 1e-3) < 180  # of both kinds


def test_commands_and_forces_are_each_others_inverse() -> None:
    own = batch("world=tank", "world.length=90", "world.width=90", n=1).task.filter
    vehicle = sheet.load(configuration(overrides=[VEHICLE, "algo=pid"]).vehicle)
    commands = np.linspace(-1.0, 1.0, 57)
    for j, unit in enumerate(vehicle.units):
        curve, most = [values[j] for values in own.curves], np.abs(vehicle.force_limits[j]).max()
        shares = [force_of(*curve, c) for c in commands]
        np.testing.assert_allclose(np.array(shares) * most, unit.force(commands), atol=1e-9)
        back = unit.force(np.array([command_of(*curve, share) for share in shares]))
        np.testing.assert_allclose(back, unit.force(commands), atol=1e-9)


# --- The barrier -----------------------------------------------------------------------------------------------------------------------


def test_from_the_largest_speed_a_vehicle_stops_in_the_distance() -> None:
    for brake, horizon in ((1.0, 0.1), (0.3, 0.8)):
        for d in (0.001, 0.3, 7.0):
            speed, slope = largest_speed(d, brake, horizon)
            assert speed * horizon + speed * speed / (2.0 * brake) == pytest.approx(d)
            ahead, behind = (largest_speed(d + h, brake, horizon)[0] for h in (1e-5, -1e-5))
            assert slope == pytest.approx((ahead - behind) / 2e-5, rel=1e-4)
        assert largest_speed(0.0, brake, horizon)[0] == 0.0
        assert largest_speed(-0.2, brake, horizon)[0] == pytest.approx(-0.2 / horizon)


@pytest.mark.parametrize("name", ["bluerov2_2026", "bluerov2_heavy", "rexrov"])
def test_the_model_accelerates_as_the_simulator(name: str) -> None:
    config = configuration(overrides=["task=waypoint_state", f"vehicle={name}", "algo=pid", "filter=cbf"])
    vehicle, own = sheet.load(config.vehicle), Batch(config, 1).task.filter
    plain = without_lag(vehicle)
    rng = np.random.default_rng(1)
    for _ in range(5):
        q = rng.normal(size=4)
        q /= np.linalg.norm(q)
        nu, command = rng.uniform(-1.0, 1.0, 6), rng.uniform(-1.0, 1.0, len(vehicle.units))
        simulator = FossenSimulator(plain, 1, max_step=1e-5)
        simulator.reset(np.array([0]), np.concatenate([np.zeros(3), q])[None], nu[None])
        simulator.step(command[None], 1e-5)
        up = 2.0 * np.array(
            [q[1] * q[3] - q[0] * q[2], q[2] * q[3] + q[0] * q[1], 0.5 - q[1] ** 2 - q[2] ** 2]
        )
        still = np.concatenate(still_acceleration(own.model[0], tuple(up), tuple(nu[:3]), tuple(nu[3:])))
        shares = vehicle.force(command) / np.abs(vehicle.force_limits).max(axis=1)
        expected = still + own.effect @ shares
        np.testing.assert_allclose((simulator.velocity[0] - nu) / 1e-5, expected, rtol=2e-3, atol=2e-3)


def without_lag(vehicle: VehicleModel) -> VehicleModel:
    return replace(vehicle, units=tuple(replace(unit, lag=unit.lag.none()) for unit in vehicle.units))


# --- In episodes -----------------------------------------------------------------------------------------------------------------------


def pushed(one: Batch, steps: int, seed: int = 0, hold: int = 20) -> tuple[list[Any], Floats]:
    """Push vehicles by random full commands that are held for 2 s; return the records and the largest speed of each step."""
    rng, speeds, records = np.random.default_rng(seed), [], []
    one.reset()
    for step in range(steps):
        if step % hold == 0:
            action = rng.choice([-1.0, 0.0, 1.0], one._action.shape)
        records += one.step(action).records
        speeds.append(np.linalg.norm(one.simulator.velocity[:, :3], axis=1).max())
    return records, np.array(speeds)


def test_limits_of_depth_and_speed_hold_in_open_water() -> None:
    words = (
        "task=waypoint_state",
        "world=open",
        "task.depth_low=-24",
        "task.depth_high=-16",
        "task.time_limit=30",
    )
    records, speeds = pushed(batch(*words, "filter.speed=0.4", n=16), 301, hold=50)
    assert {record["outcome"] for record in records} == {"timeout"}
    assert min(record["depth_margin_m"] for record in records) > 0.09
    assert 0.39 < speeds.max() < 0.47  # the thrusters follow a new command late
    assert set(records[0]) == {*record_columns("waypoint", "open", filtered=True)}
    free, fast = pushed(batch(*words, "filter=none", n=16), 301, hold=50)
    assert {"collision"} <= {record["outcome"] for record in free}
    assert fast.max() > 1.0
    assert not OWN & set(free[0])


def test_a_limit_of_tilt_holds_for_a_vehicle_that_controls_it() -> None:
    """A full roll command turns a BlueROV2 Heavy over; the filter holds it at the limit, nearer with shorter steps."""
    words = (
        "task=waypoint_state",
        "task.observation=[position_error,yaw_error,previous_action]",
        "vehicle=bluerov2_heavy",
    )
    largest = []
    for limit, frequency in (("null", 10), ("0.3", 10), ("0.3", 50)):
        one = batch(*words, f"filter.tilt={limit}", f"step.frequency={frequency}", n=2, seed=4)
        one.reset()
        roll = np.linalg.pinv(one.vehicle.allocation)[:, 3]
        tilts = []
        for _ in range(4 * frequency):
            one.step(np.tile(roll / np.abs(roll).max(), (2, 1)))
            tilts.append(np.arccos(rotation(one.simulator.pose[:, 3:])[:, 2, 2]))
        largest.append(float(np.max(tilts)))
    assert largest[0] > 2.0
    assert 0.25 < largest[1] < 0.55
    assert 0.25 < largest[2] < 0.33
    with pytest.raises(
        ConfigError, match=r"filter.tilt=0.3: vehicle=bluerov2_2026 does not control roll and pitch"
    ):
        batch("filter.tilt=0.3")


def test_what_the_filter_does_is_counted_and_a_current_beyond_its_reach_is_seen() -> None:
    words = (
        "world=tank",
        "world.length=8",
        "world.width=8",
        "task.distance_low=2",
        "task.distance_high=3",
        "task.rise=1",
    )
    for current, beyond in ((0.0, False), (1.5, True)):
        one = batch(*words, f"disturbance.current.speed={current}", "task.time_limit=20", n=8)
        one.reset()
        changes, records = np.zeros((8, 2)), []
        action, over = np.ones_like(one._action), np.zeros(8, dtype=bool)
        while not over.all():
            result = one.step(action)
            change = np.linalg.norm(one._action - action, axis=1)
            for k, i in enumerate(result.ended.tolist()):
                if not over[i]:
                    record = result.records[k]
                    changes[i] += change[i] > 0.0, change[i]
                    assert record["intervention_share"] == pytest.approx(changes[i, 0] / record["steps"])
                    assert record["command_change_mean"] == pytest.approx(changes[i, 1] / record["steps"])
                    records.append(record)
            over[result.ended] = True
            changes += np.stack([change > 0.0, change], axis=1)
        assert max(record["intervention_share"] for record in records) > 0.1
        assert (sum(record["infeasible_steps"] for record in records) > 0) == beyond
        assert beyond or all(record["outcome"] != "collision" for record in records)


def test_a_command_that_leads_nowhere_keeps_its_bits_and_a_resumed_episode_too() -> None:
    plain, one, other = batch("filter=none"), batch(), batch()
    for each in (plain, one, other):
        each.reset()
    gentle = np.random.default_rng(2).uniform(-0.2, 0.2, one._action.shape)
    for _ in range(10):
        for each in (plain, one):
            each.step(gentle)
    assert one.simulator.pose.tobytes() == plain.simulator.pose.tobytes()
    assert not one.task.filter.tallies.any()
    hard = np.ones_like(gentle)
    for _ in range(100):
        one.step(hard)
    assert one.task.filter.tallies.any()
    other.load_state_dict(one.state_dict())
    for _ in range(20):
        assert one.step(hard).observation.tobytes() == other.step(hard).observation.tobytes()
    assert one.task.filter.tallies.tobytes() == other.task.filter.tallies.tobytes()


def test_a_vehicle_gets_out_of_the_way_of_a_solid_that_moves() -> None:
    one = batch(n=2)
    one.reset()
    assert one.task.world is not None
    for i, speed in enumerate((0.3, 0.0)):
        solid = sphere(one.simulator.pose[i, :3] + [0.0, 4.0, 0.0], 1.0, [0.0, -speed, 0.0])
        one.task.world.solids[i, 0], one.task.episodes[i].solids = solid[0], 1
    begin = one.simulator.pose[:, :3].copy()
    for _ in range(200):
        one.step(np.zeros_like(one._action))
    way = np.linalg.norm(one.simulator.pose[:, :3] - begin, axis=1)
    # In 20 s the first sphere moves by 6 m, from 4 m on one side to 2 m on the other.
    assert way[0] > 1.0
    assert one.task.filter.tallies[0, 0] > 0
    assert one.task.filter.tallies[1, 0] == 0
    assert (one.task.episodes.clearance > 0.0).all()
    assert (one.task.episodes.contact == 0).all()


def test_an_environment_of_gymnasium_has_the_filter() -> None:
    environment = AuvEnv(task="transit", vehicle="bluerov2_2026", filter="cbf", overrides=[BLIND])
    environment.reset(seed=1)
    for _ in range(1200):
        *_, terminated, truncated, info = environment.step(np.ones(6, dtype=np.float32))
        if terminated or truncated:
            break
    assert info["record"].keys() >= OWN


@pytest.mark.long
@pytest.mark.slow
def test_a_thousand_episodes_of_pid_without_a_sonar_end_without_a_contact() -> None:
    """docs/safety.md has the figures of the agents with a sonar, and of PPO."""
    episodes = {}
    for name, count in (("none", 200), ("cbf", 1000)):
        config = batch(f"filter={name}", "task.time_limit=60", n=1).config
        agent = make(config, sheet.load(config.vehicle))
        records = roll_out(config, agent, episodes=np.arange(count), seed=7, batch=125).records
        episodes[name] = {int(record["episode"]): record for record in records}
    filtered, free = episodes["cbf"], episodes["none"]
    assert sum(record["outcome"] == "collision" for record in free.values()) > 50
    assert {record["outcome"] for record in filtered.values()} <= {"success", "timeout"}
    assert all(record["hit"] == "" and record["clearance_min_m"] > 0.09 for record in filtered.values())
    assert np.mean([record["outcome"] == "success" for record in filtered.values()]) >= 0.9
    both = [key for key in free.keys() & filtered if free[key]["outcome"] == "success"]
    slower = [filtered[key]["duration_s"] / free[key]["duration_s"] for key in both]
    assert len(both) > 30
    assert np.mean(slower) <= 1.2


# --- By ranges -----------------------------------------------------------------------------------------------------------------------------

ALL_ROUND = (
    "task.observation=[position_error,yaw_error,velocity,angular_velocity,gravity,range.ideal]",
    *("task.range.ideal.columns=17", "task.range.ideal.horizontal=6", "task.range.ideal.rows=9"),
    *(
        "task.range.ideal.vertical=3.1415",
        "filter.knows=ranges",
        "world=tank",
        "world.length=8",
        "world.width=8",
    ),
    *("task.distance_low=2", "task.distance_high=3", "task.rise=1", "task.time_limit=20"),
)
"""rays to all sides, in a tank"""


def test_echoes_are_where_the_rays_hit_and_are_forgotten() -> None:
    config = batch(*ALL_ROUND, n=1).config
    spec = observation_spec(config.task, sheet.load(config.vehicle).actuators)
    echoes = Echoes(config, spec, 2)
    pose = np.tile([3.0, -1.0, -9.0, math.cos(0.4), 0.0, 0.0, math.sin(0.4)], (2, 1))  # turned by 0.8 rad
    seen, steps = np.zeros((2, spec.size), np.float32), np.array([0, 0])
    ray, first = 40, spec["range.ideal"].start
    seen[1, first + ray] = 0.75  # 2.5 m away
    echoes.see(pose, seen, steps, 0, 2)
    x, y, z = echoes.rays[ray]
    c, s = math.cos(0.8), math.sin(0.8)
    place = pose[0, :3] + 2.5 * np.array([c * x - s * y, s * x + c * y, z])
    known = echoes.solids["position"][1]
    assert not (echoes.solids["position"][0] < 1e5).any()
    np.testing.assert_allclose(known[known[:, 0] < 1e5], [place], atol=1e-6)
    for steps[:] in range(1, SCANS * echoes.every):
        seen[:] = 0.0 if steps[0] >= echoes.every else seen
        echoes.see(pose, seen, steps, 0, 2)
        assert (known[:, 0] < 1e5).sum() == 1
    echoes.see(pose, seen, steps + 1, 0, 2)
    assert not (known < 1e5).any()


@pytest.mark.slow
@pytest.mark.parametrize("navigation", [(), ("navigation=ekf", "sensors=dvl_a50", "noise=none")])
def test_rays_to_all_sides_keep_a_vehicle_from_the_walls_of_a_tank(navigation: tuple[str, ...]) -> None:
    records, _ = pushed(batch(*ALL_ROUND, *navigation, n=8), 201)
    assert {record["outcome"] for record in records} <= {"success", "timeout"}
    assert min(record["clearance_min_m"] for record in records) > 0.05
    assert max(record["intervention_share"] for record in records) > 0.05


# --- Configuration ---------------------------------------------------------------------------------------------------------------------


def test_runs_without_a_filter_keep_their_ids_and_columns() -> None:
    plain: Any = OmegaConf.to_container(compose("train", ["algo=pid"]))
    without = {key: value for key, value in plain.items() if key != "filter"}
    assert identity.run_id(plain) == identity.run_id(without)
    assert typed(OmegaConf.create(without)).filter.name == "none"
    chosen: Any = OmegaConf.to_container(compose("train", ["algo=pid", "filter=cbf"]))
    assert identity.run_id(chosen) != identity.run_id(plain)
    assert {*record_columns("transit", "field", filtered=True)} - {*record_columns("transit", "field")} == OWN


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["vehicle=lrauv"], "filter=cbf: needs a vehicle with only thrusters; vehicle=lrauv also has"),
        (["filter.current=9"], "filter.current=9: vehicle=bluerov2_2026 cannot brake against this current; reduce it"),
        (["filter.knows=eyes"], "filter.knows=eyes: unknown; valid: map, ranges"),
        (["filter.knows=ranges", "task=transit"], "filter.knows=ranges: needs range.ideal, since other sensors do not show where"),
        (["filter.margn=1"], "filter.margn: unknown key; did you mean filter.margin?"),
        (["simulator=gazebo"], "filter=cbf: not available with simulator=gazebo; use simulator=fossen, or filter=none"),
    ],
)  # fmt: skip
def test_a_filter_that_cannot_act_is_refused(
    words: list[str], line: str, tmp_path: Any, monkeypatch: Any, capsys: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["train", "algo=pid", "filter=cbf", *words]) == 2
    assert line in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_vehicle_that_cannot_move_sideways_is_refused() -> None:
    config = configuration(overrides=["task=waypoint_state", VEHICLE, "algo=pid", "filter=cbf"])
    vehicle = sheet.load(config.vehicle)
    spec = observation_spec(config.task, vehicle.actuators)
    turned = [replace(unit, direction=np.array([1.0, 0.0, 0.0])) for unit in vehicle.units[:4]]
    with pytest.raises(ConfigError, match="vehicle=bluerov2_2026 cannot brake in every direction"):
        filters.make(config, replace(vehicle, units=(*turned, *vehicle.units[4:])), spec, 1)


def test_ardusub_has_no_filter() -> None:
    config = configuration(overrides=["task=waypoint", "algo=pid", "noise=none", "filter=cbf"])
    with pytest.raises(ConfigError, match="filter=cbf: not available with algo=ardusub"):
        ardusub.refuse(config)
