"""Draw the figures of training: success, validation, episode length and return over steps."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from auvbench.analysis.damage import Damage
from auvbench.analysis.recorded import read_validation_curve
from auvbench.analysis.records import Agent, RunRecord
from auvbench.reporting.figures import style
from auvbench.reporting.figures.scene import (
    Curve,
    Drawing,
    Scene,
    band,
    lines_sentence,
    middle,
    shown,
    wants_symlog,
)

FEW = 4
"""largest number of agents in one panel; if there are more, each agent has its own panel"""
MOST = 12
"""largest number of agents with a panel"""
GREY = "#c4c9cc"
SPANS = 30
"""largest number of spans into which the steps of a training are divided"""
FEWEST_SPANS = 2


def success(scene: Scene) -> Drawing | None:
    """Draw the share of training episodes that reached the goal, over environment steps."""
    caption = f"Share of the training episodes that reached the goal, in up to {SPANS} equal spans of environment steps"
    more = " Training explores: these episodes are not the test."
    rows = {"success": "success (%)"}
    return _over_steps(scene, rows, "Training: success over steps", caption, more, dots=True)


def length_and_return(scene: Scene) -> Drawing | None:
    """Draw mean episode length and return over environment steps (original study, figures 3.1 and 3.7)."""
    caption = (
        f"Mean episode length and return during training, in up to {SPANS} equal spans of environment steps"
    )
    rows = {"steps": "steps per episode", "return": "return per episode"}
    return _over_steps(scene, rows, "Training: episode length and return", caption, "", dots=False)


def _over_steps(
    scene: Scene, rows: Mapping[str, str], title: str, caption: str, more: str, *, dots: bool
) -> Drawing | None:
    """Draw columns of the training records over environment steps.

    Args:
        scene: scene of the report.
        rows: axis label by column; each column has a row of panels.
        title: title of the figure.
        caption: beginning of the caption.
        more: end of the caption.
        dots: whether to draw a dot for each value of each seed.

    Returns:
        Figure; None without training records.
    """
    learners = scene.learners()
    best = scene.top(MOST, learners)
    chosen = scene.trained(best)
    if not chosen:
        return None
    curves = {name: [binned(scene, agent, name) for agent in chosen] for name in rows}
    log = "return" in curves and wants_symlog([y for _, y in curves["return"]])
    together = len(chosen) <= FEW
    columns = 1 if together else _columns(len(chosen))
    height = len(rows) * (1 if together else -(-len(chosen) // columns))
    figure = style.canvas(*((6.6, 2.8 * height + 0.6) if together else (2.7 * columns, 1.9 * height + 0.4)))
    grid = figure.subplots(height, columns, squeeze=False, sharex=True)
    for ax in grid.flat:
        ax.set_visible(False)
    for i, agent in enumerate(chosen):
        place = 0 if together else i
        panels = grid[place // columns * len(rows) :, place % columns][: len(rows)]
        for ax, first, (name, label) in zip(panels, grid[:, 0], rows.items(), strict=False):
            ax.set_visible(True)
            if ax is not first:
                ax.sharey(first)
            if not together:
                for x, y in curves[name][:i] + curves[name][i + 1 :]:
                    ax.plot(x, middle(y), color=GREY, linewidth=0.9, zorder=1)
            band(ax, scene.looks[agent.label], curves[name][i], dots=dots)
            ax.tick_params(labelleft=place % columns == 0, labelbottom=False)
            style.engineering(ax.xaxis)
            if place % columns == 0:
                ax.set_ylabel(label)
            if name == "success":
                ax.set_ylim(-2, 102)
            if name == "return" and log:
                style.symlog(ax)
        if together or i + columns >= len(chosen):
            ax.tick_params(labelbottom=True)
            ax.set_xlabel("environment steps")
        if not together:
            style.title(panels[0], agent.label)
    if together:
        style.legend(figure, scene.looks_of(chosen), markers=False)
    caption += (
        ", none shorter than the longest episode of all environments together while at least two are left."
        + more
        + lines_sentence(chosen, dots=dots)
        + ("" if together else " In grey behind each agent: the others.")
        + shown(best, learners)
        + (
            " The return's axis is linear up to ±1000 and logarithmic beyond, since K scales it."
            if log
            else ""
        )
    )
    return Drawing(figure, title, caption)


def _columns(n: int) -> int:
    """Return the number of columns of a grid of n panels, chosen so that the last row is not nearly empty."""
    return 3 if n in (5, 6, 9) else 4


def binned(scene: Scene, agent: Agent, column: str) -> Curve:
    """Return means of a column of the training records over spans of environment steps.

    A mean covers the episodes that end in a span, and is NaN if no episode ends in the span. The column `success` is
    100 for an episode that reached the goal, else 0.

    A span is at least as long as the longest episode times the number of environments, unless this leaves fewer
    than `FEWEST_SPANS` spans. In a shorter span, all long episodes or none might end, because environments that
    start together end their long episodes together.

    Returns:
        Centres (B,) of the spans in steps, and means (seeds, B).
    """
    with_frames = [(f, run) for run in agent.runs if (f := scene.training(run)) is not None]
    frames = [f for f, _ in with_frames]
    last = min(int(f["step"].iloc[-1]) for f in frames)  # last step that all seeds reached
    longest = max(float(f["steps"].max()) * _environments(run) for f, run in with_frames)
    bins = int(np.clip(min(min(len(f) for f in frames) // 5, last // max(longest, 1.0)), FEWEST_SPANS, SPANS))
    edges = np.linspace(0, last, bins + 1)
    rows = []
    for frame in frames:
        values = 100.0 * (frame["outcome"] == "success") if column == "success" else frame[column]
        spans = pd.cut(frame["step"], edges.tolist(), labels=False)
        rows.append(values.groupby(spans).mean().reindex(range(bins)).to_numpy(np.float64))
    return (edges[1:] + edges[:-1]) / 2, np.array(rows)


def _environments(run: RunRecord) -> int:
    n = run.config.get("algo.n_envs")
    return n if type(n) is int and n > 0 else 1


def validation(scene: Scene) -> Drawing | None:
    """Draw success on the validation scenarios over environment steps."""
    curves: dict[str, list[pd.DataFrame]] = {}
    for agent in scene.learners():
        for run in agent.runs:
            try:
                rows = read_validation_curve(run)
            except Damage as damage:
                scene.problem(run, damage)
                continue
            if rows is not None:
                curves.setdefault(agent.label, []).append(rows)
    validated = [agent for agent in scene.learners() if agent.label in curves]
    if not validated:
        return None
    chosen = scene.top(6, validated)
    figure = style.canvas(6.6, 3.4)
    ax = figure.subplots()
    for agent in chosen:
        runs = curves[agent.label]
        grid = np.linspace(0, min(float(curve["step"].iloc[-1]) for curve in runs), 60)
        y = [np.interp(grid, [0.0, *c["step"]], [0.0, *(100 * c["success_rate"])]) for c in runs]
        band(ax, scene.looks[agent.label], (grid, np.array(y)))
    ax.set_ylim(-2, 102)
    ax.set_xlabel("environment steps")
    style.engineering(ax.xaxis)
    ax.set_ylabel("success (%)")
    style.legend(figure, scene.looks_of(chosen), markers=False)
    caption = (
        "Success on the scenarios of protocol validation, which no test shares, at fixed steps of the training "
        "(train.evaluate_every). Lines begin at 0, where no policy was tested, and end at the last step that all seeds reached."
        + lines_sentence(chosen)
        + shown(chosen, validated)
    )
    return Drawing(figure, "Training: success on validation scenarios", caption)
