"""Success by condition: the rates are those of the episodes, and every format shows all of them."""

import csv as csv_module
import doctest
import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from auvbench.analysis import conditions
from auvbench.analysis.load import agents, load
from auvbench.analysis.ranking import rank
from auvbench.analysis.records import Ranking
from auvbench.commands.report import main
from auvbench.reporting import tables
from auvbench.reporting.tables.table import Table
from auvbench.statistics import wilson
from tests.paper import compile_article, needs_pdflatex
from tests.synthetic import FREQUENCY_SWEEP, ROBUSTNESS, write_experiment


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("runs") / "grid"
    protocols = {"test": ("nominal",), "robustness": ROBUSTNESS, "frequency_sweep": FREQUENCY_SWEEP}
    write_experiment(root, algorithms=("ppo", "pid"), episodes=15, train_episodes=0, protocols=protocols)
    return root


def ranked(grid: Path, protocol: str = "robustness") -> Ranking:
    runs, _ = load([grid], protocol)
    condition = conditions.default(runs, protocol)
    return rank(
        agents(runs, protocol=protocol, condition=condition)[0], protocol=protocol, condition=condition
    )


def shown(ranking: Ranking) -> Table:
    (table,) = tables.conditions_tables(ranking)
    return table


def test_examples_of_the_docstrings() -> None:
    result = doctest.testmod(conditions)
    assert result.attempted > 0
    assert result.failed == 0


@pytest.mark.slow
def test_the_rates_are_those_of_the_episodes(grid: Path) -> None:
    ranking = ranked(grid)
    assert tuple(c.name for c in ranking.conditions) == ROBUSTNESS
    for folder in grid.glob("*"):
        summary = json.loads((folder / "evaluations" / "robustness" / "summary.json").read_text())
        if folder.name.startswith("pid"):
            for shown, c in zip(ranking.conditions, summary["conditions"], strict=True):
                e = shown.success["PID"]
                assert e.value == pytest.approx(c["success_rate"])
                assert [e.low, e.high] == pytest.approx(np.array(wilson(15 * c["success_rate"], 15)))
    nominal = next(c for c in ranking.conditions if c.name == ranking.condition)
    assert nominal.success == {row.label: row.estimates["success_rate"] for row in ranking.rows}


def test_changes_are_paired_by_seed_and_scenario(tmp_path: Path) -> None:
    """Against the table of each run, computed apart: successes and PAR-1 steps under a condition less those undisturbed."""
    grid = tmp_path / "grid"
    conditions_of = {"robustness": ("nominal", "current=0.5", "current=1")}
    write_experiment(grid, algorithms=("ppo", "pid"), episodes=15, train_episodes=30, protocols=conditions_of)
    ranking = ranked(grid)
    assert ranking.conditions[0].name == conditions.UNDISTURBED
    assert not ranking.conditions[0].success_change
    assert not ranking.conditions[0].par1_change
    rows: dict[str, list[pd.DataFrame]] = {}
    for folder in sorted(grid.glob("*")):
        frame = pd.read_csv(folder / "evaluations/robustness/episodes.csv")
        frame["success"] = (frame["outcome"] == "success").astype(float)
        frame["par1"] = frame["steps"].where(frame["success"] > 0, 1000.0)
        wide = frame.pivot_table(index="episode", columns="condition", values=["success", "par1"])
        rows.setdefault("PID" if folder.name.startswith("pid") else "PPO", []).append(wide)
    for condition in ranking.conditions[1:]:
        for label, tables_of in rows.items():
            for kind, found in (("success", condition.success_change), ("par1", condition.par1_change)):
                means = [(t[kind][condition.name] - t[kind]["nominal"]).mean() for t in tables_of]
                (e,) = [e for name, e in found.items() if name.startswith(label)]
                assert e.value == pytest.approx(np.mean(means))
                assert e.low < e.value < e.high or (kind == "success" and abs(e.value) == 1)
    # One agent that does not learn: Student's t over the scenarios.
    wide = rows["PID"][0]["par1"]
    changes = (wide["current=1"] - wide["nominal"]).to_numpy()
    e = next(c for c in ranking.conditions if c.name == "current=1").par1_change["PID"]
    half = 2.144787 * changes.std(ddof=1) / np.sqrt(15)  # t(14), 97.5 %
    assert [e.low, e.high] == pytest.approx([changes.mean() - half, changes.mean() + half], rel=1e-5)


def test_where_no_scenario_changes_hands_a_change_may_have_gone_unseen() -> None:
    found = conditions._changes({"PID": np.zeros((1, 200)), "PPO": np.zeros((3, 200))}, 0.95, rate=True)
    for e in found.values():
        assert (e.value, -e.low, e.high) == pytest.approx((0.0, 0.018845, 0.018845), abs=1e-6)
    assert conditions._changes({}, 0.95) == {}


def test_steps_at_other_frequencies_are_not_compared(grid: Path) -> None:
    met = conditions.Met(np.ones((1, 3)), np.array([[5.0, 6.0, 7.0]]), (10.0, 1000.0))
    faster = conditions.Met(np.ones((1, 3)), np.array([[9.0, 9.0, 9.0]]), (25.0, 1000.0))
    tested = {
        "PPO": {"nominal": met, "frequency=25": faster},
    }
    found = conditions._condition("frequency=25", tested, 0.95)
    assert found.success_change.keys() == {"PPO"}
    assert found.par1_change == {}
    two = conditions.Met(np.ones((2, 3)), np.ones((2, 3)), (10.0, 1000.0))
    half = {"PPO": {"nominal": two, "frequency=25": faster}}  # a seed that did not meet it
    assert conditions._condition("frequency=25", half, 0.95).success_change == {}


def test_a_protocol_of_one_condition_has_no_table(grid: Path) -> None:
    ranking = ranked(grid, "test")
    assert ranking.conditions == ()
    assert tables.conditions_tables(ranking) == []
    assert tables.in_print(None, "conditions") == ""
    assert tables.conditions_csv(ranking) == ""


def test_without_a_nominal_condition_the_first_is_ranked(grid: Path, tmp_path: Path) -> None:
    assert (
        main(
            [
                str(grid),
                "--protocol",
                "frequency_sweep",
                "--format",
                "md",
                "--no-figures",
                "--out",
                str(tmp_path),
            ]
        )
        == 0
    )
    text = (tmp_path / "report.md").read_text()
    assert "condition frequency=10," in text
    assert "| frequency (10 Hz) | frequency (25 Hz) | frequency (55 Hz) |" in text


def test_an_agent_without_a_condition_has_a_dash(grid: Path) -> None:
    ranking = ranked(grid)
    last = ranking.conditions[-1].success
    assert isinstance(last, dict)
    del last["PID"]
    line = next(x for x in shown(ranking).lines if x.cells[0].value == "PID")
    assert line.cells[-1].text == "–"


@pytest.mark.parametrize("width", [60, 80, 200])
def test_a_screen_shows_or_names_every_condition(grid: Path, width: int) -> None:
    console = Console(width=width, file=io.StringIO(), record=True)
    console.print(tables.TableView(shown(ranked(grid))))
    text = console.export_text()
    assert max(map(len, text.splitlines())) <= width
    text = " ".join(text.split())
    assert text.count("current") == 4
    assert all(level in text for level in ("0.25 m/s", "× 1.3", "dead-thruster", "severe"))


def test_files_show_every_condition(grid: Path) -> None:
    ranking = ranked(grid)
    text = tables.pipes(shown(ranking))
    assert len({line.count("|") for line in text.splitlines() if line.startswith("|")}) == 1
    assert text.splitlines()[0].count("|") == 1 + 1 + len(ROBUSTNESS)
    print_ = tables.in_print(shown(ranking), "conditions")
    assert print_.count(r"\begin{table}") == print_.count(r"\end{table}") == 1
    assert print_.count("current") == 4
    assert r"$\times$ 1.3" in print_
    rows = list(csv_module.DictReader(io.StringIO(tables.conditions_csv(ranking))))
    assert len(rows) == len(ranking.rows) * len(ROBUSTNESS)
    assert rows[0]["agent"] == ranking.rows[0].label
    assert {row["task"] for row in rows} == {"waypoint"}
    docked = tables.conditions_csv(replace(ranking, task="docking"))
    assert {row["task"] for row in csv_module.DictReader(io.StringIO(docked))} == {"docking"}


@needs_pdflatex
def test_the_tables_for_a_paper_fit_its_width(grid: Path, tmp_path: Path) -> None:
    assert "Overfull" not in compile_article(tmp_path, tables.in_print(shown(ranked(grid)), "conditions"))


@pytest.mark.slow
def test_a_later_report_leaves_no_table_of_conditions_behind(grid: Path, tmp_path: Path) -> None:
    options = [str(grid), "--format", "csv,tex", "--out", str(tmp_path)]
    assert main([*options, "--protocol", "robustness"]) == 0
    names = {"conditions.csv", "conditions.tex"}
    assert names <= {path.name for path in tmp_path.iterdir()}
    assert main(options) == 0
    assert not names & {path.name for path in tmp_path.iterdir()}


@pytest.mark.slow
def test_the_page_shows_them_too(grid: Path, tmp_path: Path) -> None:
    options = ["--format", "html", "--no-figures", "--out", str(tmp_path)]
    for protocol, shown in (("robustness", True), ("test", False)):
        assert main([str(grid), "--protocol", protocol, *options]) == 0
        html = (tmp_path / "index.html").read_text(encoding="utf-8")
        assert ('id="conditions-table"' in html) == shown
        assert ('href="#conditions"' in html) == shown


def test_the_measure_of_a_task_is_there_under_each_condition(tmp_path: Path) -> None:
    grid = tmp_path / "grid"
    protocols = {"robustness": ("nominal", "current=0.5")}
    write_experiment(grid, algorithms=("ppo", "pid"), episodes=15, train_episodes=0, protocols=protocols)
    runs, _ = load([grid], "robustness")
    found = rank(agents(runs, protocol="robustness")[0], rank_by="mean_energy_J", protocol="robustness")
    rows = list(csv_module.DictReader(io.StringIO(tables.text_formats.conditions_csv(found))))
    for row in rows:
        (agent,) = [r for r in found.rows if r.label == row["agent"]]
        frames = [pd.read_csv(grid / run / "evaluations/robustness/episodes.csv") for run in agent.run_ids]
        means = [f[f["condition"] == row["condition"]]["energy_J"].mean() for f in frames]
        assert float(row["mean_energy_J"]) == pytest.approx(np.mean(means))
        assert (
            float(row["mean_energy_J_low"]) < float(row["mean_energy_J"]) < float(row["mean_energy_J_high"])
        )
    assert len(rows) == 2 * len(found.rows)
    _, measured = tables.conditions_tables(found)
    assert measured.title == "Energy (kJ) under each condition of protocol robustness"
    for row, line in zip(found.rows, measured.lines, strict=True):
        value = next(r for r in rows if r["agent"] == row.label and r["condition"] == "nominal")
        assert float(line.cells[1].value) == pytest.approx(float(value["mean_energy_J"]) / 1000, rel=0.05)
    assert "mean_energy_J" not in tables.text_formats.conditions_csv(ranked(grid))
