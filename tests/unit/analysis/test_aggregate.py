"""Agents over all conditions and vehicles: one row each, against a computation from the scores by hand."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from auvbench import cli
from auvbench.analysis.aggregate import across
from auvbench.analysis.load import agents, load
from auvbench.analysis.sections import sections
from tests.synthetic import ROBUSTNESS, set_state, write_experiment

PROTOCOL = "robustness"
CONDITIONS = ROBUSTNESS[:3]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("across") / "grid"
    for vehicle, algorithms, seeds in (
        ("bluerov2", ("ppo", "sac", "pid"), (0, 1, 2)),
        ("rexrov", ("ppo", "pid"), (0, 1)),
    ):
        write_experiment(
            root / vehicle,
            algorithms=algorithms,
            seeds=seeds,
            episodes=20,
            train_episodes=10,
            protocols={PROTOCOL: CONDITIONS},
            vehicle=vehicle,
        )
    return root


def tables(folder: Path):
    runs, _ = load([folder], PROTOCOL)
    parts = sections(runs, PROTOCOL)
    return across([(p.title, agents(p.runs, protocol=PROTOCOL)[0]) for p in parts], PROTOCOL, 0.95)


def scores(folder: Path, vehicle: str, algo: str) -> np.ndarray:
    """(seeds, conditions) from the files alone."""
    rows = []
    for run in sorted((folder / vehicle).glob(f"{algo}-*")):
        frame = pd.read_csv(run / "evaluations" / PROTOCOL / "episodes.csv")
        rows.append([(frame[frame.condition == c].outcome == "success").mean() for c in CONDITIONS])
    return np.array(rows)


def test_a_row_is_an_agent_over_all_its_tasks(folder: Path) -> None:
    table = tables(folder)
    assert table.sections == ("vehicle bluerov2", "vehicle rexrov")
    assert table.tasks == 6
    rows = {row.label: row for row in table.rows}
    assert set(rows) == {"PPO", "SAC", "PID"}
    both = np.concatenate([scores(folder, v, "ppo").ravel() for v in ("bluerov2", "rexrov")])
    cut = len(both) // 4
    ppo = rows["PPO"]
    assert ppo.trainings == (3, 2)
    assert ppo.tasks == 6
    assert ppo.iqm.value == pytest.approx(np.sort(both)[cut : len(both) - cut].mean())
    assert ppo.gap.value == pytest.approx(1 - both.mean())
    assert ppo.iqm.low <= ppo.iqm.value <= ppo.iqm.high
    assert table.uneven
    assert np.isnan(rows["PID"].iqm.low), "nothing to train"
    assert rows["SAC"].trainings == (3, 0)


def test_who_met_fewer_tasks_stands_last(folder: Path) -> None:
    table = tables(folder)
    assert [row.label for row in table.rows][-1] == "SAC"
    assert [row.tasks for row in table.rows] == [6, 6, 3]
    assert table.rows[0].iqm.value >= table.rows[1].iqm.value


@pytest.mark.slow
def test_the_command_writes_it_and_a_later_one_takes_it_away(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "report"
    told = ["report", str(folder), "--protocol", PROTOCOL, "--out", str(out), "--no-figures"]
    assert cli.main([*told, "--across"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "over all tasks" in shown
    assert "Success over 6 tasks: every condition of protocol robustness, in 2 sections" in shown
    rows = {row["agent"]: row for row in csv.DictReader((out / "across.csv").open())}
    ppo = next(row for row in tables(folder).rows if row.label == "PPO")
    assert float(rows["PPO"]["iqm_success"]) == ppo.iqm.value
    assert rows["PID"]["iqm_success_low"] == ""
    assert rows["SAC"]["seeds: vehicle rexrov"] == "0"
    assert "## Over all tasks" in (out / "report.md").read_text()
    assert 'id="over-title"' in (out / "index.html").read_text()
    assert r"\toprule" in (out / "across.tex").read_text()
    assert cli.main(told) == 0
    assert not (out / "across.csv").exists()
    assert not (out / "across.tex").exists()
    assert "Over all tasks" not in (out / "index.html").read_text()


def test_one_section_has_its_conditions_as_tasks(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "report"
    told = ["report", str(folder / "bluerov2"), "--protocol", PROTOCOL, "--out", str(out), "--no-figures"]
    assert cli.main([*told, "--across"]) == 0
    assert "in one section" in " ".join(capsys.readouterr().out.split())
    assert 'id="over-title"' in (out / "index.html").read_text()


def test_a_training_that_failed_succeeds_at_no_task(tmp_path: Path) -> None:
    runs = write_experiment(
        tmp_path / "grid", algorithms=("ppo",), seeds=(0, 1), episodes=20, protocols={PROTOCOL: CONDITIONS}
    )
    before = tables(tmp_path).rows[0].gap.value
    set_state(runs[:1], "failed", "loss is nan")
    manifest = json.loads((runs[0] / "manifest.json").read_text())
    assert manifest["state"] == "failed"
    (row,) = tables(tmp_path).rows
    assert row.trainings == (2,)
    assert row.gap.value > max(before, 0.5)
