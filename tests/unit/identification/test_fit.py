"""Recovery of known numbers from simulated logs, and what logs cannot say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from auvbench.errors import ConfigError
from auvbench.identification import gate, manoeuvres, motion, parameters, sheets
from auvbench.identification.fit import Fit, _at_bound, _covariance, _resampled, fit
from auvbench.identification.log import CHANNELS, Lasting, Log
from auvbench.identification.parameters import Parameter
from auvbench.identification.residuals import Residuals
from auvbench.identification.validation import share_of_holding
from auvbench.identification.windows import Held, Predictor, cut
from auvbench.vehicles import sheet, signals
from auvbench.vehicles.vehicle_model import VehicleModel

NOISE = {"yaw": 0.005, "r": 0.005}
TRUTH = {"added_mass.yaw": 0.4, "linear_damping.yaw": 1.6, "quadratic_damping.yaw": 0.5}


def flown(
    truth: Mapping[str, float],
    axes: list[str],
    seconds: float,
    *,
    noise: Mapping[str, float] = NOISE,
    seed: int = 0,
    amplitude: float = 0.1,
) -> tuple[VehicleModel, Log]:
    vehicle = sheet.load("bluerov2_2026")
    generator = np.random.default_rng(seed)
    command = signals.telegraph(vehicle, axes, seconds, amplitude, generator)
    other = parameters.with_values(vehicle, dict(truth))
    return vehicle, manoeuvres.fly(
        other, command, generator, noise=noise, every=3, delay=truth.get("delay", 0.0)
    )


def fitted(vehicle: VehicleModel, log: Log, *names: str, kept: dict[str, str] | None = None) -> Fit:
    return fit([log], vehicle, parameters.choose(vehicle, names, False), kept=kept)


def by_name(result: Fit) -> dict[str, tuple[float, float, float, str]]:
    return {e.parameter.name: (e.value, e.low, e.high, e.kept) for e in result.estimates}


@pytest.mark.slow
def test_the_numbers_of_yaw_come_back() -> None:
    vehicle, log = flown(TRUTH, ["yaw"], 40.0)
    result = by_name(fitted(vehicle, log, *TRUTH))
    for name, truth in TRUTH.items():
        value, low, high, kept = result[name]
        assert not kept
        assert value == pytest.approx(truth, rel=0.15)
        assert low < truth < high
        assert low < value < high


@pytest.mark.slow
def test_a_vehicle_without_linear_damping_does_not_get_the_sheet_s() -> None:
    truth = {"added_mass.yaw": 0.15, "linear_damping.yaw": 0.0, "quadratic_damping.yaw": 4.0}
    vehicle, log = flown(truth, ["yaw"], 30.0)
    result = by_name(fitted(vehicle, log, *truth))
    assert result["linear_damping.yaw"][:2] == (pytest.approx(0.9 / 16.0, rel=1e-3), 0.0)
    assert not result["linear_damping.yaw"][3]
    assert result["added_mass.yaw"][0] == pytest.approx(0.15, rel=0.1)
    assert result["quadratic_damping.yaw"][0] == pytest.approx(4.0, rel=0.1)


@pytest.mark.slow
def test_a_log_of_yaw_says_nothing_about_surge_and_mass() -> None:
    vehicle, log = flown(TRUTH, ["yaw"], 30.0)
    result = by_name(fitted(vehicle, log, "mass", "added_mass.surge", *TRUTH))
    for name in ("mass", "added_mass.surge"):
        assert result[name][3]
        assert result[name][0] == pytest.approx(parameters.known(vehicle)[name].prior)
    assert not result["added_mass.yaw"][3]


@pytest.mark.slow
def test_of_inertia_and_added_mass_a_log_has_the_sum() -> None:
    vehicle, log = flown(TRUTH, ["yaw"], 40.0)
    result = by_name(fitted(vehicle, log, "inertia.yaw", *TRUTH))
    kept = [name for name in ("inertia.yaw", "added_mass.yaw") if result[name][3]]
    assert len(kept) == 1
    assert "together with" in result[kept[0]][3]
    total = result["inertia.yaw"][0] + result["added_mass.yaw"][0]
    assert total == pytest.approx(vehicle.inertia[2, 2] + TRUTH["added_mass.yaw"], rel=0.05)


@pytest.mark.slow
def test_lag_and_delay_are_told_apart() -> None:
    truth = {**TRUTH, "lag": 0.1, "delay": 0.06}
    vehicle, log = flown(truth, ["yaw"], 60.0, noise={"yaw": 0.002, "r": 0.002})
    result = by_name(fitted(vehicle, log, "lag", "delay", *TRUTH))
    assert result["lag"][0] == pytest.approx(0.1, abs=0.02)
    assert result["delay"][0] == pytest.approx(0.06, abs=0.015)


@pytest.mark.slow
def test_a_wrong_sheet_predicts_worse_before_than_after() -> None:
    vehicle, log = flown(TRUTH, ["yaw"], 30.0)
    result = fitted(vehicle, log, *TRUTH)
    r = CHANNELS.index("r")
    before, after = (
        np.sqrt(np.nanmean((values - result.windows.measured)[..., r] ** 2))
        for values in (result.before, result.predicted)
    )
    assert after < 0.2 * before
    assert result.sigma["r"] == pytest.approx(0.005, rel=0.2)


def test_the_error_over_that_of_holding_shows_what_a_sheet_lacks() -> None:
    vehicle, log = flown(TRUTH, ["yaw"], 20.0, noise={"r": 1e-4})
    true, own = (share_of_holding([log], vehicle, values)["r"] for values in (TRUTH, {}))
    assert true < 0.02
    assert own > 5.0 * true


@pytest.mark.slow
def test_the_same_log_gives_the_same_bits() -> None:
    vehicle, log = flown(TRUTH, ["yaw"], 20.0)
    one, two = (fitted(vehicle, log, *TRUTH) for _ in range(2))
    np.testing.assert_array_equal(one.x, two.x)
    np.testing.assert_array_equal(one.covariance, two.covariance)


@pytest.mark.slow
def test_an_outlier_does_not_move_the_fit() -> None:
    vehicle, log = flown(TRUTH, ["yaw"], 40.0)
    clean = by_name(fitted(vehicle, log, *TRUTH))
    rows = np.flatnonzero(np.isfinite(log.measured[:, CHANNELS.index("r")]))[30::60]
    log.measured[rows, CHANNELS.index("r")] += 1.0
    dirty = by_name(fitted(vehicle, log, *TRUTH))
    for name in TRUTH:
        assert dirty[name][0] == pytest.approx(clean[name][0], rel=0.2)


@pytest.mark.slow
def test_a_kept_parameter_stays() -> None:
    vehicle, log = flown(TRUTH, ["yaw"], 20.0)
    result = by_name(fitted(vehicle, log, *TRUTH, kept={"added_mass.yaw": "because"}))
    assert result["added_mass.yaw"][0] == parameters.known(vehicle)["added_mass.yaw"].prior
    assert result["added_mass.yaw"][3] == "because"


def test_a_number_that_is_zero_or_unknown_is_refused() -> None:
    vehicle = sheet.load("bluerov2")
    zero = {**{f"linear_damping.{axis}": 0.0 for axis in ("yaw",)}}
    with pytest.raises(ConfigError, match="is 0 in the sheet of bluerov2"):
        parameters.choose(parameters.with_values(vehicle, zero), ["linear_damping.yaw"], False)
    with pytest.raises(ConfigError, match=r"did you mean 'linear_damping\.yaw'"):
        parameters.choose(vehicle, ["linear_dampin.yaw"], False)


def closed_loop(vehicle: VehicleModel) -> Log:
    """A vehicle under a yaw controller, pushed by an unknown moment."""
    from auvbench.simulators.fossen import FossenSimulator

    generator = np.random.default_rng(0)
    simulator = FossenSimulator(vehicle, 1, 0.005)
    simulator.pose[:, 2] = -10.0
    push = signals.direction(vehicle, "yaw")
    limits = vehicle.force(np.ones(6))
    rows, commands, moment = [], [], 0.0
    for _ in range(2000):
        rows.append([2.0 * np.arctan2(simulator.pose[0, 6], simulator.pose[0, 3]), simulator.velocity[0, 5]])
        share = float(np.clip(-0.25 * rows[-1][0] - 0.15 * rows[max(0, len(rows) - 4)][1], -0.5, 0.5))
        commands.append(vehicle.action(share * push))
        moment += 0.02 * (-moment / 1.0) + 0.6 * float(generator.standard_normal()) * 0.02**0.5
        simulator.external_wrench[:, 5] = 2.0 * moment
        simulator.step(commands[-1][None], 0.02)
    assert limits.size == 6
    measured = np.full((len(rows), 12), np.nan)
    measured[:, 5] = np.unwrap(np.array(rows)[:, 0])
    measured[:, 11] = np.array(rows)[:, 1]
    time = 0.02 * np.arange(len(rows))
    return Log(
        "closed",
        "",
        time,
        "command",
        vehicle.actuators,
        np.array(commands),
        measured,
        segments=((0, len(rows)),),
    )


def test_the_gate_separates_open_from_closed_loop() -> None:
    vehicle, log = flown(TRUTH, ["yaw"], 40.0)
    opened = {verdict.axis: verdict for verdict in gate.judge([log], vehicle)}
    assert opened["yaw"].state == "open loop"
    assert opened["yaw"].correlation > 0.7
    assert 0.0 <= opened["yaw"].lag <= 0.1
    assert opened["surge"].state == "still"
    kept = gate.reasons(list(opened.values()), ["added_mass.surge", "added_mass.yaw"])
    assert kept == {
        "added_mass.surge": "the thrusters were hardly commanded along this axis, and the log shows no motion along it"
    }
    assert gate.warning(list(opened.values())) == ""
    drifting = gate.judge([replace(log, inputs=0.01 * log.inputs)], vehicle)
    assert "no axis was commanded with more than 2 %" in gate.warning(drifting)
    verdicts = gate.judge([replace(log, inputs=-log.inputs)], vehicle)
    assert "moves against the commands on yaw" in gate.warning(verdicts)
    assert "moves against" in gate.reasons(verdicts, ["added_mass.yaw"])["added_mass.yaw"]
    verdicts = gate.judge([closed_loop(vehicle)], vehicle)
    closed = {verdict.axis: verdict for verdict in verdicts}
    assert closed["yaw"].state == "closed loop"
    assert "record a telegraph signal without a controller" in gate.warning(verdicts)
    assert list(gate.reasons(verdicts, ["added_mass.yaw", "lag"])) == ["added_mass.yaw"]


@pytest.mark.slow
def test_rare_measurements_leave_the_order_open() -> None:
    vehicle, log = flown(TRUTH, ["yaw"], 40.0)
    log.measured[np.arange(len(log.time)) % 10 != 0] = np.nan
    verdicts = {verdict.axis: verdict.state for verdict in gate.judge([log], vehicle)}
    assert verdicts["yaw"] == "not resolved"


def test_a_prediction_from_true_states_is_the_simulation() -> None:
    vehicle, log = flown(TRUTH, ["surge", "yaw"], 20.0, noise=dict.fromkeys(CHANNELS, 1e-9))
    windows = cut([log], 2.0)
    predicted = Predictor(windows, vehicle).states(TRUTH)
    error = np.nanmax(np.abs(predicted - windows.measured), axis=(0, 1))
    assert np.all(error < [2e-3] * 3 + [2e-3] * 3 + [2e-3] * 3 + [4e-3] * 3)


def test_many_predictions_are_the_same_as_one_by_one() -> None:
    vehicle, log = flown(TRUTH, ["surge", "yaw"], 10.0, noise=dict.fromkeys(CHANNELS, 1e-3))
    predictor = Predictor(cut([log], 2.0), vehicle)
    sets = [TRUTH, {"delay": 0.05}, {"lag": 0.1, "thrust": 1.2}]
    together = predictor.many(sets)
    for values, states in zip(sets, together, strict=True):
        np.testing.assert_array_equal(predictor.states(values), states)


def test_a_held_input_after_a_lag_is_exact() -> None:
    time, values = np.array([0.0, 0.3, 0.35]), np.array([[1.0], [3.0], [0.0]])
    tau = 0.1
    held = Held(time, values, np.array([tau]))
    grid = np.linspace(-0.1, 1.0, 110_001)
    fine = held.at(grid)[:, 0]
    # x(0.3) = 1; x(0.35) = 3 - 2 exp(-0.5); then it fades.
    assert fine[0] == 1.0
    assert float(held.at(np.array([0.35]))[0, 0]) == pytest.approx(3.0 - 2.0 * np.exp(-0.5))
    assert float(held.at(np.array([0.55]))[0, 0]) == pytest.approx((3.0 - 2.0 * np.exp(-0.5)) * np.exp(-2.0))
    means = held.means(np.array([0.2, 0.4, 0.9]))[:, 0]
    for k, (first, last) in enumerate(((0.2, 0.4), (0.4, 0.9))):
        inside = (grid >= first - 1e-9) & (grid <= last + 1e-9)
        assert means[k] == pytest.approx(np.trapezoid(fine[inside], grid[inside]) / (last - first), rel=1e-4)


def test_the_covariance_of_a_sheet_has_no_negative_eigenvalue() -> None:
    steps = 1e3 * np.random.default_rng(0).standard_normal((5, 22))  # fewer replicates than numbers
    assert np.linalg.eigvalsh(np.array(sheets.rounded(np.cov(steps, rowvar=False))))[0] > -1e-6


def test_attitudes_on_two_sides_of_the_vertical_are_close() -> None:
    # The bow points up but for 2 degrees; roll and yaw of the two differ by half a turn.
    before, after = np.array([0.1, 1.536, 0.2]), np.array([0.1 + np.pi, 1.536, 0.2 + np.pi])
    assert np.linalg.norm(motion.turns(after, before)) == pytest.approx(2.0 * (0.5 * np.pi - 1.536), rel=1e-6)
    level = np.array([0.01, -0.02, 2.0])
    np.testing.assert_allclose(motion.turns(level + 0.01, level), 0.01, atol=3e-4)
    np.testing.assert_allclose(motion.turns(level, level), 0.0, atol=1e-12)
    # A turn about the vertical is a turn of yaw at every tilt, also of more than half a turn.
    np.testing.assert_allclose(
        motion.turns(before + np.array([0.0, 0.0, 4.0]), before), [0.0, 0.0, 4.0 - 2.0 * np.pi], atol=1e-9
    )


def test_a_tumbling_vehicle_is_compared_by_rotations() -> None:
    time = 0.02 * np.arange(200)
    measured = np.full((200, 12), np.nan)
    measured[:, 3:6] = 0.1, 0.0, 0.2
    measured[100:, 4] = np.minimum(0.05 * np.arange(100), 1.5)
    log = Log("turn", "", time, "wrench", (), np.zeros((200, 6)), measured, segments=((0, 200),))
    windows = cut([log], 1.0)
    assert windows.tumbling.tolist() == [False, False, True, True]
    other = windows.measured.copy()
    other[..., 3] += np.pi
    other[..., 5] += np.pi
    error = windows.error(other)
    np.testing.assert_allclose(error[0, 1:, [3, 5]], np.pi)
    assert np.nanmax(np.abs(error[3, -5:, 3:6])) < 0.2
    # Without yaw, roll is not compared near the vertical.
    measured[:, 5] = np.nan
    windows = cut([log], 1.0)
    assert not windows.tumbling.any()
    assert np.isnan(windows.measured[3, :, 3]).all()


def test_a_start_has_the_noise_of_its_measurement() -> None:
    vehicle, log = flown({"added_mass.yaw": 3.0}, ["yaw"], 10.0, noise={"yaw": 0.002, "r": 0.01})
    windows = cut([log], 2.0)
    residuals = Residuals(Predictor(windows, vehicle), parameters.choose(vehicle, ["added_mass.yaw"], False))
    r, yaw = CHANNELS.index("r"), CHANNELS.index("yaw")
    residuals.sigma[:] = 0.08
    spread = residuals._start_spread()[0]
    assert spread[r] == pytest.approx(0.01, rel=0.3)
    assert spread[yaw] == 0.08  # A shift of yaw bends no prediction.
    residuals.sigma[:] = 0.004
    assert residuals._start_spread()[0, r] == 0.004
    residuals.sigma[:] = 0.5
    assert residuals._start_spread()[0, r] == 0.05


def test_an_error_that_lasts_is_not_taken_for_motion() -> None:
    """A velocity that is 0.05 m/s too high, and inputs that are late, change the residuals of the true numbers little if they are told."""
    vehicle, log = flown(TRUTH, ["surge", "yaw"], 20.0, noise=dict.fromkeys(CHANNELS, 1e-4))
    measured = log.measured.copy()
    measured[:, 7] += 0.05
    inputs = np.vstack([np.repeat(log.inputs[:1], 2, axis=0), log.inputs[:-2]])
    offset = np.where(np.array(CHANNELS) == "v", 0.04, 0.0)
    told = Lasting(offset, np.zeros(12), early=0.03, all_early=0.01, depth_scale=0.0)
    truth = tuple(replace(parameters.known(vehicle)[name], prior=value) for name, value in TRUTH.items())
    sizes, sensitivity = [], []
    for lasting in (None, told):
        wrong = replace(log, measured=measured, inputs=inputs, lasting=lasting)
        residuals = Residuals(Predictor(cut([wrong], 2.0), vehicle), truth)
        x = np.zeros(3)
        for _ in range(4):
            residuals.linearise(x)
        r, _ = residuals.project(residuals.raw(x))
        sizes.append(float(np.sqrt(np.mean((r.reshape(residuals.there.shape) * residuals.sigma) ** 2))))
        sensitivity.append(residuals.of_whole_logs(x).shape[1])
    assert sizes[1] < 0.3 * sizes[0]
    assert sensitivity == [0, 2]


def test_an_error_of_the_whole_log_widens_intervals() -> None:
    gradients = np.random.default_rng(0).standard_normal((20, 2))
    matrices = np.tile(10.0 * np.eye(2), (20, 1, 1))
    for errors, wider in ((np.zeros((0, 2)), 1.0), (np.array([[100.0, 0.0]]), 7.0)):
        for found in (
            _covariance(gradients, matrices, errors),
            _resampled(gradients, matrices, errors, 400, 0),
        ):
            sd = np.sqrt(np.diag(found))
            # Without the error both are those of Gauss-Newton, 1 / sqrt(201); with it the first is nearly 100 / 201.
            assert sd[0] == pytest.approx(wider * sd[1], rel=0.1)


def test_a_thruster_that_does_not_act_is_named() -> None:
    gain = Parameter("gain.T6", "1", 1.0, 0.3)
    assert "T6 hardly pushes as the sheet says" in _at_bound(gain, -4.0)
    assert _at_bound(gain, 4.0) == "the fit ran to its bound"
