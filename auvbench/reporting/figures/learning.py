"""Success during training against environment steps: how fast an agent learns, and whether all its seeds do."""

from __future__ import annotations

from auvbench.analysis.model import Agent
from auvbench.reporting.figures import multiples, style
from auvbench.reporting.figures.scene import Drawing, Scene, shown, without
from auvbench.reporting.figures.training import RECORDS, binned

SPANS = 30
"""of steps, at most: a dot per seed in each"""


def success(scene: Scene) -> Drawing | None:
    """Share of training episodes that reached the goal, over the environment steps of the training."""
    learners = scene.learners()
    wanted = scene.top(multiples.MOST, learners)
    chosen = scene.trained(wanted)
    if not chosen:
        return None
    curves = [_share(scene, agent) for agent in chosen]
    if len(chosen) <= multiples.FEW:
        figure = style.canvas(6.8, 4.0)
        ax = figure.subplots()
        for agent, curve in zip(chosen, curves, strict=True):
            multiples.band(ax, scene, agent, curve, dots=True)
        axes = [ax]
        style.legend(figure, scene.looks_of(chosen), markers=False)
    else:
        columns = multiples.columns_of(len(chosen))
        rows = -(-len(chosen) // columns)
        figure = style.canvas(2.75 * columns, 2.05 * rows + 0.3)
        grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
        axes = list(grid.flat)[: len(chosen)]
        for i, (ax, agent) in enumerate(zip(axes, chosen, strict=True)):
            multiples.behind(ax, curves[:i] + curves[i + 1 :])
            multiples.band(ax, scene, agent, curves[i], dots=True, alone=True)
            ax.set_title(agent.label, loc="left")
            ax.tick_params(labelbottom=i + columns >= len(chosen))
        for ax in list(grid.flat)[len(chosen) :]:
            ax.set_visible(False)
    for i, ax in enumerate(axes):
        ax.set_ylim(-2, 102)
        style.engineering(ax.xaxis)
        if len(axes) == 1 or i % multiples.columns_of(len(axes)) == 0:
            ax.set_ylabel("success (%)")
        if len(axes) == 1 or i + multiples.columns_of(len(axes)) >= len(axes):
            ax.set_xlabel("environment steps")
    caption = (
        f"Share of the training episodes that reached the goal, in up to {SPANS} equal spans of environment steps. "
        "Training explores: these episodes are not the test. In the first spans only short episodes have ended."
        + multiples.lines_sentence(chosen, dots=True)
        + multiples.grey_sentence(len(chosen))
        + shown(wanted, learners)
        + without(wanted, chosen, RECORDS)
    )
    return Drawing(figure, "Training: success over steps", caption)


def _share(scene: Scene, agent: Agent) -> multiples.Curve:
    return binned(scene, agent, "success", SPANS)
