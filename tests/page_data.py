"""A report's parts made from synthetic runs, for the tests of the page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from auvbench.analysis import grouping, load, study
from auvbench.analysis.effects import learns
from auvbench.analysis.model import Agent, Comparison, Finding, Problem, Ranking, Row, RunRecord
from auvbench.analysis.policies import one_policy
from auvbench.reporting.figures import Figure
from auvbench.statistics.estimate import Estimate
from tests.synthetic import write_experiment

PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
LINES = ("-", "--", "-.", ":")
EVIL = '</script><script>window.broken=1</script><img src=x onerror="window.broken=1">'


def parts(folder: Path, **grid: Any) -> dict[str, Any]:
    """Keyword arguments of `page.write` for a synthetic experiment under `folder`."""
    write_experiment(folder / "grid", **grid)
    runs, problems = load.load([folder / "grid"])
    agents, more = grouping.agents(runs)
    return {
        "ranking": rank_by_hand(agents),
        "agents": agents,
        "runs": runs,
        "problems": [*problems, *more],
        "figures": figures(folder / "report" / "figures"),
        "colours": colours(agents),
        "findings": findings(agents),
        "claims": claims(runs),
        "beside": study.beside(agents),
        "command": "auvbench report outputs/grid --rank-by success_rate --baseline PID --format html",
    }


def colours(agents: Sequence[Agent]) -> dict[str, tuple[str, str, str]]:
    return {
        agent.label: (PALETTE[i % len(PALETTE)], "o", LINES[(i // len(PALETTE)) % len(LINES)])
        for i, agent in enumerate(agents)
    }


def rank_by_hand(agents: Sequence[Agent], baseline: str | None = None) -> Ranking:
    """A ranking with normal intervals: plausible for a drawing, no statistics."""
    order = sorted(agents, key=lambda a: -a.success.mean())
    rows = tuple(_row(agent, place, len(order)) for place, agent in enumerate(order, start=1))
    first = order[-1].label if baseline is None else baseline
    comparisons = tuple(
        Comparison(
            agent.label,
            first,
            "success_rate",
            Estimate(d := float(agent.success.mean() - order[-1].success.mean()), d - 0.03, d + 0.03),
            0.5 / (1 + 500 * d),
            min(1.0, 1.0 / (1 + 500 * d)),
            Estimate(0.5 + d / 2, 0.48 + d / 2, min(1.0, 0.52 + d / 2)),
        )
        for agent in order[:-1]
    )
    n = len(order)
    return Ranking(
        rows,
        "success_rate",
        "mean_steps",
        "test",
        "nominal",
        order[0].fingerprint,
        0.95,
        first,
        comparisons,
        np.full((n, n), 0.5),
    )


def _row(agent: Agent, place: int, count: int) -> Row:
    estimates = {
        f"{name}_rate": _estimate(np.asarray(agent.outcome == code, float))
        for code, name in enumerate(("success", "collision", "timeout"))
    }
    estimates |= {f"mean_{name}": _estimate(values) for name, values in agent.metrics.items()}
    interval = (max(1, place - 1), min(count, place + 1))
    seeds = tuple(run.seed for run in agent.runs)
    ids = tuple(run.id for run in agent.runs)
    return Row(
        agent.label,
        agent.key,
        seeds,
        ids,
        agent.outcome.shape[1],
        place,
        interval,
        "abcdefghijklmnopqrstuvwxyz"[(place // 2) % 26],
        estimates,
        learns(agent),
        not one_policy(agent),
    )


def _estimate(values: np.ndarray) -> Estimate:
    mean, half = float(values.mean()), 1.96 * float(values.std()) / np.sqrt(values.size)
    low, high = mean - half, mean + half
    return Estimate(mean, max(0.0, low), min(1.0, high) if mean <= 1 else high)


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
    best = max(agents, key=lambda a: a.success.mean())
    rate = 100 * best.success.mean()
    return [
        Finding(
            f"{best.label} ranks first: it reaches the waypoint in {rate:.1f} % of the test episodes.",
            run_ids=tuple(run.id for run in best.runs),
        ),
        Finding(
            "The first two agents are not resolved from each other.",
            statistic="difference 1.2 points, 95 % interval −0.8 to 3.1, adjusted p = 0.42",
            run_ids=tuple(run.id for agent in agents for run in agent.runs),
        ),
    ]


def claims(runs: Sequence[RunRecord]) -> list[Finding]:
    return [
        Finding(
            "A lower step frequency converges in fewer training steps.", "holds", "ratio 0.61 [0.52, 0.71]"
        ),
        Finding("A larger K raises the reward and not success.", "does not hold", "slope 0.02 [-0.01, 0.05]"),
        Finding(
            "In training at 55 Hz the agent does not converge.",
            "cannot be said",
            missing="runs at 55 Hz",
            run_ids=(runs[0].id,),
        ),
    ]


def hostile_problem() -> Problem:
    return Problem(EVIL, "failed", EVIL)
