"""Vehicles drawn from the covariance of an identified sheet."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from auvbench.cli import main
from auvbench.config import schema
from auvbench.dynamics import layout
from auvbench.envs.batch import Batch
from auvbench.errors import ConfigError
from auvbench.identification import parameters
from auvbench.runs.identity import digest
from auvbench.simulators.fossen import FossenSimulator
from auvbench.tasks import records
from auvbench.tasks.bounds import top_speed
from auvbench.tasks.disturbances.identified import draw_differences
from auvbench.vehicles import sheet
from auvbench.vehicles.curves import t200_at
from auvbench.vehicles.drawn import PLACES, REACH, DrawnVehicles, strength
from auvbench.vehicles.identified import Identified
from auvbench.vehicles.inspect import shortest_time_constant
from auvbench.vehicles.vehicle_model import VehicleModel
from tests import configs

NAMES = (
    *("mass", "inertia.yaw", "added_mass.heave", "added_mass.surge", "quadratic_damping.yaw"),
    *("net_buoyancy", "center_of_buoyancy.z", "lag", "thrust", "gain.T3"),
)


def known(vehicle: VehicleModel, names: tuple[str, ...], covariance: Any) -> Identified:
    """Return an identification of `names` whose estimates are the sheet's numbers."""
    there = parameters.known(vehicle)
    return Identified(
        parameters=names,
        prior=np.array([there[name].prior for name in names]),
        sd=np.array([there[name].sd for name in names]),
        logarithmic=np.array([there[name].log for name in names]),
        fitted=np.zeros(len(names)),
        covariance=np.asarray(covariance, dtype=np.float64),
        delay=0.0,
        errors={},
    )


def configuration(*words: str) -> schema.TrainConfig:
    return configs.training("vehicle=bolt", "task.max_steps=8", *words)


def flown(config: schema.TrainConfig, n: int = 3, steps: int = 12) -> bytes:
    """Return the states of some steps, over the end of episodes."""
    batch = Batch(config, n, seed=3)
    batch.reset()
    action = np.random.default_rng(0).uniform(-1.0, 1.0, (steps, n, 8))
    rows = [batch.step(a).observation.copy() for a in action]
    return np.array(rows).tobytes() + batch.simulator.pose.tobytes() + batch.simulator.velocity.tobytes()


def test_every_number_that_a_log_determines_has_its_place() -> None:
    assert len(PLACES) == layout.CHANGE.itemsize // 8
    vehicle = sheet.load("bluerov2_2026")
    others = {name for name in parameters.known(vehicle) if name not in PLACES}
    assert {name.partition(".")[0] for name in others} == {"thrust", "gain", "delay", "voltage"}


def test_a_drawn_vehicle_moves_as_a_sheet_with_its_numbers() -> None:
    vehicle = sheet.load("bolt")
    own = known(vehicle, NAMES, np.eye(len(NAMES)))
    x = np.random.default_rng(1).normal(0.0, 0.5, (2, len(NAMES)))
    changes, gains = DrawnVehicles.of(vehicle, own, 1.0).changes(x)
    both = FossenSimulator(vehicle, 18)
    lanes = np.array([1, 17])
    both.set_vehicles(lanes, changes)
    both.effectiveness[lanes] *= gains
    command = np.random.default_rng(2).uniform(-1.0, 1.0, (10, 8))
    fitted = [dict(zip(NAMES, row.tolist(), strict=True)) for row in own.values(x)]
    others = [FossenSimulator(parameters.with_values(vehicle, values), 1) for values in fitted]
    for other, values in zip(others, fitted, strict=True):
        other.effectiveness[:] = parameters.gains(vehicle, values)
    plain = FossenSimulator(vehicle, 1)
    for row in command:
        both.step(np.tile(row, (18, 1)), 0.1)
        for simulator in (*others, plain):
            simulator.step(row[None], 0.1)
    for lane, other in zip(lanes, others, strict=True):
        np.testing.assert_allclose(both.velocity[lane], other.velocity[0], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(both.pose[lane], other.pose[0], rtol=1e-9, atol=1e-12)
        assert np.abs(both.velocity[lane] - plain.velocity[0]).max() > 1e-3
    # A neighbour keeps the bits of the sheet.
    assert both.velocity[0].tobytes() == plain.velocity[0].tobytes()
    again = FossenSimulator(vehicle, 18)
    again.load_state_dict(both.state_dict())
    for simulator in (both, again):
        simulator.step(np.tile(command[0], (18, 1)), 0.1)
    assert again.velocity.tobytes() == both.velocity.tobytes()


def test_a_vehicle_at_its_estimate_has_the_bits_of_no_disturbance() -> None:
    plain, drawn = configuration(), configuration("disturbance=identified")
    content = copy.deepcopy(dict(drawn.vehicle))
    # With a lag: it has its own code.
    content["identification"] = {
        "parameters": ["lag", "mass", "net_buoyancy"],
        "prior": [0.0125, 25.305, 1.2],
        "sd": [1.0, 0.05, 5.0],
        "logarithmic": [True, True, False],
        "fitted": [0.3, 0.1, -0.2],
        "covariance": np.zeros((3, 3)).tolist(),
        "delay": 0.0,
        "errors": {},
        "logs": [],
        "command": "",
    }
    sure = replace(drawn, vehicle=content)
    assert Batch(sure, 1).disturbances is not None
    assert flown(sure) == flown(plain)
    assert flown(drawn) != flown(plain)


def test_draws_have_the_joint_covariance_and_depend_on_their_key_only() -> None:
    vehicle = sheet.load("bolt")
    covariance = np.array([[0.5, -0.4, 0.2], [-0.4, 0.6, -0.1], [0.2, -0.1, 0.3]])
    own = known(vehicle, ("lag", "delay", "added_mass.heave"), covariance)
    drawn = DrawnVehicles.of(vehicle, own, 2.0)
    n = 20_000
    episodes, x = records.table(n, (), "test"), np.zeros((n, 3))
    episodes.environment[:], episodes.seed[:] = np.arange(n), 5
    rows = records.common(episodes)
    draw_differences(np.arange(n), rows, drawn.root, drawn.reach, 0, x)
    assert np.all(x[:, 1] == 0.0)  # A sheet has no delay: it stays, and the others are drawn given this.
    left = [0, 2]
    given = covariance[np.ix_(left, left)] - np.outer(covariance[left, 1], covariance[1, left]) / 0.6
    np.testing.assert_allclose(np.cov(x[:, left].T), 4.0 * given, rtol=0.06, atol=0.02)
    assert np.abs(x).max() <= REACH * 2.0 * np.sqrt(0.3)
    one = np.zeros((n, 3))
    draw_differences(np.array([77]), rows, drawn.root, drawn.reach, 0, one)
    np.testing.assert_array_equal(one[77], x[77])


def test_a_covariance_of_rank_one_is_drawn_too() -> None:
    own = known(sheet.load("bolt"), ("mass", "inertia.yaw"), [[1.0, 0.5], [0.5, 0.25]])
    L = own.root()
    np.testing.assert_allclose(L @ L.T, own.covariance, atol=1e-12)


def test_a_supply_is_drawn_as_a_factor_on_the_thrust() -> None:
    for supply, volts in ((16.0, 13.0), (12.0, 10.5), (14.0, 17.0)):
        own, other = t200_at(supply).table, t200_at(volts).table
        factor = float(strength(np.array(volts), supply))
        assert np.abs(factor * own - other).max() < 0.03 * np.abs(other).max()


def test_the_physics_step_and_the_bounds_cover_all_draws() -> None:
    config = configuration("disturbance=identified")
    batch = Batch(config, 64, seed=0)
    batch.reset()
    part = batch.disturbances["identified"]
    stiffest = shortest_time_constant(part.drawn.extreme(1.0))
    assert stiffest < shortest_time_constant(batch.vehicle)
    assert top_speed(batch.vehicle, config.disturbance) > top_speed(
        batch.vehicle, configuration().disturbance
    )
    from auvbench.vehicles.drawn import changed

    changes, gains = part.drawn.changes(part.x)
    drawn = [changed(batch.vehicle, *pair) for pair in zip(changes, gains, strict=True)]
    assert min(shortest_time_constant(vehicle) for vehicle in drawn) > stiffest


def test_a_weak_thruster_keeps_its_share_of_the_drawn_force() -> None:
    config = configuration(
        "disturbance=[fault,identified]", "disturbance.fault.mode=weak", "disturbance.fault.factor=0.5"
    )
    batch = Batch(config, 4, seed=0)
    batch.reset()
    whole = batch.simulator.effectiveness.copy()
    assert np.ptp(whole) > 0.01
    for _ in range(2):
        batch.step(np.zeros((4, 8)))
    share = batch.simulator.effectiveness / whole
    np.testing.assert_allclose(np.sort(share, axis=1)[:, :2], [[0.5, 1.0]] * 4)


def test_without_a_spread_nothing_is_drawn_and_other_runs_keep_their_identity() -> None:
    assert (
        Batch(configuration("disturbance=identified", "disturbance.identified.spread=0"), 1).disturbances
        is None
    )
    assert "identified" not in configs.plain("algo=pid", "disturbance=severe")["disturbance"]
    plain, drawn = (configs.plain("algo=pid", f"disturbance={name}") for name in ("none", "identified"))
    assert digest(plain) != digest(drawn)


def test_a_sheet_without_an_identification_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "vehicle=bluerov2", "algo=pid", "disturbance=identified"]) == 2
    assert "the sheet of vehicle=bluerov2 has no identification with a covariance; use a sheet that auvbench identify has written" in capsys.readouterr().err  # fmt: skip
    with pytest.raises(ConfigError, match=r"vehicles drawn from an identification, which simulator=ros2"):
        configuration("disturbance=identified", "simulator=ros2")


def test_a_number_that_vehicles_do_not_have_is_refused() -> None:
    vehicle = sheet.load("bolt")
    own = replace(known(vehicle, ("mass",), [[1.0]]), parameters=("colour",))
    with pytest.raises(ConfigError, match="vehicle=bolt has no number 'colour'"):
        DrawnVehicles.of(vehicle, own, 1.0)
