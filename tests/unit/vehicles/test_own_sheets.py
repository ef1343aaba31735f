"""Sheets in ./conf/vehicle that cannot be read: each is told file and line, and none hides the others."""

from __future__ import annotations

from pathlib import Path

import pytest

from auvbench.cli import main


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
    assert main(["vehicles", "--json"]) == 0
    return capsys.readouterr().out


def test_defaults_that_loop(capsys: pytest.CaptureFixture[str]) -> None:
    write("name: w\ndefaults: [w, _self_]\n")
    write("defaults: [b]\nname: a\n", "a")
    write("defaults: [a]\nname: b\n", "b")
    assert refusal(capsys, "vehicles", "w") == (
        "conf/vehicle/w.yaml line 2: defaults: 'w' inherits from itself (conf/vehicle/w.yaml -> conf/vehicle/w.yaml);"
        " name another sheet"
    )
    assert refusal(capsys, "vehicles", "conf/vehicle/w.yaml").startswith("conf/vehicle/w.yaml line 2: ")
    assert refusal(capsys, "vehicles", "a").startswith("conf/vehicle/b.yaml line 1: defaults: 'a' inherits")
    out = listed(capsys)
    assert out.count("inherits from itself") == 3
    assert "rexrov" in out


def test_a_missing_base_is_told_at_the_sheet_that_names_it(capsys: pytest.CaptureFixture[str]) -> None:
    write("name: w\ndefaults: [bluerov9, _self_]\n")
    error = refusal(capsys, "vehicles", "w")
    assert error.startswith(
        "conf/vehicle/w.yaml line 2: defaults: vehicle 'bluerov9' is not known; did you mean"
    )
