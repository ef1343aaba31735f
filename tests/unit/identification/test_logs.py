"""Reading logs: columns, units, and one clear error for each thing that is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from auvbench.cli import main
from auvbench.identification import csv_log, inputs, readers
from auvbench.identification.log import Log, LogError
from auvbench.vehicles import sheet

ROWS = 101


def table(**columns: object) -> pd.DataFrame:
    """A good log of two thrusters and yaw; `columns` replace or, as None, remove columns."""
    time = 0.1 * np.arange(ROWS)
    frame = pd.DataFrame(
        {
            "t_s": time,
            "thruster1_cmd": np.where(time % 4 < 2, 0.3, -0.3),
            "thruster2_cmd": 0.1,
            "yaw_rad": 0.5 * np.sin(time),
            "r_radps": 0.5 * np.cos(time),
        }
    )
    for name, values in columns.items():
        frame = frame.drop(columns=name) if values is None else frame.assign(**{name: values})
    return frame


def parsed(frame: str = "enu", **columns: object) -> Log:
    return csv_log.parse(table(**columns), "log.csv", "0", frame)


def test_units_and_names_of_columns() -> None:
    log = parsed(
        yaw_rad=None,
        yaw_deg=np.degrees(0.5 * np.sin(0.1 * np.arange(ROWS))),
        r_radps=None,
        r_degps=np.degrees(0.5 * np.cos(0.1 * np.arange(ROWS))),
        t_s=None,
        t_ms=100.0 * np.arange(ROWS),
        depth_m=np.linspace(1.0, 2.0, ROWS),
        voltage_V=15.0,
    )
    same = parsed()
    assert log.kind == "command"
    assert log.actuators == ("thruster1", "thruster2")
    np.testing.assert_allclose(log.measured[:, 5], same.measured[:, 5])
    np.testing.assert_allclose(log.measured[:, 11], same.measured[:, 11])
    np.testing.assert_allclose(log.time, same.time)
    np.testing.assert_allclose(log.measured[:, 2], np.linspace(-1.0, -2.0, ROWS))
    assert log.voltage is not None
    assert np.all(log.voltage == 15.0)


def test_a_table_with_z_down_becomes_flu() -> None:
    angles = 0.1 * np.sin(np.arange(ROWS))
    log = parsed("ned", z_m=np.linspace(1.0, 2.0, ROWS), pitch_rad=angles, v_mps=angles, y_m=angles)
    same = parsed()
    np.testing.assert_allclose(log.measured[:, 2], np.linspace(-1.0, -2.0, ROWS))
    np.testing.assert_allclose(log.measured[:, 4], -angles)
    np.testing.assert_allclose(log.measured[:, 7], -angles)
    np.testing.assert_allclose(log.measured[:, 1], -angles)
    np.testing.assert_allclose(log.measured[:, 5], -same.measured[:, 5])
    np.testing.assert_allclose(log.measured[:, 11], -same.measured[:, 11])


def test_a_quaternion_gives_the_attitude() -> None:
    half = 0.5 * np.linspace(0.0, 7.0, ROWS)
    log = parsed(yaw_rad=None, r_radps=None, qw=np.cos(half), qx=0.0, qy=0.0, qz=np.sin(half))
    np.testing.assert_allclose(log.measured[:, 5], 2.0 * half, atol=1e-9)  # unwrapped


def test_an_empty_cell_is_no_measurement_and_an_input_holds() -> None:
    yaw = 0.5 * np.sin(0.1 * np.arange(ROWS))
    texts = [f"{value}" if k % 2 == 0 else "" for k, value in enumerate(yaw)]
    command = ["0.2", *[""] * 49, "-0.2", *[""] * 50]
    log = parsed(yaw_rad=texts, thruster1_cmd=command, r_radps=None)
    assert np.isnan(log.measured[1::2, 5]).all()
    assert log.interval("yaw") == pytest.approx(0.2)
    assert set(log.inputs[:50, 0]) == {0.2}
    assert set(log.inputs[50:, 0]) == {-0.2}


def test_no_window_crosses_a_gap() -> None:
    time = 0.1 * np.arange(ROWS)
    time[50:] += 30.0
    log = parsed(t_s=time)
    assert log.segments == ((0, 50), (50, ROWS))
    assert log.duration == pytest.approx(9.9)
    assert "1 gap without rows, the first of 30.1 s at 4.9 s" in log.remarks[0]


def test_a_channel_that_never_changes_was_not_measured() -> None:
    log = parsed(x_m=0.0)
    assert not log.has("x")
    assert "x never change" in log.remarks[0]


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"t_s": None}, "has no time; it needs a column t_s"),
        ({"t_s": 0.1 * np.arange(ROWS)[::-1]}, "it must increase from row to row"),
        ({"t_s": 100.0 * np.arange(ROWS)}, "its rows are 100 s apart at the median; a log needs a row every 2 s or more often: is the time in ms"),
        ({"z_m": np.sin(0.1 * np.arange(ROWS)), "w_mps": 15.0 * np.cos(0.1 * np.arange(ROWS))}, "w is 15 times the derivative of z; give positions in m"),
        ({"z_m": np.sin(0.1 * np.arange(ROWS)), "w_mps": 1e-3 * np.cos(0.1 * np.arange(ROWS))}, "times the derivative of z; give positions in m and velocities in m"),
        ({"thruster1_cmd": None, "thruster2_cmd": None}, "has no inputs; record what the thrusters were commanded"),
        ({"thruster1_cmd": 0.0, "thruster2_cmd": 0.0}, "all inputs are neutral"),
        ({"thruster1_cmd": 1600.0}, "commands in [-1, 1] are from -1 to 1"),
        ({"thruster1_cmd": ["", *["0.1"] * 100]}, "thruster1_cmd is empty in row 1"),
        ({"yaw_rad": ["nan", *["0.1"] * 100]}, "yaw_rad is 'nan' in row 1; it must be a finite number"),
        ({"yaw_rad": ["0.1", "inf", *["0.1"] * 99]}, "yaw_rad is 'inf' in row 2"),
        ({"thruster1_us": 1500.0}, "has inputs of 2 kinds"),
        ({"yaw_rad": None, "r_radps": None}, "has no measurement"),
        ({"yawn_rad": 0.0}, "unknown column 'yawn_rad'; did you mean 'yaw_rad'?"),
        ({"r_radps": -0.1 * np.cos(0.1 * np.arange(ROWS))}, "r has the opposite sign of the derivative of yaw"),
        ({"r_radps": 57.3 * 0.5 * np.cos(0.1 * np.arange(ROWS))}, "the rates look like deg/s"),
        ({"yaw_rad": np.degrees(0.5 * np.sin(0.1 * np.arange(ROWS)))}, "the attitude looks like degrees"),
        ({"r_radps": 60.0}, "the largest value of a vehicle in water is 35 rad/s; a column in deg/s"),
        ({"pitch_rad": np.linspace(0.0, 12.0, ROWS)}, "is the column in degrees? Then name it pitch_deg"),
        ({"z_m": np.where(np.arange(ROWS) < 50, -1.0, -9.0)}, "z jumps by -8 m in 0.1 s before row 51"),
        ({"ax_mps2": 0.0, "ay_mps2": 0.0, "az_mps2": 1.0}, "the specific force is 1 m/s2 at the median"),
        ({"ax_mps2": 0.0}, "has ax but not ay"),
        ({"z_m": -1.0, "depth_m": 1.0}, "has z_m and depth_m"),
        ({"qw": 2.0, "qx": 0.0, "qy": 0.0, "qz": 0.0, "yaw_rad": None}, "has length 2; it must be 1"),
    ],
)  # fmt: skip
def test_what_is_wrong_gets_one_line(columns: dict[str, object], message: str) -> None:
    with pytest.raises(LogError) as raised:
        parsed(**columns)
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_short_log_is_refused() -> None:
    with pytest.raises(LogError, match=r"has 0.9 s without a gap"):
        csv_log.parse(table().head(10), "log.csv", "0")


def test_inputs_go_to_the_actuators_by_name_or_number() -> None:
    vehicle = sheet.load("bluerov2_2026")
    time = 0.1 * np.arange(ROWS)
    pulses = {f"pwm{k}_us": 1500.0 + 10.0 * k for k in range(6, 0, -1)}
    numbered = csv_log.parse(pd.DataFrame({"t_s": time, "yaw_rad": np.sin(time), **pulses}), "a", "0")
    names = {f"thruster{k}_cmd": 10.0 * k / 400.0 for k in range(1, 7)}
    named = csv_log.parse(pd.DataFrame({"t_s": time, "yaw_rad": np.sin(time), **names}), "b", "0")
    np.testing.assert_allclose(inputs.quantities(numbered, vehicle), inputs.quantities(named, vehicle))
    np.testing.assert_allclose(inputs.quantities(named, vehicle)[0], vehicle.force(np.arange(1, 7) / 40.0))


def test_thrust_follows_the_voltage() -> None:
    vehicle = sheet.load("bluerov2_2026")
    time = 0.1 * np.arange(ROWS)
    columns = {f"pwm{k}_us": 1900.0 for k in range(1, 7)}
    volts = np.linspace(12.0, 16.0, ROWS)
    log = csv_log.parse(
        pd.DataFrame({"t_s": time, "yaw_rad": np.sin(time), "voltage_V": volts, **columns}), "a", "0"
    )
    force = inputs.quantities(log, vehicle)[:, 0]
    # The maker's table: 36.42 N at 12 V, 44.36 N at 14 V and 51.44 N at 16 V.
    np.testing.assert_allclose(force[[0, 50, 100]], [36.42349, 44.36356, 51.43623], rtol=1e-5)


def test_an_actuator_without_a_column_is_named() -> None:
    vehicle = sheet.load("bluerov2_2026")
    with pytest.raises(LogError, match="has no input for thruster3 of bluerov2_2026"):
        inputs.quantities(parsed(), vehicle)
    with pytest.raises(LogError, match="bluerov2_2026 has no actuator 'bow'"):
        inputs.quantities(parsed(bow_cmd=0.1), vehicle)


def test_own_records_are_logs(tmp_path: Path) -> None:
    steps = 50
    path = np.column_stack([0.1 * np.arange(steps + 1), np.zeros(steps + 1), -5.0 + np.zeros(steps + 1)])
    arrays = {
        "time": 0.1 * np.arange(steps + 1),
        "position": path,
        "yaw": np.linspace(3.0, 4.0, steps + 1) % 3.2,
        "command": np.ones((steps, 6)),
        "waypoint": np.zeros(3),
    }
    file = tmp_path / "trajectories.npz"
    stored = {f"{name}_still_{k}": array.astype(np.float32) for k in (0, 1) for name, array in arrays.items()}
    np.savez_compressed(file, **stored)
    for place in (file, tmp_path):
        logs = readers.read([str(place)])
        assert [log.kind for log in logs] == ["force", "force"]
        assert inputs.quantities(logs[0], sheet.load("bluerov2_2026")).shape == (steps + 1, 6)
        assert logs[1].has("x")
        assert not logs[1].has("z")


@pytest.mark.parametrize("command", ["identify", "validate"])
def test_a_mistake_is_one_line(
    command: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    table().to_csv("log.csv", index=False)
    Path("log.txt").write_text("x")
    Path("bad.csv").write_text("t_s\n1\n\x00,\n")
    for words, message in (
        ([], "no log given"),
        (["log.csv"], "no vehicle given"),
        (["none.csv", "vehicle=bluerov2"], "none.csv: does not exist"),
        (["log.txt", "vehicle=bluerov2"], "log.txt: not a log that auvbench reads"),
        (["bad.csv", "vehicle=bluerov2"], "bad.csv: "),
        (["log.csv", "vehicle=bluerov"], "did you mean 'bluerov2'?"),
        (["log.csv", "vehicle=bluerov2"], "has no input for thruster3"),
        (["log.csv", "vehicle=bluerov2", "frame=nwu"], "frame=nwu: "),
        (
            ["log.csv", "vehicle=bluerov2", "motors=thruster1"],
            "motors=thruster1: log.csv names its thrusters",
        ),
        (["log.csv", "vehcle=bluerov2"], "did you mean 'vehicle'?"),
        (["log.csv", "vehicle="], "has no value"),
    ):
        assert main([command, *words]) == 2, words
        error = capsys.readouterr().err
        assert message in error
        assert error.count("\n") == 1, error


def test_w_may_be_against_the_height_at_a_forward_speed() -> None:
    height = np.sin(0.1 * np.arange(ROWS))
    assert parsed(z_m=height, w_mps=-0.3 * np.cos(0.1 * np.arange(ROWS))).has("w")
