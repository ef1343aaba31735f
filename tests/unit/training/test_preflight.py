"""A run that cannot work is refused before anything is written: one line, exit code 2, an empty folder."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

from auvbench.cli import main

needs_casadi = pytest.mark.skipif(importlib.util.find_spec("casadi") is None, reason="MPC needs CasADi")
DIVERGES = ["simulator=gazebo", "simulator.hydrodynamics=published", "vehicle=rexrov"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        pytest.param(["train", "algo=mpc", "vehicle=lrauv"], "rudder", marks=needs_casadi),
        pytest.param(["train", "-m", "algo=pid,mpc", "vehicle=lrauv"], "rudder", marks=needs_casadi),
        pytest.param(["tune", "algo=mpc", "vehicle=lrauv"], "rudder", marks=needs_casadi),
        (["train", "algo=lqr", "vehicle=lrauv"], "rudder"),
        (["train", "algo=pid", *DIVERGES], "2.07"),
        (["train", "-m", "algo=pid,random", *DIVERGES], "2.07"),
    ],
)
def test_what_cannot_work_leaves_nothing_behind(
    arguments: list[str],
    named: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 1
    assert named in said.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("grid", [[], ["-m", "seed=0,1"]])
def test_gazebo_without_its_bindings_leaves_nothing_behind(
    grid: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "gz", None)
    assert main(["train", *grid, "algo=pid", "simulator=gazebo"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
