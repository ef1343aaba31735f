"""`auvbench bound`: what is typed wrongly is one line, what is there is not computed again."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from auvbench import cli

NEAR = """\
name: near
scenarios: test
episodes: 1
seed: 123
frequency: 10.0
batch: 1
trajectories: 0
overrides: [task=waypoint, "task.waypoint_low=[-4,-4,-24]", "task.waypoint_high=[4,4,-23]", noise=thesis, disturbance=none]
conditions: [{name: nominal}]
"""


@pytest.fixture(autouse=True)
def _there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("conf/protocol").mkdir(parents=True)
    Path("conf/protocol/near.yaml").write_text(NEAR)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["protocl=test"], "did you mean 'protocol'?"),
        (["outputs"], "bound has no such key"),
        (["--forc"], "did you mean '--force'?"),
        (["protocol=tset"], "did you mean 'test'?"),
        (["vehicle=bluerov"], "did you mean 'bluerov2'?"),
        (["vehicle=lrauv", "protocol.episodes=2"], "cover thrusters"),
        (["simulator=gazebo", "protocol.episodes=2"], "bounds use the equations of simulator=fossen"),
        (["protocol=native", "protocol.episodes=2"], "protocol.frequency is not set"),
    ],
)
def test_mistakes_are_one_line(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["bound", *words]) == 2
    captured = capsys.readouterr()
    assert said in captured.err
    assert len(captured.err.splitlines()) == 1
    assert not Path("outputs").exists()


@pytest.mark.slow
def test_without_casadi_the_extra_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "casadi", None)
    assert cli.main(["bound", "protocol=near"]) == 2
    assert "pip install 'auvbench[mpc]'" in capsys.readouterr().err


@pytest.mark.slow
def test_computed_and_not_computed_again(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["bound", "protocol=near", "--workers", "1"]) == 0
    out = capsys.readouterr().out
    assert "mean proven lower bound" in out
    assert "wrote outputs/bounds/near-bluerov2_2026" in out
    before = Path("outputs/bounds/near-bluerov2_2026/bounds.jsonl").stat().st_mtime_ns
    assert cli.main(["bound", "protocol=near"]) == 0
    assert "exist already" in capsys.readouterr().out
    assert Path("outputs/bounds/near-bluerov2_2026/bounds.jsonl").stat().st_mtime_ns == before


def test_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["bound", "--help"]) == 0
    assert "usage: auvbench bound" in capsys.readouterr().out
