"""`auvbench report --format html` on synthetic experiments."""

from __future__ import annotations

import re
from html import unescape
from pathlib import Path

import pytest

from auvbench.commands.report import main
from tests.synthetic import ROBUSTNESS, damage, set_state, write_experiment


def shown(path: Path) -> str:
    """The page's visible text, about."""
    text = re.sub(r"<(style|script).*?</\1>", " ", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    return re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]+>", " ", text)))


@pytest.mark.slow
def test_report_command_writes_the_page(tmp_path: Path) -> None:
    grid = {"reward_k": (1.0, 40.0), "seeds": (0, 1, 2), "episodes": 30, "train_episodes": 60}
    runs = write_experiment(tmp_path / "grid", **grid)
    set_state(runs[:1], "failed", "the loss is not finite")
    damage(runs[1] / "evaluations" / "test" / "episodes.csv", "column")
    assert main([str(tmp_path / "grid"), "--baseline", "pid", "--format", "html"]) == 0
    page = tmp_path / "grid" / "report" / "index.html"
    text = shown(page)
    for label in ("PID", "SAC K=1", "SAC K=40", "PPO K=40"):
        assert label in text
    assert "from PID" in text
    assert "the loss is not finite" in text
    assert "duration_s" in text  # the column that is gone is named
    assert f"auvbench report {tmp_path / 'grid'} --baseline pid --format html" in text
    assert page.read_text(encoding="utf-8").count('src="data:image/') >= 5
    assert '"episode": 2' in page.read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("condition", ["level=severe", "current=0.5"])
def test_page_of_another_condition_shows_its_paths(tmp_path: Path, condition: str) -> None:
    protocols = {"robustness": ROBUSTNESS}
    write_experiment(tmp_path / "grid", protocols=protocols, seeds=(0,), episodes=12, train_episodes=20)
    options = ["--protocol", "robustness", "--condition", condition, "--format", "html", "--no-figures"]
    assert main([str(tmp_path / "grid"), *options]) == 0
    page = tmp_path / "grid" / "report" / "index.html"
    assert f"condition {condition}" in shown(page)
    assert "† one training seed" in shown(page)
    assert page.read_text(encoding="utf-8").count('"points": "') == 9  # 3 episodes of 3 runs
