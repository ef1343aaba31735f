"""`auvbench vehicles` as typed."""

from __future__ import annotations

from pathlib import Path

import auvbench.conf
import pytest

from auvbench.cli import main

SHEETS = Path(next(iter(auvbench.conf.__path__))) / "vehicle"


def show(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(["vehicles", *arguments]) == 0
    return capsys.readouterr().out


def test_list(capsys: pytest.CaptureFixture[str]) -> None:
    out = show(capsys)
    for name in ("bluerov2", "bluerov2_heavy", "lrauv", "rexrov"):
        assert name in out


@pytest.mark.parametrize("name", sorted(path.stem for path in SHEETS.glob("*.yaml")))
def test_every_sheet_is_shown(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    out = show(capsys, name)
    for part in (
        "mass matrix",
        "allocation",
        "rank",
        "net buoyancy",
        "static trim",
        "terminal speed",
        "warnings",
        "sources",
    ):
        assert part in out
    assert max(map(len, out.splitlines()[:60])) < 200


def test_a_line_per_thruster_says_where_it_pushes(capsys: pytest.CaptureFixture[str]) -> None:
    lines = show(capsys, "bluerov2").splitlines()
    (first,) = [line for line in lines if "thruster1 pushes" in line]
    assert (
        first.strip()
        == "thruster1 pushes ahead, to port: surge +0.707, sway +0.707, yaw +0.167 (turns to port)"
    )
    (sixth,) = [line for line in lines if "thruster6 pushes" in line]
    assert sixth.strip() == "thruster6 pushes down: heave -1"


@pytest.mark.slow
def test_own_file(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    own = tmp_path / "mine.yaml"
    text = (SHEETS / "bluerov2.yaml").read_text(encoding="utf-8")
    own.write_text(text.replace("name: bluerov2", "name: mine"), encoding="utf-8")
    assert "(mine)" in show(capsys, str(own))


@pytest.mark.slow
def test_own_sheets_in_conf_of_the_working_directory(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "conf" / "vehicle"
    folder.mkdir(parents=True)
    text = (SHEETS / "bluerov2.yaml").read_text(encoding="utf-8")
    (folder / "mine.yaml").write_text(text.replace("name: bluerov2", "name: mine"), encoding="utf-8")
    (folder / "broken.yaml").write_text("name: broken\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    listed = [line.split() for line in show(capsys).splitlines()]
    assert {"mine", "broken", "bluerov2"} <= {words[0] for words in listed if words}
    assert next(words for words in listed if words[:1] == ["broken"])[1] == "broken:"
    assert "(mine)" in show(capsys, "mine")
    assert main(["simulate", "vehicle=mine", "duration=1", "output=x.csv"]) == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            ("mass: {value: 15.22", "mass: {value: '15.22'"),
            "'15.22' is not a number",
        ),
        (("frame: enu", "frame: [enu"), "not valid YAML: line 9: "),
        (("mass: {value: 15.22", "mass: {value: -15.22"), "must be greater than 0"),
        (("25.15, 7.364", "-25.15, 7.364"), "negative damping -25.15 in surge"),
        (("quadratic_damping:", "quadratic_dampin:"), "did you mean 'quadratic_damping'?"),
        (("heave, roll, yaw]", "heave, roll, pitch, yaw]"), "rank-deficient allocation"),
    ],
)
def test_a_wrong_sheet_gets_the_file_and_the_rule(
    change: tuple[str, str], message: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    text = (SHEETS / "bluerov2.yaml").read_text(encoding="utf-8")
    assert change[0] in text
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(text.replace(*change), encoding="utf-8")
    assert main(["vehicles", str(wrong)]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert str(wrong) in error
    assert error.count("\n") == 1


def test_unknown_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["vehicles", "bluerov"]) == 2
    assert "did you mean 'bluerov2'?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("bluerov2", "rexrov"), "vehicles: rexrov: unexpected argument"),
        (("--shet",), "unknown option '--shet' of vehicles; did you mean '--sheet'?"),
    ],
)
def test_wrong_arguments_get_one_line(
    arguments: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["vehicles", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
