"""Success during training against environment steps: how fast an agent learns, and whether all its seeds do."""

from __future__ import annotations

import numpy as np

from auvbench.analysis.evaluations import Damage
from auvbench.analysis.records import Agent, Problem
from auvbench.analysis.validation_curve import ValidationCurve, read_validation_curve
from auvbench.reporting.figures import multiples, style
from auvbench.reporting.figures.scene import Drawing, Scene, shown, without
from auvbench.reporting.figures.training import RECORDS, binned

SPANS = 30
"""of steps, at most: a dot per seed in each"""
MOST_WATCHED = 6
"""agents in the panels of the validation curves"""


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
            style.title(ax, agent.label)
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
        f"Share of the training episodes that reached the goal, in up to {SPANS} equal spans of environment steps, none shorter than "
        "the longest episode of all environments together while at least two are left. "
        "Training explores: these episodes are not the test."
        + multiples.lines_sentence(chosen, dots=True)
        + multiples.grey_sentence(len(chosen))
        + shown(wanted, learners)
        + without(wanted, chosen, RECORDS)
    )
    return Drawing(figure, "Training: success over steps", caption)


def _share(scene: Scene, agent: Agent) -> multiples.Curve:
    return binned(scene, agent, "success", SPANS)


def validation(scene: Scene) -> Drawing | None:
    """Success on the validation scenarios against environment steps, wall time and simulated time."""
    curves: dict[str, list[ValidationCurve]] = {}
    for agent in scene.learners():
        for run in agent.runs:
            try:
                found = read_validation_curve(run)
            except Damage as damage:
                scene.problems.append(Problem(run.id, "damaged", str(damage)))
                continue
            if found is not None:
                curves.setdefault(agent.label, []).append(found)
    wanted = [agent for agent in scene.learners() if agent.label in curves]
    if not wanted:
        return None
    chosen = scene.top(MOST_WATCHED, wanted)
    figure = style.canvas(7.4, 2.9)
    panels = figure.subplots(1, 3, sharey=True)
    axes = (("step", 1.0, "environment steps"), ("wall_s", 1 / 60, "wall time of training (min)"))
    for ax, (axis, scale, label) in zip(
        panels, (*axes, ("simulated_s", 1 / 3600, "simulated time (h)")), strict=True
    ):
        for agent in chosen:
            mine = curves[agent.label]
            end = min(float(getattr(curve, axis)[-1]) for curve in mine)
            grid = np.linspace(0, end, 60)
            y = np.array(
                [
                    np.interp(grid, [0.0, *getattr(curve, axis)], [0.0, *(100 * curve.success)])
                    for curve in mine
                ]
            )
            multiples.band(ax, scene, agent, (scale * grid, y))
        ax.set_ylim(-2, 102)
        ax.set_xlabel(label)
        if axis == "step":
            style.engineering(ax.xaxis)
    panels[0].set_ylabel("success (%)")
    style.legend(figure, scene.looks_of(chosen), markers=False)
    caption = (
        "Success on the scenarios of protocol validation, which no test shares, at fixed steps of the training "
        "(train.evaluate_every); wall time without these tests, simulated time of all environments together. Lines "
        "begin at 0, where nothing was tested, and end where the first seed does."
        + multiples.lines_sentence(chosen)
        + shown(chosen, wanted)
    )
    return Drawing(figure, "Training: success on validation scenarios", caption)
