"""Figures of training: curves over steps, rewards by outcome, logs over episodes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from auvbench.analysis.labels import part
from auvbench.analysis.model import Agent
from auvbench.reporting.figures import style
from auvbench.reporting.figures.scene import (
    MANY,
    MOST_TRAINING_FILES,
    Drawing,
    FloatArray,
    Scene,
    seeds_sentence,
    shown,
    wants_symlog,
    without,
)
from auvbench.tasks.record import OUTCOMES

RECORDS = "training records"
BINS = 60
WINDOW = 100
"""episodes of a success share, as in the thesis"""
MOST_POINTS = 1500
"""of a scatter; every n-th episode beyond"""


def curves(scene: Scene) -> Drawing | None:
    """Mean episode length and return over training steps (thesis, figures 3.1 and 3.7)."""
    learners = scene.learners()
    possible = _panels(scene, learners)
    wanted = [agent for _, among in possible for agent in among]
    panels = [(title, agents) for title, among in possible if (agents := scene.trained(among))]
    if not panels:
        return None
    chosen = [agent for _, agents in panels for agent in agents]
    figure = style.canvas(max(6.4, 3.6 * len(panels)), 5.6)
    grid = figure.subplots(2, len(panels), sharex="col", sharey="row", squeeze=False)
    returns: list[FloatArray] = []
    for column, (title, agents) in enumerate(panels):
        for agent in agents:
            for row, name in enumerate(("steps", "return")):
                x, y = _binned(scene, agent, name)
                if name == "return":
                    returns.append(y)
                _band(grid[row, column], scene, agent, x, y, faint=len(agents) > 4)
        grid[0, column].set_title(f"{title}episode length", loc="left")
        grid[1, column].set_title(f"{title}episode return", loc="left")
        grid[1, column].set_xlabel("environment steps of training")
        style.engineering(grid[1, column].xaxis)
        if len(panels) > 1:
            _own_legend(grid[1, column], scene, agents)
    log = wants_symlog(returns)
    if log:
        style.symlog(grid[1, 0])
    grid[0, 0].set_ylabel("steps per episode")
    grid[1, 0].set_ylabel("return per episode")
    if len(panels) == 1:
        style.legend(figure, scene.looks_of(chosen), markers=False)
    caption = (
        f"Mean episode length and return during training, in up to {BINS} equal spans of steps."
        + seeds_sentence(chosen)
        + shown(wanted, learners)
        + without(wanted, chosen, RECORDS)
        + (
            " The return's axis is linear up to ±1000 and logarithmic beyond, since K scales it."
            if log
            else ""
        )
    )
    return Drawing(figure, "Training: episode length and return", caption)


def _panels(scene: Scene, learners: Sequence[Agent]) -> list[tuple[str, tuple[Agent, ...]]]:
    """Agents of one panel, or a panel per algorithm when they are many."""
    if not learners:
        return []
    seeds = max(len(agent.runs) for agent in learners)
    if len(learners) <= MANY:
        return [("", tuple(learners))]
    algos = list(dict.fromkeys(str(agent.key.get("algo", "")) for agent in learners))[:4]
    each = max(2, min(MANY + 1, MOST_TRAINING_FILES // (seeds * len(algos))))
    members = {algo: [a for a in learners if str(a.key.get("algo", "")) == algo] for algo in algos}
    return [(f"{part('algo', algo)}: ", scene.top(each, members[algo])) for algo in algos]


def _binned(scene: Scene, agent: Agent, column: str) -> tuple[FloatArray, FloatArray]:
    """Centres of the spans (B,) and the means in them by seed (seeds, B), NaN where no episode ended."""
    frames = [f for run in agent.runs if (f := scene.training(run)) is not None]
    last = min(int(f["step"].iloc[-1]) for f in frames)  # where all seeds have a value
    bins = int(np.clip(min(len(f) for f in frames) // 5, 4, BINS))
    edges = np.linspace(0, last, bins + 1)
    rows = []
    for frame in frames:
        frame = frame[frame["step"] <= last]
        spans = np.clip(np.searchsorted(edges, frame["step"].to_numpy(), side="left") - 1, 0, bins - 1)
        count = np.bincount(spans, minlength=bins)
        total = np.bincount(spans, weights=frame[column].to_numpy(np.float64), minlength=bins)
        rows.append(np.divide(total, count, out=np.full(bins, np.nan), where=count > 0))
    return (edges[1:] + edges[:-1]) / 2, np.array(rows).reshape(-1, bins)


def _band(ax: Axes, scene: Scene, agent: Agent, x: FloatArray, y: FloatArray, *, faint: bool) -> None:
    """Mean over seeds as a line, their range as a band; x (B,), y (seeds, B)."""
    there = np.isfinite(y).any(axis=0)
    if not there.any():
        return
    x, y = x[there], y[:, there]
    look = scene.looks[agent.label]
    ax.plot(x, np.nanmean(y, axis=0), color=look.colour, linestyle=look.linestyle, label=agent.label)
    if len(y) > 1:
        ax.fill_between(
            x, np.nanmin(y, axis=0), np.nanmax(y, axis=0), color=look.colour, alpha=0.15, linewidth=0
        )


def _own_legend(ax: Axes, scene: Scene, agents: Sequence[Agent]) -> None:
    handles, names = ax.get_legend_handles_labels()
    columns = 2 if len(agents) > 4 else 1
    ax.legend(handles, names, loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=columns, fontsize=7.5)


def reward_by_outcome(scene: Scene) -> Drawing | None:
    """Return of every training episode coloured by outcome, with success shares (thesis, figure 3.2)."""
    learners = scene.learners()
    wanted = scene.top(6, learners)
    chosen = [a for a in wanted if scene.training(a.runs[0]) is not None]
    if not chosen:
        return None
    columns = min(3, len(chosen))
    rows = -(-len(chosen) // columns)
    figure = style.canvas(max(4.6, 3.3 * columns), 3.5 * rows + 0.3)
    grid = figure.subplots(2 * rows, columns, squeeze=False, sharex=False, height_ratios=[3, 1] * rows)
    for ax in grid.flat:
        ax.set_visible(False)
    for i, agent in enumerate(chosen):
        top, bottom = grid[2 * (i // columns) : 2 * (i // columns) + 2, i % columns]
        top.set_visible(True)
        bottom.set_visible(True)
        bottom.sharex(top)
        top.tick_params(labelbottom=False)
        frame = scene.training(agent.runs[0])
        assert frame is not None
        top.set_title(f"{agent.label}, seed {agent.runs[0].seed}", loc="left")
        _scatter_by_outcome(top, frame)
        _success_share(bottom, frame)
        if i % columns == 0:
            top.set_ylabel("episode return")
            bottom.set_ylabel("success %")
        bottom.set_xlabel("training episode")
    style.outcome_legend(figure)
    caption = (
        "Return of the training episodes of one seed, coloured by outcome; below, the share of successes in "
        f"windows of {WINDOW} episodes." + shown(wanted, learners) + without(wanted, chosen, RECORDS)
    )
    return Drawing(figure, "Training: return by outcome", caption)


def _scatter_by_outcome(ax: Axes, frame: pd.DataFrame) -> None:
    every = max(1, len(frame) // MOST_POINTS)
    episode = np.arange(len(frame))[::every]
    thin = frame.iloc[::every]
    # Rare outcomes are drawn last, or the frequent ones would bury them.
    for name in sorted(OUTCOMES, key=lambda o: -int((thin["outcome"] == o).sum())):
        here = (thin["outcome"] == name).to_numpy()
        colour, marker = style.OUTCOME_LOOK[name]
        ax.scatter(
            episode[here],
            thin["return"].to_numpy()[here],
            s=7,
            color=colour,
            marker=marker,
            alpha=0.6,
            linewidth=0,
            rasterized=True,
        )


def _success_share(ax: Axes, frame: pd.DataFrame) -> None:
    won = (frame["outcome"] == "success").to_numpy(np.float64)
    window = min(WINDOW, len(won))
    edges = np.arange(0, len(won), window)
    share = 100 * np.add.reduceat(won, edges) / np.diff(np.append(edges, len(won)))
    ax.stairs(
        share, np.append(edges, len(won)), fill=True, color=style.OUTCOME_LOOK["success"][0], alpha=0.35
    )
    ax.stairs(share, np.append(edges, len(won)), color=style.OUTCOME_LOOK["success"][0], linewidth=1.2)
    ax.set_ylim(0, 100)


def logs(scene: Scene) -> Drawing | None:
    """Final distance, return and length of every training episode, several agents side by side."""
    learners = scene.learners()
    wanted = scene.top(4, learners)
    chosen = [a for a in wanted if scene.training(a.runs[0]) is not None]
    if not chosen:
        return None
    titles = {"final_distance_m": "final distance (m)", "return": "return", "steps": "length (steps)"}
    figure = style.canvas(max(4.6, 2.7 * len(chosen)), 6.0)
    grid = figure.subplots(3, len(chosen), squeeze=False, sharex="col", sharey="row")
    returns = []
    for column, agent in enumerate(chosen):
        grid[0, column].set_title(agent.label, loc="left")
        grid[2, column].set_xlabel("training episode")
        for row, name in enumerate(titles):
            ax = grid[row, column]
            values = [
                f[name].to_numpy(np.float64) for r in agent.runs if (f := scene.training(r)) is not None
            ]
            if name == "return":
                returns.append(values[0])
            _log_panel(ax, scene, agent, values)
            if column == 0:
                ax.set_ylabel(titles[name])
    log = wants_symlog(returns)
    if log:
        style.symlog(grid[1, 0])
    caption = (
        "Final distance, return and length over training episodes. Dots: the episodes of the first seed; lines: "
        "a running mean over 50 episodes, one line per training seed."
        + (" The return's axis is linear up to ±1000 and logarithmic beyond." if log else "")
        + shown(wanted, learners)
        + without(wanted, chosen, RECORDS)
    )
    return Drawing(figure, "Training: logs over episodes", caption)


def _log_panel(ax: Axes, scene: Scene, agent: Agent, values: Sequence[FloatArray]) -> None:
    colour = scene.looks[agent.label].colour
    every = max(1, len(values[0]) // MOST_POINTS)
    episode = np.arange(len(values[0]))[::every]
    ax.plot(episode, values[0][::every], ".", color="#9a9a9a", markersize=2, alpha=0.4, rasterized=True)
    for i, series in enumerate(values):
        window = min(50, len(series))
        mean = np.convolve(series, np.ones(window) / window, mode="valid")
        every = max(1, len(mean) // 600)
        x = np.arange(window - 1, len(series))
        ax.plot(
            x[::every],
            mean[::every],
            color=colour,
            linewidth=1.8 if i == 0 else 1.0,
            alpha=1 if i == 0 else 0.6,
        )
