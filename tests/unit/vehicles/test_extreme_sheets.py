"""Sheets with numbers that no vehicle has: bounded, and one line where nothing can be computed with them."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest
import yaml

from auvbench import cli
from auvbench.errors import VehicleError
from auvbench.vehicles import sheet
from auvbench.vehicles.reader import read
from tests.fuzz.harness import judge

LAUGHS = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]\n" for n in range(1, 12)
)


def scaled(node: Any, factor: float) -> Any:
    if isinstance(node, dict):
        return {key: scaled(child, factor) for key, child in node.items()}
    if isinstance(node, list):
        return [scaled(child, factor) for child in node]
    return node * factor if isinstance(node, int | float) and not isinstance(node, bool) else node


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1e12, 1e-12, 1e300])
@pytest.mark.parametrize("part", ["hydrodynamics", "rigid_body", "buoyancy", "actuators", ""])
def test_numbers_of_another_world_do_not_hang(
    part: str,
    factor: float,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    data = copy.deepcopy(read("bluerov2").data)
    sheet = {key: scaled(child, factor) if part in ("", key) else child for key, child in data.items()}
    path = tmp_path / "conf" / "vehicle" / "w.yaml"
    path.parent.mkdir(parents=True)
    path.write_text(yaml.safe_dump(sheet))
    for command in (["vehicles", "w"], ["vehicles", str(path)]):
        judge(command)


@pytest.mark.slow
def test_damping_that_no_step_resolves_is_refused_before_a_run_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    data = copy.deepcopy(read("bluerov2").data)
    damping = data["hydrodynamics"]["linear_damping"]
    data["hydrodynamics"]["linear_damping"] = scaled(damping, 1e12)
    path = tmp_path / "conf" / "vehicle" / "w.yaml"
    path.parent.mkdir(parents=True)
    path.write_text(yaml.safe_dump(data))
    assert cli.main(["train", "vehicle=w", "algo=random"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "s, must be at least" in error
    assert not (tmp_path / "outputs").exists()


def test_a_pace_that_is_no_number_is_refused() -> None:
    sheet.refuse_stiff_vehicle("x", 0.004)
    sheet.refuse_stiff_vehicle("x", float("inf"))
    for wrong in (1e-9, 0.0, float("nan")):
        with pytest.raises(VehicleError):
            sheet.refuse_stiff_vehicle("x", wrong)


@pytest.mark.parametrize("text", [LAUGHS, "a: " + "[" * 100_000, "- " * 50_000])
def test_a_sheet_without_end_is_one_line(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "conf" / "vehicle" / "w.yaml"
    path.parent.mkdir(parents=True)
    path.write_text(text)
    for command in (
        ["vehicles", "w"],
        ["vehicles", str(path)],
        ["simulate", "vehicle=w"],
        ["train", "vehicle=w"],
    ):
        assert cli.main(command) == 2
        assert capsys.readouterr().err.count("\n") == 1
