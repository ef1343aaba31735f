"""A real grid, as typed: 2 algorithms x 2 K x 2 seeds and PID, trained, tested, reported in every format."""

from __future__ import annotations

import csv
import json
from html.parser import HTMLParser
from pathlib import Path

import pytest

from auvbench.cli import main
from tests.conftest import Once

SHORT = [
    "algo.n_envs=8",
    "train.total_steps=256",
    "task.max_steps=60",
    "launcher.workers=2",
    "name=grid",
    "seed=0,1",
    "reward.k=1,100",
]


PPO = ["algo.n_steps=16", "algo.batch_size=64"]
SAC = ["algo.learning_starts=64", "algo.batch_size=32", "algo.gradient_steps=1"]

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def grid(once: Once) -> Path:
    return once("grid", make) / "grid"


def make(folder: Path) -> None:
    out = f"output={folder}"
    assert main(["train", "-m", "algo=ppo", *PPO, *SHORT, out]) == 0
    assert main(["train", "-m", "algo=sac", *SAC, *SHORT, out]) == 0
    assert main(["train", "algo=pid", "seed=0", "name=grid", out]) == 0
    assert main(["evaluate", str(folder), "protocol.episodes=6", "protocol.trajectories=2"]) == 0
    assert main(["report", str(folder / "grid"), "--baseline", "pid", "--study", "thesis"]) == 0


def table(grid: Path) -> list[dict[str, str]]:
    with open(grid / "report" / "table.csv", newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_every_configuration_has_a_row_with_its_seeds(grid: Path) -> None:
    rows = table(grid)
    assert len(rows) == 5
    assert sorted(row["seeds"] for row in rows) == ["0", *["0 1"] * 4]


def test_the_table_says_what_the_episodes_say(grid: Path) -> None:
    for row in table(grid):
        wins = total = 0
        for run in row["runs"].split():
            with open(
                grid / run / "evaluations" / "test" / "episodes.csv", newline="", encoding="utf-8"
            ) as file:
                outcomes = [episode["outcome"] for episode in csv.DictReader(file)]
            wins, total = wins + outcomes.count("success"), total + len(outcomes)
        assert float(row["success_rate"]) == pytest.approx(wins / total)
        low, high = float(row["success_rate_low"]), float(row["success_rate_high"])
        assert 0.0 <= low <= wins / total <= high <= 1.0


def test_pid_is_ranked_first_and_the_formats_agree(grid: Path) -> None:
    rows = table(grid)
    report = grid / "report"
    assert rows[0]["agent"] == "PID"
    markdown = (report / "report.md").read_text(encoding="utf-8")
    tex = (report / "table.tex").read_text(encoding="utf-8")
    page = (report / "index.html").read_text(encoding="utf-8")
    for row in rows:
        for text in (markdown, tex, page):
            assert row["agent"] in text, row["agent"]
    assert r"\toprule" in tex
    assert r"\bottomrule" in tex
    fingerprint = json.loads(
        next(grid.glob("pid-*/evaluations/test/summary.json")).read_text(encoding="utf-8")
    )["fingerprint"]
    for text in (markdown, page):
        assert fingerprint in text
        assert "cannot be said" in text.lower(), "claims on a million steps are not answered by 256"


def test_figures_are_there_in_both_formats(grid: Path) -> None:
    figures = grid / "report" / "figures"
    names = {path.stem for path in figures.glob("*.png")}
    assert names == {path.stem for path in figures.glob("*.svg")}
    assert {"steps_deviation", "success_over_grid"} <= names


def test_the_page_needs_no_network(grid: Path) -> None:
    loaded = []

    class Links(HTMLParser):
        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            names = dict(attrs)
            if tag in ("script", "img", "link", "iframe"):
                loaded.append(names.get("src") or (names.get("href") if tag == "link" else "") or "")

    Links().feed((grid / "report" / "index.html").read_text(encoding="utf-8"))
    assert not [source for source in loaded if source and not source.startswith("data:")]


def test_the_same_sweep_again_starts_nothing(grid: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {path: path.stat().st_mtime_ns for path in grid.glob("*/model/policy.pt")}
    assert len(before) == 8
    assert main(["train", "-m", "algo=ppo", *PPO, *SHORT, f"output={grid.parent}"]) == 0
    assert "complete" in capsys.readouterr().out
    assert before == {path: path.stat().st_mtime_ns for path in grid.glob("*/model/policy.pt")}
