"""The tether against closed forms: a catenary, the decay of its energy, the angle of a towed cable."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numba import njit
from scipy.optimize import brentq

from auvbench.dynamics.layout import CURRENT
from auvbench.envs.batch import Batch
from auvbench.errors import ConfigError
from auvbench.runs.identity import digest
from auvbench.tasks import records
from auvbench.tasks.disturbances import tether
from auvbench.tasks.disturbances.composed import check
from auvbench.testing import check_disturbance
from auvbench.vehicles import sheet
from tests import configs

CABLE = {
    "length": 30.0,
    "diameter": 0.0076,
    "mass": 0.3,
    "weight": 2.0,
    "stiffness": 2e5,
    "damping": 500.0,
    "normal_drag": 1.2,
    "tangential_drag": 0.0,
    "east": 0.0,
    "north": 0.0,
    "attached_x": 0.0,
    "attached_z": 0.0,
}


@njit
def advance(
    x: Any, v: Any, water: Any, parameters: Any, free: bool, seconds: float
) -> tuple[float, float, float]:
    p, force = parameters[0], (0.0, 0.0, 0.0)
    for _ in range(math.ceil(seconds / p.longest)):
        force = tether.step(x, v, water[0], p.longest, p, free)
    return force


def cable(**changes: float) -> tuple[Any, dict[str, Any]]:
    """Return the parameters of a cable as a record and by name."""
    vehicle = sheet.load(configs.training().vehicle)
    values = tether.parameters(tether.Tether(**{**CABLE, **changes}), vehicle)
    return records.plain(records.one_row(values, dict.fromkeys(records.PARAMETERS, 1.0), "cable")), values


def water(speed: float = 0.0) -> Any:
    """Return a current to the east."""
    current = np.zeros(1, CURRENT)
    current["velocity"][0, 0] = speed
    return current


def bent(end: tuple[float, float, float], sag: float) -> np.ndarray:
    """Return nodes from the origin to an end, which hang down in the middle."""
    share = np.linspace(0.0, 1.0, tether.NODES)[:, None]
    nodes = share * np.array(end)
    nodes[:, 2] -= sag * (1.0 - np.abs(2.0 * share[:, 0] - 1.0))
    return nodes


@pytest.mark.slow
def test_a_cable_at_rest_hangs_as_a_catenary() -> None:
    parameters, values = cable()
    x = bent((20.0, 0.0, -5.0), 11.0)
    v = np.zeros_like(x)
    pull_x, pull_y, pull_z = advance(x, v, water(), parameters, False, 120.0)
    assert np.abs(v).max() < 2e-3
    # Length s, span b and height h give a = H / w by 2 a sinh(b / 2 a) = sqrt(s^2 - h^2).
    s, b, h = CABLE["length"], 20.0, -5.0
    a = brentq(lambda a: 2.0 * a * math.sinh(b / (2.0 * a)) - math.sqrt(s * s - h * h), 1.0, 1000.0)
    lowest = b / 2.0 - a * math.asinh(h / (2.0 * a * math.sinh(b / (2.0 * a))))
    assert pull_x == pytest.approx(-CABLE["weight"] * a, rel=5e-3)
    assert pull_y == 0.0
    assert pull_z == pytest.approx(-CABLE["weight"] * a * math.sinh((b - lowest) / a), rel=5e-3)
    assert x[:, 2].min() == pytest.approx(a - a * math.cosh(lowest / a), rel=5e-3)
    assert values["longest"] < 1e-3


@pytest.mark.slow
def test_without_a_current_a_cable_only_loses_energy() -> None:
    parameters, values = cable(stiffness=2844.0, damping=20.0, weight=0.5, mass=0.043, length=20.0)
    x = bent((5.0, 0.0, -10.0), 3.0)
    v = np.random.default_rng(1).normal(size=x.shape)
    v[[0, -1]] = 0.0

    def energy() -> float:
        strain = np.linalg.norm(np.diff(x, axis=0), axis=1) / values["segment"] - 1.0
        elastic = 0.5 * values["stiffness"] * values["segment"] * np.sum(np.maximum(strain, 0.0) ** 2)
        kinetic = 0.5 * values["node"] * np.sum(v**2)
        return float(elastic + kinetic + values["weight_of_segment"] * np.sum(x[1:-1, 2]))

    energies = [energy()]
    for _ in range(100):
        advance(x, v, water(), parameters, False, 0.2)
        energies.append(energy())
    assert np.all(np.diff(energies) < 0.0)
    assert energies[-1] < energies[0] - 10.0


@pytest.mark.slow
@pytest.mark.parametrize(("weight", "speed"), [(1.0, 1.0), (3.0, 1.0), (0.5, 0.7)])
def test_a_towed_cable_has_the_angle_at_which_drag_carries_its_weight(weight: float, speed: float) -> None:
    parameters, _ = cable(weight=weight, length=20.0)
    x = bent((10.0, 0.0, -15.0), 0.0)
    v = np.zeros_like(x)
    advance(x, v, water(speed), parameters, True, 300.0)
    east, _, up = np.diff(x, axis=0).T
    # Across the cable: 1/2 rho d C (U sin a)^2 = w cos a, so that tan a = w / (drag of the vertical component).
    across = 0.5 * sheet.load(configs.training().vehicle).density * CABLE["diameter"] * CABLE["normal_drag"]
    angle = brentq(lambda a: across * (speed * math.sin(a)) ** 2 - weight * math.cos(a), 1e-3, 1.57)
    np.testing.assert_allclose(np.tan(np.arctan2(-up, east)), math.tan(angle), rtol=5e-3)


@pytest.mark.slow
def test_it_keeps_the_contract() -> None:
    check_disturbance("disturbance=tether", "disturbance.current.speed=0.3")


def drifting(seconds: float, thrust: float, *overrides: str) -> Batch:
    """Return an environment after some time in an eastward current, with a share of its largest surge force."""
    config = configs.training(
        *overrides, "disturbance.current.direction=0", "noise=none", "task.max_steps=5000"
    )
    batch = Batch(config, 1, seed=1)
    batch.reset()
    action = thrust * np.sign(np.round(batch.vehicle.allocation[:1], 6))
    for _ in range(int(seconds * config.step.frequency)):
        batch.step(action)
    return batch


@pytest.mark.slow
def test_a_tether_holds_a_vehicle_that_drifts() -> None:
    current = "disturbance.current.speed=0.5"
    free = drifting(90.0, 0.0, "disturbance=none", current)
    held = drifting(90.0, 0.0, "disturbance=tether", "disturbance.tether.length=25", current)
    assert free.simulator.pose[0, 0] > 40.0
    assert 20.0 < np.linalg.norm(held.simulator.pose[0, :3]) < 26.0
    # At rest against the current: the pull is the drag of the vehicle and of a part of the cable.
    assert np.linalg.norm(held.simulator.velocity[0, :2]) < 0.1
    assert 10.0 < np.linalg.norm(held.simulator.external_wrench[0, :3]) < 40.0


@pytest.mark.slow
def test_full_thrust_stretches_a_tether_and_nothing_swings_up() -> None:
    farthest = []
    for seconds in (40.0, 50.0, 60.0):
        batch = drifting(seconds, 1.0, "disturbance=tether", "disturbance.tether.length=25")
        farthest.append(float(np.linalg.norm(batch.simulator.pose[0, :3])))
    assert max(farthest) < 25.0 * 1.1


def test_no_length_is_no_tether_and_other_runs_keep_their_identity() -> None:
    assert (
        Batch(configs.training("disturbance=tether", "disturbance.tether.length=0"), 1).disturbances is None
    )
    assert "tether" not in configs.plain("algo=pid", "disturbance=severe")["disturbance"]
    tethered = configs.plain("algo=pid", "disturbance=tether")
    assert digest(tethered) != digest(configs.plain("algo=pid", "disturbance=none"))


def test_a_simulator_without_forces_is_refused() -> None:
    with pytest.raises(
        ConfigError, match=r"disturbance\.tether: needs forces on vehicles, which simulator=ros2"
    ):
        configs.training("disturbance=tether", "simulator=ros2")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("stiffness=1e8", "mass=1e-3", "diameter=1e-4", "length=30"), r"tether\.stiffness=1e\+08: must be at most .* steps of less than 2e-05 s"),
        (("damping=1e6",), r"tether\.damping=1e\+06: must be at most"),
    ],
)  # fmt: skip
def test_a_cable_that_needs_very_short_steps_is_refused(words: tuple[str, ...], message: str) -> None:
    config = configs.training("disturbance=tether", *(f"disturbance.tether.{word}" for word in words))
    with pytest.raises(ConfigError, match=message):
        check(config, sheet.load(config.vehicle))


def test_a_cable_that_is_too_short_for_a_start_is_refused() -> None:
    batch = Batch(configs.training("disturbance=tether", "disturbance.tether.length=19"), 1)
    with pytest.raises(
        ConfigError, match=r"tether\.length=19: an episode starts 20.* m from the point at the surface"
    ):
        batch.reset()
