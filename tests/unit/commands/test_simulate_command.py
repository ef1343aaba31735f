"""`auvbench simulate` as typed: files, frames, plots, and one line for each mistake."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

from auvbench.cli import main
from auvbench.config.compose import compose
from auvbench.runs.run_filter import flat

DATA = Path(__file__).parents[2] / "verification" / "data"


def run(*arguments: str) -> int:
    return main(["simulate", *arguments])


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def rows(path: str) -> np.ndarray:
    return np.loadtxt(path, delimiter=",", skiprows=1)


def test_the_command_of_the_issue(tmp_path: Path) -> None:
    assert run("vehicle=bluerov2_heavy", "input.wrench=[40,0,0,0,0,0]", "input.frame=ned", "duration=20", "sample=0.1",
               "output=surge.csv") == 0  # fmt: skip
    written, published = (tmp_path / "surge.csv").read_text().splitlines(), (DATA / "vonbenzon_surge40N.csv").read_text().splitlines()  # fmt: skip
    assert written[0] == published[0]
    assert len(written) == len(published)
    got, expected = rows("surge.csv"), rows(str(DATA / "vonbenzon_surge40N.csv"))
    usable = expected[:, 0] <= 12
    np.testing.assert_allclose(got[usable, 1:4], expected[usable, 1:4], atol=1e-6 * 9.6)


def test_initial_pose_and_velocity_in_ned() -> None:
    """Roll release: the pose is read as x, y, z, qw, qx, qy, qz in the frame that is named."""
    half = np.radians(10)
    assert run("vehicle=bluerov2_heavy", f"input.pose=[0,0,5,{np.cos(half):.15g},{np.sin(half):.15g},0,0]", "input.frame=ned",
               "thrusters=off", "output=roll.csv") == 0  # fmt: skip
    np.testing.assert_allclose(
        rows("roll.csv"), rows(str(DATA / "vonbenzon_roll_release_20deg.csv")), atol=1e-8
    )


@pytest.mark.slow
def test_enu_is_ned_with_the_signs_of_y_and_z_turned() -> None:
    assert run("vehicle=rexrov", "input.wrench=[900,300,-200,10,20,30]", "input.velocity=[0.3,0.1,0.2,0,0.1,0.1]",
               "input.current=[0.1,0.2,0.3]", "duration=5", "input.frame=ned", "output=ned.csv") == 0  # fmt: skip
    assert run("vehicle=rexrov", "input.wrench=[900,-300,200,10,-20,-30]", "input.velocity=[0.3,-0.1,-0.2,0,-0.1,-0.1]",
               "input.current=[0.1,-0.2,-0.3]", "duration=5", "input.frame=enu", "output=enu.csv") == 0  # fmt: skip
    signs = np.tile([1, -1, -1], 4)
    np.testing.assert_allclose(rows("enu.csv")[:, 1:], rows("ned.csv")[:, 1:] * signs, atol=1e-10)


@pytest.mark.slow
def test_commands_by_list_and_by_name_are_the_same() -> None:
    assert run("vehicle=lrauv", "input.command=[0.5,-0.2,0,0,0,0]", "duration=3", "output=list.csv") == 0
    assert (
        run("vehicle=lrauv", "input.command={propeller: 0.5, rudder: -0.2}", "duration=3", "output=name.csv")
        == 0
    )
    assert Path("list.csv").read_text() == Path("name.csv").read_text()
    assert rows("list.csv")[-1, 7] > 0


def test_current_carries_a_drifting_vehicle() -> None:
    assert (
        run(
            "vehicle=bluerov2",
            "input.current=[0.3,0,0]",
            "input.velocity=[0.3,0,0,0,0,0]",
            "duration=5",
            "output=drift.csv",
        )
        == 0
    )
    last = rows("drift.csv")[-1]
    assert last[1] == pytest.approx(1.5, abs=1e-3)


def test_without_output_the_csv_goes_to_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("duration=1", "sample=0.5") == 0
    out = capsys.readouterr().out.splitlines()
    assert out[0].startswith("t_s,x_m")
    assert [line.split(",")[0] for line in out[1:]] == ["0", "0.5", "1"]


@pytest.mark.slow
@pytest.mark.parametrize("file", ["a b.svg", "c.pdf", "e.png"])
def test_plot(file: str) -> None:
    assert run("duration=1", f"plot={file}") == 0
    assert Path(file).stat().st_size > 1000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("vehicle=bluerov22",), "did you mean 'bluerov2'?"),
        (("vehicle=./mine.yaml",), "takes a name, not a path; put the file into conf/vehicle/mine.yaml"),
        (("input.wrench=[40,0,0,0,0]",), "must be 6 finite numbers"),
        (("input.wrench=[40,0,0,0,0,x]",), "input.wrench"),
        (("input.current=[nan,0,0]",), "must be 3 finite numbers"),
        (("input.pose=[0,0,0,1,1,0,0]",), "of length 1, it has 1.41421"),
        (("input.frame=nwu",), "valid: enu, ned"),
        (("input.command=[0.5]",), "has 1 numbers, bluerov2_2026 has 6 actuators"),
        (("input.command=[0.5,0,0,0,0,2]",), "thruster6 is 2"),
        (("input.command={thruster9: 1}",), "did you mean 'thruster"),
        (("input.command=fast",), "must be a list of numbers"),
        (("input.command=[1,0,0,0,0,0]", "thrusters=off"), "leaves no thruster to command"),
        (("thrusters=maybe",), "valid: off, on"),
        (("duration=-1",), "must be more than 0"),
        (("sample=0",), "must be more than 0"),
        (("duration=1e6", "sample=1e-3"), "must be at least 0.1"),
        (("--plot", "a.png"), "plot=a.png"),
        (("max_step=2",), "at most 1"),
        (("max_step=1e-9",), "must be at least 2e-08"),
        (("inputt.wrench=[1,0,0,0,0,0]",), "unknown"),
        (("durration=3",), "did you mean duration?"),
        (("output=/proc/nowhere/x.csv",), "cannot be written"),
        (("output=.",), "is a directory"),
        (("plot=x.gif",), "must end with one of"),
        (("-m", "duration=1,2"), "grids are for auvbench train"),
    ],
)  # fmt: skip
def test_mistakes_get_one_line(
    arguments: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(*arguments) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert "Traceback" not in error


def test_a_failed_run_leaves_no_empty_file() -> None:
    assert run("input.command=[0.5]", "output=x.csv") == 2
    assert not Path("x.csv").exists()


def test_help_holds_every_key(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--help") == 0
    out = capsys.readouterr().out
    for key in flat({**OmegaConf.to_container(compose("simulate")), "vehicle": None}):
        assert f"  {key}=" in out
    assert "hydra" not in out


def test_four_digits_of_a_quaternion_are_enough() -> None:
    assert run("input.pose=[0,0,-5,0.9962,0.0872,0,0]", "duration=0.1", "output=x.csv") == 0
    assert rows("x.csv")[0, 4] == pytest.approx(2 * np.arctan2(0.0872, 0.9962), abs=1e-12)


def test_enu_and_ned_agree_on_where_north_is() -> None:
    """Typed as a navigator would: heading north-east, a current to the east, a push to starboard."""
    psi = 0.6  # NED heading; the ENU yaw of the same heading is pi/2 - psi
    ned_q, enu_q = (np.array([np.cos(a / 2), 0, 0, np.sin(a / 2)]) for a in (psi, np.pi / 2 - psi))
    listed = ",".join(f"{value:.17g}" for value in (3, -2, 7, *ned_q))
    assert run("vehicle=bluerov2_wu2018", f"input.pose=[{listed}]", "input.wrench=[5,9,-2,0,0,0.3]", "input.frame=ned",
               "input.current=[0,0.4,0.1]", "duration=6", "output=ned.csv") == 0  # fmt: skip
    listed = ",".join(f"{value:.17g}" for value in (-2, 3, -7, *enu_q))
    assert run("vehicle=bluerov2_wu2018", f"input.pose=[{listed}]", "input.wrench=[5,-9,2,0,0,-0.3]", "input.frame=enu",
               "input.current=[0.4,0,-0.1]", "duration=6", "output=enu.csv") == 0  # fmt: skip
    ned, enu = rows("ned.csv"), rows("enu.csv")
    np.testing.assert_allclose(enu[:, [2, 1, 3]], ned[:, 1:4] * [1, 1, -1], atol=1e-9)
    np.testing.assert_allclose(enu[:, 6], np.pi / 2 - ned[:, 6], atol=1e-9)
    np.testing.assert_allclose(enu[:, 7:], ned[:, 7:] * [1, -1, -1, 1, -1, -1], atol=1e-9)
