"""A report's parts made from synthetic runs, for the tests of the page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from auvbench.analysis import grouping, load, thesis
from auvbench.analysis.grouping import Section
from auvbench.analysis.ranking import rank
from auvbench.analysis.records import Agent, ClaimVerdict, Finding, Problem, Report, RunRecord
from auvbench.reporting import page
from auvbench.reporting.figures import Figure
from tests.synthetic import write_experiment

PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
EVIL = '</script><script>window.broken=1</script><img src=x onerror="window.broken=1">'


def parts(folder: Path, **grid: Any) -> dict[str, Any]:
    """Arguments of `write` for a synthetic experiment under `folder`."""
    write_experiment(folder / "grid", **grid)
    runs, problems = load.load([folder / "grid"])
    agents, more = grouping.agents(runs)
    ranking = rank(agents, problems=[*problems, *more])
    by_label = {agent.label: agent for agent in agents}
    return {
        "ranking": ranking,
        "agents": [by_label[row.label] for row in ranking.rows],
        "runs": runs,
        "figures": figures(folder / "report" / "figures"),
        "findings": findings(agents),
        "claims": claims(runs),
        "comparison": thesis.compare(agents),
        "command": "auvbench report outputs/grid --rank-by success_rate --baseline PID --format html",
    }


def write(path: Path, *, command: str = "", figures: Sequence[Figure] = (), **given: Any) -> Path:
    """Write the page of runs; `given` are fields of the report."""
    section = Section("vehicle bluerov2", "bluerov2", "bluerov2", "", tuple(given.pop("runs")))
    return page.write(path, Report(section=section, **given), figures, command=command)


def figures(folder: Path, count: int = 2) -> list[Figure]:
    """Small real figures on disk."""
    mpl.use("agg")
    from matplotlib.figure import Figure as Drawing

    folder.mkdir(parents=True, exist_ok=True)
    made = []
    for number in range(count):
        drawing = Drawing(figsize=(5, 3), layout="constrained")
        axes = drawing.subplots()
        axes.plot(np.arange(10), np.arange(10) ** (number + 1), color=PALETTE[number % len(PALETTE)])
        axes.set(xlabel="training steps", ylabel="episode length")
        files = [folder / f"figure{number}.{kind}" for kind in ("png", "svg")]
        for file in files:
            drawing.savefig(file, metadata={"Date": None} if file.suffix == ".svg" else None)
        caption = "What one sees here is drawn for a test; the band would show the training seeds."
        made.append(Figure(f"figure{number}", f"Training length {number + 1}", caption, files[0], files[1]))
    return made


def findings(agents: Sequence[Agent]) -> list[Finding]:
    """Return more findings than a page shows at once."""
    best = max(agents, key=lambda a: a.success.mean())
    ids = tuple(run.id for run in best.runs)
    many = tuple(run.id for agent in agents for run in agent.runs)
    return [
        Finding("effect", f"{best.label} is better than the others: -4 points [-6, -2].", run_ids=ids),
        Finding("effect", "Two agents differ.", basis="Holm over 3 effects", run_ids=many),
        *(Finding("seed_variance", f"Finding number {i}.") for i in range(3, 8)),
    ]


def claims(runs: Sequence[RunRecord]) -> list[ClaimVerdict]:
    return [
        ClaimVerdict(
            "A lower step frequency converges in fewer training steps.", "holds", "ratio 0.61 [0.52, 0.71]"
        ),
        ClaimVerdict(
            "A larger K raises the reward and not success.", "does not hold", "slope 0.02 [-0.01, 0.05]"
        ),
        ClaimVerdict(
            "In training at 55 Hz the agent does not converge.",
            "cannot be said",
            missing="runs at 55 Hz",
            run_ids=(runs[0].id,),
        ),
    ]


def hostile_problem() -> Problem:
    return Problem(EVIL, "failed", EVIL)
