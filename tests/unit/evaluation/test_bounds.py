"""Limits of scenarios: what is proven, what is found, and that it is kept, checked and never mixed up."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from auvbench.config import schema
from auvbench.errors import ConfigError, RunError
from auvbench.evaluation.bounds import files
from auvbench.evaluation.bounds.command_replay import Scenario, Trial
from auvbench.evaluation.bounds.compute import (
    PRELOAD,
    all_scenarios,
    compute,
    controllers,
    eligible,
    flown,
)
from auvbench.evaluation.bounds.lower_bound import PRICES, Energy
from auvbench.evaluation.bounds.search import Search
from auvbench.evaluation.protocol import fingerprint, resolve_conditions
from auvbench.runs.pool import Pool
from auvbench.vehicles import sheet
from auvbench.vehicles.symbolic import symbolic
from tests import configs
from tests.conftest import Once

NEAR = "task.waypoint_low=[-5,-5,-24]", "task.waypoint_high=[5,5,-16]"
"""waypoints that are a few seconds away"""


def wrong_bounds(limits, protocol, config):
    """Replay the commands of bounds in the simulator; return a line for each that does not arrive in its steps."""
    wrong = []
    by_name = {condition.name: condition for condition in resolve_conditions(protocol, config)}
    for name in limits.conditions():
        trial = Trial(by_name[name].config)
        there = all_scenarios(by_name[name], protocol)
        for bound in limits.condition(name):
            outcome = trial.run(there[bound.episode], bound.solution().commands)
            if not outcome.arrived or outcome.steps != bound.steps:
                wrong.append(
                    f"{name}, episode {bound.episode}: {outcome.record['outcome']} after {outcome.steps} steps"
                )
    return wrong


def protocol_of(*overrides: str, episodes: int = 2, **changes: Any) -> schema.Protocol:
    protocol = configs.protocol(f"protocol.episodes={episodes}")
    return replace(protocol, overrides=[*protocol.overrides, *overrides], **changes)


def config_of(*overrides: str) -> dict[str, Any]:
    config = configs.plain(*overrides)
    assert isinstance(config, dict)
    return {str(key): value for key, value in config.items()}


@pytest.fixture(scope="module")
def near() -> tuple[schema.Protocol, dict[str, Any]]:
    return protocol_of(*NEAR), config_of()


@pytest.fixture(scope="module")
def computed(near: tuple[schema.Protocol, dict[str, Any]], once: Once) -> tuple[Path, files.Limits]:
    def make(folder: Path) -> None:
        with Pool(1, PRELOAD) as pool:
            compute(*near, folder, pool)

    root = once("bounds", make)
    limits = files.read(root / "test-bluerov2")
    assert limits is not None
    return root, limits


def test_energy_is_what_thrusters_give_less_what_damping_takes() -> None:
    """d/dt (K + V) = nu' B f - D(nu), of which the proven bound is made, holds for the equations of motion."""
    vehicle = sheet.load("bluerov2")
    model = symbolic(vehicle)
    rng = np.random.default_rng(0)
    lever = vehicle.buoyancy * vehicle.center_of_buoyancy - vehicle.weight * vehicle.center_of_gravity

    def energy(x: np.ndarray) -> float:
        w, qx, qy, qz = x[3:7]
        up = np.array([2 * (qx * qz - w * qy), 2 * (qy * qz + w * qx), 1 - 2 * (qx * qx + qy * qy)])
        kinetic = 0.5 * x[7:13] @ vehicle.M @ x[7:13]
        return float(kinetic - (vehicle.buoyancy - vehicle.weight) * x[2] - lever @ up)

    for _ in range(20):
        q = rng.normal(size=4)
        x = np.concatenate([rng.normal(size=3), q / np.linalg.norm(q), rng.normal(size=6)])
        f = rng.uniform(*model.input_limits.T)
        rate = model.derivative(x, f, np.zeros(3)).full()[:, 0]
        h = 1e-6
        slope = (energy(x + h * rate) - energy(x - h * rate)) / (2 * h)
        nu = x[7:13]
        taken = vehicle.linear_damping @ nu**2 + vehicle.quadratic_damping @ np.abs(nu) ** 3
        assert slope == pytest.approx(nu @ vehicle.allocation @ f - taken, rel=1e-5, abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "share"), [("bluerov2", 0.95), ("bluerov2_heavy", 0.6)])
def test_no_velocity_and_thrust_gain_more_than_is_proven(name: str, share: float) -> None:
    """The Heavy's lag may overshoot, which the bound allows for and the steady thrusts here do not reach."""
    vehicle = sheet.load(name)
    energy = Energy(vehicle, 3.0)
    assert np.isfinite(energy.pace).any()
    rng = np.random.default_rng(1)
    n = 20_000
    e = rng.normal(size=(n, 3))
    e /= np.linalg.norm(e, axis=1, keepdims=True)
    low, high = vehicle.force_limits.T
    f = np.where(rng.random((n, len(low))) < 0.5, low, high)
    tau = f @ vehicle.allocation.T
    for a, pace in zip(PRICES, energy.pace, strict=True):
        # The velocity that gains most of this e and these thrusts, and some around it.
        force = a * tau + np.pad(e, ((0, 0), (0, 3)))
        d, q = vehicle.linear_damping, vehicle.quadratic_damping
        nu = np.sign(force) * 2 * np.abs(force) / a / (2 * d + np.sqrt(4 * d**2 + 12 * q * np.abs(force) / a))
        nu *= rng.uniform(0.9, 1.1, size=nu.shape)
        gained = np.sum(force * nu, axis=1) - a * (nu**2 @ d + np.abs(nu) ** 3 @ q)
        assert gained.max() <= pace
        assert gained.max() >= share * pace, "and the bound is not idle"


@pytest.mark.slow
def test_nothing_is_proven_where_coriolis_forces_do_work() -> None:
    assert not np.isfinite(Energy(sheet.load("bluerov2_gz_sim_8_11"), 3.0).pace).any()
    turned, real = Energy(sheet.load("bluerov2_gz_sim_8_12"), 3.0), Energy(sheet.load("bluerov2"), 3.0)
    np.testing.assert_array_equal(turned.pace, real.pace)


@pytest.mark.slow
def test_no_controller_arrives_sooner_than_is_proven() -> None:
    protocol = protocol_of(episodes=4)
    (condition,) = resolve_conditions(protocol, config_of())
    agents = controllers(condition.config)
    energy = Energy(sheet.load("bluerov2"), 3.0)
    for episode, scenario in enumerate(all_scenarios(condition, protocol)):
        least = energy.steps(scenario, 10.0)
        assert all(
            least <= len(commands) for commands in flown(condition.config, agents, protocol, episode).values()
        )
        assert least > 20


@pytest.mark.slow
def test_what_is_found_arrives_and_is_quicker_than_controllers(
    near: tuple[schema.Protocol, dict[str, Any]], computed: tuple[Path, files.Limits]
) -> None:
    protocol, config = near
    _, limits = computed
    held = limits.condition("nominal")
    assert wrong_bounds(limits, protocol, config) == []
    (condition,) = resolve_conditions(protocol, config)
    agents = controllers(condition.config)
    quickest = [
        min(map(len, flown(condition.config, agents, protocol, episode).values())) for episode in range(2)
    ]
    steps = np.array([bound.steps for bound in held])
    assert (steps <= quickest).all()
    assert (steps < quickest).any()
    assert all(bound.least_steps <= bound.steps == bound.solution().steps for bound in held)


@pytest.mark.slow
def test_workers_and_interruptions_change_nothing(
    near: tuple[schema.Protocol, dict[str, Any]], computed: tuple[Path, files.Limits], tmp_path: Path
) -> None:
    class Enough(Exception):
        pass

    def stop(bound: files.Bound) -> None:
        if bound.episode == 1:
            raise Enough

    with pytest.raises(Enough), Pool(1, PRELOAD) as pool:
        compute(*near, tmp_path, pool, stop)
    place = tmp_path / ".test-bluerov2"
    first, second = sorted(place.glob("*.json"))
    assert files.read_finished(first) == computed[1].bounds[0]
    second.write_bytes(second.read_bytes()[:-20])
    assert files.read_finished(second) is None
    with Pool(2, PRELOAD) as pool:
        compute(*near, tmp_path, pool)
    assert not list(place.glob("*.json"))
    for name in ("bounds.jsonl", "summary.json"):
        mine = (tmp_path / "test-bluerov2" / name).read_bytes()
        assert mine == (computed[0] / "test-bluerov2" / name).read_bytes(), name


def test_limits_of_other_scenarios_and_damaged_ones_are_not_used(tmp_path: Path) -> None:
    shipped = files.read(files.shipped() / "test-bluerov2")
    assert shipped is not None
    mine = "f" * 16  # which no shipped limits have
    files.write(tmp_path / "test-bluerov2", replace(shipped, about=replace(shipped.about, fingerprint=mine)))
    found, said = files.find("test", "bluerov2", mine, [tmp_path])
    assert found is not None
    assert said == []
    none, said = files.find("test", "bluerov2", "0" * 16, [tmp_path])
    assert none is None
    assert "of other scenarios" in said[0]
    table = tmp_path / "test-bluerov2" / "bounds.jsonl"
    table.write_bytes(table.read_bytes().replace(b'"episode": 0', b'"episode": 10'))
    none, said = files.find("test", "bluerov2", mine, [tmp_path])
    assert none is None
    assert "bytes instead of" in said[0]
    with pytest.raises(RunError):
        files.read(tmp_path / "test-bluerov2")


@pytest.mark.slow
def test_what_has_no_limit_is_refused() -> None:
    config = config_of()
    with pytest.raises(ConfigError, match="frequency is not set"):
        eligible(resolve_conditions(protocol_of(frequency=None), config))
    with pytest.raises(ConfigError, match="still water"):
        eligible(resolve_conditions(protocol_of("disturbance=calm"), config))
    with pytest.raises(ConfigError, match="simulator=gazebo: bounds use the equations"):
        eligible(resolve_conditions(protocol_of(), config_of("simulator=gazebo")))
    robust = configs.protocol("protocol=robustness")
    good, left_out = eligible(resolve_conditions(robust, config))
    assert {c.name for c in good} >= {"nominal", "noise=2"}
    assert any(line.startswith("current=0.5: ") for line in left_out)
    (condition,) = resolve_conditions(protocol_of(), config_of("vehicle=lrauv"))
    with pytest.raises(ConfigError, match="cover thrusters"):
        Search(condition.config)


def searched(vehicle: str, *waypoints: str) -> tuple[Search, Scenario, files.Solution, int]:
    """Search for one waypoint; return the search, its scenario, what it found, and the steps of the quickest controller."""
    protocol = protocol_of(*waypoints, episodes=1)
    (condition,) = resolve_conditions(protocol, config_of(f"vehicle={vehicle}"))
    (scenario,) = all_scenarios(condition, protocol)
    starts = flown(condition.config, controllers(condition.config), protocol, 0)
    search = Search(condition.config)
    return search, scenario, search.find(scenario, starts), min(map(len, starts.values()))


@pytest.mark.slow
def test_thrusters_with_lag_are_covered() -> None:
    search, scenario, found, quickest = searched("rexrov", *NEAR)
    assert search.trial.run(scenario, found.commands).arrived
    assert found.steps <= quickest


@pytest.mark.slow
def test_a_vehicle_that_turns_aside_is_led_along_the_plan() -> None:
    far = "task.waypoint_low=[-18,-18,-24]", "task.waypoint_high=[-14,-14,-20]"
    search, scenario, found, quickest = searched("bluerov2_2026", *far)
    outcome = search.trial.run(scenario, found.commands)
    assert (outcome.arrived, outcome.steps) == (True, found.steps)
    assert found.steps < quickest


SHIPPED = sorted(folder.name for folder in files.shipped().glob("*-*") if folder.is_dir())


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED or [pytest.param("none", marks=pytest.mark.skip("none is shipped"))])
def test_shipped_limits_are_of_today_s_scenarios_and_arrive(name: str) -> None:
    limits = files.read(files.shipped() / name)
    assert limits is not None
    protocol = configs.protocol(f"protocol={limits.about.protocol}")
    config = config_of(f"vehicle={limits.about.vehicle}")
    assert limits.about.fingerprint == fingerprint(protocol, resolve_conditions(protocol, config))
    assert wrong_bounds(limits, protocol, config) == []
