"""Success on validation scenarios: as many lines as agents that were watched, damage named."""

from __future__ import annotations

from pathlib import Path

from auvbench.analysis.load import agents, load
from auvbench.analysis.ranking import rank
from auvbench.reporting.figures import style
from auvbench.reporting.figures.scene import Scene, scene
from auvbench.reporting.figures.training import validation
from tests.synthetic import write_experiment

HEADER = "step,simulated_s,training_episodes,fingerprint,episodes,success_rate,wall_s\n"


def built(root: Path, rows: list[str]) -> Scene:
    for run in write_experiment(root, algorithms=("ppo", "pid"), seeds=(0, 1), episodes=10):
        if "ppo" in run.name:
            (run / "train" / "validation.csv").write_text(HEADER + "\n".join(rows) + "\n")
    found = agents(load([root])[0])[0]
    return scene(found, rank(found))


def test_success_over_steps(tmp_path: Path) -> None:
    drawn_from = built(tmp_path, ["1000,40,3,abc,100,0.2,5.0", "2000,80,6,abc,100,0.9,11.0"])
    with style.styled():
        drawing = validation(drawn_from)
    assert drawing is not None
    (ax,) = drawing.canvas.axes
    assert ax.get_xlabel() == "environment steps"
    (line,) = ax.get_lines()
    x, y = line.get_xdata(), line.get_ydata()
    assert (x[0], x[-1], y[0], y[-1]) == (0, 2000, 0, 90)
    assert "which no test shares" in drawing.caption
    assert not drawn_from.problems


def test_damage_is_named_and_nothing_is_drawn(tmp_path: Path) -> None:
    drawn_from = built(tmp_path, ["2000,40,3,abc,100,0.2,5.0", "1000,80,6,abc,100,1.9,11.0"])
    with style.styled():
        assert validation(drawn_from) is None
    assert len(drawn_from.problems) == 2
    assert "train/validation.csv must have rising steps" in drawn_from.problems[0].message
