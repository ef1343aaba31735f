"""Sheets in ./conf/vehicle that cannot be read: each error names the file, and none hides the others."""

from __future__ import annotations

from pathlib import Path

import auvbench.conf
import pytest

from auvbench.cli import main

BLUEROV2 = (Path(next(iter(auvbench.conf.__path__))) / "vehicle" / "bluerov2.yaml").read_text(
    encoding="utf-8"
)


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("conf/vehicle").mkdir(parents=True)


def write(text: str, name: str = "w") -> None:
    Path(f"conf/vehicle/{name}.yaml").write_text(text, encoding="utf-8")


def refusal(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What the command says, without the name of the program, having checked that it is one line."""
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    return error.removeprefix("auvbench: ").rstrip()


def listed(capsys: pytest.CaptureFixture[str]) -> str:
    assert main(["vehicles"]) == 0
    return capsys.readouterr().out


def test_defaults_that_loop(capsys: pytest.CaptureFixture[str]) -> None:
    write("name: w\ndefaults: [w, _self_]\n")
    write("defaults: [b]\nname: a\n", "a")
    write("defaults: [a]\nname: b\n", "b")
    assert refusal(capsys, "vehicles", "w") == (
        "conf/vehicle/w.yaml: defaults: 'w' inherits from itself (conf/vehicle/w.yaml -> conf/vehicle/w.yaml);"
        " name another sheet"
    )
    assert refusal(capsys, "vehicles", "conf/vehicle/w.yaml").startswith("conf/vehicle/w.yaml: ")
    assert refusal(capsys, "vehicles", "a").startswith("conf/vehicle/b.yaml: defaults: 'a' inherits")
    out = listed(capsys)
    assert out.count("inherits from itself") == 3
    assert "rexrov" in out


def test_a_missing_base_is_told_at_the_sheet_that_names_it(capsys: pytest.CaptureFixture[str]) -> None:
    write("name: w\ndefaults: [bluerov9, _self_]\n")
    error = refusal(capsys, "vehicles", "w")
    assert error.startswith("conf/vehicle/w.yaml: defaults: vehicle 'bluerov9' is not known; did you mean")


def test_files_that_cannot_be_read_do_not_hide_the_others(capsys: pytest.CaptureFixture[str]) -> None:
    Path("conf/vehicle/latin.yaml").write_bytes("name: latin\ntitle: Système\n".encode("latin-1"))
    Path("conf/vehicle/folder.yaml").mkdir()
    Path("conf/vehicle/dangling.yaml").symlink_to("nowhere.yaml")
    latin = "conf/vehicle/latin.yaml: is not UTF-8: save the sheet as UTF-8 text"
    folder = "conf/vehicle/folder.yaml: cannot be read: Is a directory"
    dangling = "conf/vehicle/dangling.yaml: cannot be read: No such file or directory"
    out = " ".join(listed(capsys).split())
    for reason in (latin, folder, dangling):
        assert f"broken: {reason}" in out
    assert "rexrov" in out
    for name, reason in (("latin", latin), ("folder", folder), ("dangling", dangling)):
        assert refusal(capsys, "vehicles", name) == reason
    assert refusal(capsys, "simulate", "vehicle=latin") == latin
    assert refusal(capsys, "vehicles", "conf/vehicle/folder.yaml") == folder


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("name: w\nmass: [1,\n", "conf/vehicle/w.yaml: not valid YAML: line 3: "),
        ("name: w\n\ttitle: x\n", "conf/vehicle/w.yaml: not valid YAML: line 2: "),
        ("name: w\nname: v\n", "conf/vehicle/w.yaml: not valid YAML: line 2: found duplicate key name"),
        ("name: w\ntitle: \0\n", "conf/vehicle/w.yaml: not valid YAML: "),
        ("a: &x {b: *x}\n", "conf/vehicle/w.yaml: not valid YAML: *x is inside"),
        ("[a]: 1\n", "conf/vehicle/w.yaml: not valid YAML: line 1: "),
        ("defaults: [bluerov9]\n", "conf/vehicle/w.yaml: defaults: vehicle 'bluerov9' is not known"),
        ("defaults: [w]\n", "conf/vehicle/w.yaml: defaults: 'w' inherits from itself"),
    ],
)  # fmt: skip
def test_every_command_says_the_same_of_a_broken_text(
    text: str, reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    write(text)
    said = refusal(capsys, "vehicles", "w")
    assert said.startswith(reason)
    assert refusal(capsys, "simulate", "vehicle=w") == said
    assert refusal(capsys, "train", "vehicle=w", "algo=pid") == said
    assert refusal(capsys, "train", "-m", "vehicle=bluerov2,w", "algo=pid") == said


@pytest.mark.slow
def test_every_command_says_the_same_of_a_wrong_number(capsys: pytest.CaptureFixture[str]) -> None:
    text = BLUEROV2.replace("name: bluerov2\n", "name: w\n").replace("[25.15, 7.364", "[-25.15, 7.364")
    write(text)
    said = refusal(capsys, "vehicles", "w")
    assert said.startswith("conf/vehicle/w.yaml: hydrodynamics.")
    composed = said.replace("conf/vehicle/w.yaml", "vehicle w")
    assert refusal(capsys, "simulate", "vehicle=w") == composed
    assert refusal(capsys, "train", "vehicle=w", "algo=pid") == composed


@pytest.mark.slow
def test_an_override_mends_a_sheet(capsys: pytest.CaptureFixture[str]) -> None:
    write(BLUEROV2.replace("name: bluerov2\n", "name: w\n").replace("{value: 15.22", "{value: -15.22"))
    error = refusal(capsys, "simulate", "vehicle=w", "vehicle.rigid_body.mass.value=-2")
    assert error.startswith("vehicle w: rigid_body.mass.value: -2 kg is out of range")
    mended = ["simulate", "vehicle=w", "vehicle.rigid_body.mass.value=15.22", "duration=0.1", "output=x.csv"]
    assert main(mended) == 0
