"""What a vehicle's numbers imply, against closed forms, the reference table and the simulator itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from auvbench.dynamics import frames
from auvbench.simulators import openloop
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles import inspect, sheet
from auvbench.vehicles.vehicle_model import VehicleModel
from auvbench.vehicles.warnings import warnings


def vehicle(name: str) -> VehicleModel:
    return sheet.load(name)


class TestHydrostatics:
    def test_net_buoyancy_and_free_rise_of_bluerov2(self) -> None:
        assert inspect.net_buoyancy(vehicle("bluerov2")) == pytest.approx(4.52, abs=5e-3)
        assert inspect.free_speed(vehicle("bluerov2")) == pytest.approx(0.1543, abs=1e-4)

    def test_heavy_sinks(self) -> None:
        assert inspect.free_speed(vehicle("bluerov2_heavy")) < 0

    def test_level_trim(self) -> None:
        trim = inspect.static_trim(vehicle("bluerov2"))
        assert (trim.roll, trim.pitch) == (0.0, 0.0)
        assert trim.determined

    @pytest.mark.parametrize("offset", [(0.01, 0.004, -0.02), (-0.02, 0.0, -0.03), (0.0, -0.05, -0.01)])
    def test_trim_is_where_the_simulated_vehicle_comes_to_rest(self, offset: tuple[float, ...]) -> None:
        """Released level and strongly damped, it ends at the angles that were computed."""
        base = openloop.without_actuators(vehicle("bluerov2"))
        of = replace(base, center_of_gravity=base.center_of_buoyancy + offset, buoyancy=base.weight)
        rows = openloop.integrate(of, duration=200.0, sample=200.0, max_step=0.01).rows()
        trim = inspect.static_trim(of)
        np.testing.assert_allclose(rows[-1, 4:6], [trim.roll, trim.pitch], atol=1e-4)

    def test_no_righting_moment(self) -> None:
        of = replace(vehicle("bluerov2"), center_of_gravity=np.zeros(3), center_of_buoyancy=np.zeros(3))
        assert not inspect.static_trim(of).determined
        assert any("no restoring moment" in text for text in warnings(of))

    def test_upside_down(self) -> None:
        base = vehicle("bluerov2")
        of = replace(
            base, center_of_gravity=base.center_of_buoyancy, center_of_buoyancy=base.center_of_gravity
        )
        assert any("upright is unstable" in text for text in warnings(of))


class TestReach:
    def test_bluerov2_is_the_reference_table(self) -> None:
        rows = {(row.axis, row.sign): row for row in inspect.reach(vehicle("bluerov2"))}
        assert rows[0, 1].force == pytest.approx(113.137, abs=1e-3)
        assert rows[0, 1].speed == pytest.approx(1.495, abs=5e-4)
        assert rows[1, 1].bollard_speed == pytest.approx(1.378, abs=5e-4)
        assert rows[2, 1].speed == pytest.approx(0.929, abs=5e-4)
        assert rows[2, 1].speed_with_buoyancy > rows[2, 1].speed > rows[2, -1].speed_with_buoyancy

    def test_pitch_is_not_independent(self) -> None:
        assert inspect.rank(vehicle("bluerov2")) == 5
        assert [inspect.AXES[a] for a in inspect.independent_axes(vehicle("bluerov2"))] == [
            "surge",
            "sway",
            "heave",
            "roll",
            "yaw",
        ]

    def test_no_actuators_no_reach(self) -> None:
        assert inspect.reach(openloop.without_actuators(vehicle("bluerov2"))) == []

    @pytest.mark.parametrize(
        ("force", "linear", "quadratic"), [(10.0, 2.0, 0.0), (10.0, 0.0, 3.0), (10.0, 2.0, 3.0)]
    )
    def test_terminal_speed(self, force: float, linear: float, quadratic: float) -> None:
        v = inspect.terminal_speed(force, linear, quadratic)
        assert linear * v + quadratic * v * v == pytest.approx(force)

    def test_no_damping_no_terminal_speed(self) -> None:
        assert inspect.terminal_speed(1.0, 0.0, 0.0) == float("inf")
        assert inspect.terminal_speed(0.0, 0.0, 0.0) == 0.0

    def test_rise_time_limits(self) -> None:
        assert inspect.rise_time(5.0, 10.0, 2.0, 0.0) == pytest.approx(2.5)
        tanh = 5.0 / np.sqrt(10.0 * 3.0) * np.arctanh(1 - np.exp(-1))
        assert inspect.rise_time(5.0, 10.0, 0.0, 3.0) == pytest.approx(tanh)
        assert inspect.rise_time(5.0, 10.0, 1e-9, 3.0) == pytest.approx(tanh, rel=1e-6)


class TestStability:
    def test_wu_is_unstable_in_pitch_and_says_so(self) -> None:
        """The reference page's warning: a surge force at the origin turns Wu's BlueROV2 over."""
        assert "pitch" in {case.plane for case in inspect.instabilities(vehicle("bluerov2_wu2018"))}
        assert any("unstable in pitch" in text for text in warnings(vehicle("bluerov2_wu2018")))

    def test_without_added_mass_there_is_no_munk_moment(self) -> None:
        of = replace(vehicle("bluerov2"), M_A=np.zeros((6, 6)), center_of_gravity=np.array([0.0, 0, -0.04]))
        assert inspect.instabilities(of) == []

    @pytest.mark.parametrize("name", ["bluerov2", "bluerov2_wu2018", "bluerov2_heavy"])
    @pytest.mark.parametrize("plane", ["yaw", "pitch"])
    def test_a_nudge_grows_above_the_limit_and_dies_below(self, name: str, plane: str) -> None:
        """Straight flight in the simulator, held by the force and moment that balance it, then nudged."""
        of = openloop.without_actuators(vehicle(name))
        found = {case.plane: case.above for case in inspect.instabilities(vehicle(name))}
        top = max(row.speed for row in inspect.reach(vehicle(name)) if row.axis == 0)
        slow, fast = 0.8, 1.25
        tries = (
            [(found[plane] * slow, False), (found[plane] * fast, True)] if plane in found else [(top, False)]
        )
        for speed, grows in tries:
            if speed < 0.02 or speed > top:
                continue
            assert (growth(of, speed, plane) > 1.0) is grows, (speed, grows)


def growth(of: VehicleModel, speed: float, plane: str) -> float:
    """How many times a small deviation has grown between the middle and the end of a minute."""
    drag = (of.linear_damping + of.quadratic_damping * speed) * speed
    # Without products of inertia the planes are apart, and an instability of the one does not show in the other.
    neutral = replace(of, buoyancy=of.weight, inertia=np.diag(np.diag(of.inertia)))
    simulator = FossenSimulator(neutral, 1, max_step=0.01)
    tilt = np.array([1e-7, 0, 0]) if plane == "yaw" else np.array([0, 1e-7, 0])
    pose = np.concatenate([np.zeros(3), frames.quaternion(tilt)])
    nudge = np.array([0, 1e-7, 0, 0, 0, 1e-7]) if plane == "yaw" else np.array([0, 0, 1e-7, 0, 1e-7, 0])
    simulator.reset(np.array([0]), pose[None], (np.array([speed, 0, 0, 0, 0, 0]) + nudge)[None])
    simulator.external_wrench[0, 0] = drag[0]
    watched = [1, 5] if plane == "yaw" else [2, 4]
    sizes = []
    for _ in range(120):
        simulator.step(np.zeros((1, 0)), 0.25)
        sizes.append(float(np.abs(simulator.velocity[0, watched]).max()))
    return max(sizes[60:]) / max(sizes[:60])


class TestShortestTimeConstant:
    def test_closed_form_where_no_axis_acts_on_another(self) -> None:
        base = vehicle("bluerov2_realistic_inertia")
        level = replace(base, center_of_gravity=np.zeros(3), center_of_buoyancy=np.zeros(3))
        # Yaw damps fastest. All six thrusters at 40 N give 40 (2 * .1665 + 2 * .1750) N m about z.
        moment = 40.0 * np.abs(base.allocation[5]).sum()
        rate = (-3.744 + np.sqrt(3.744**2 + 4 * 40.0 * moment)) / 80.0
        assert inspect.shortest_time_constant(level) == pytest.approx((0.245 + 0.12) / (3.744 + 80.0 * rate))

    def test_without_damping_there_is_none(self) -> None:
        of = replace(vehicle("bluerov2"), linear_damping=np.zeros(6), quadratic_damping=np.zeros(6))
        assert inspect.shortest_time_constant(of) == np.inf

    def test_linear_damping_needs_no_speed(self) -> None:
        of = replace(vehicle("bluerov2"), linear_damping=np.eye(6)[0] * 10.0, quadratic_damping=np.zeros(6))
        assert inspect.shortest_time_constant(of) == pytest.approx(1.0 / (10.0 * of.M_inverse[0, 0]))


class TestWarnings:
    def test_borrowed_inertia(self) -> None:
        assert any("inertia looks too large" in text for text in warnings(vehicle("bluerov2")))
        for name in ("bluerov2_realistic_inertia", "bluerov2_heavy", "rexrov", "lrauv"):
            assert not any("inertia" in text for text in warnings(vehicle(name)))

    def test_peak_of_von_benzons_curve(self) -> None:
        assert any(
            "peaks at command 0.972 with 30.62 N" in text for text in warnings(vehicle("bluerov2_heavy"))
        )

    def test_propeller_alone(self) -> None:
        text = next(text for text in warnings(vehicle("lrauv")) if text.startswith("rank 1"))
        assert "rudder" in text

    def test_no_damping(self) -> None:
        of = replace(vehicle("bluerov2"), linear_damping=np.zeros(6), quadratic_damping=np.zeros(6))
        assert sum("no damping" in text for text in warnings(of)) == 6
