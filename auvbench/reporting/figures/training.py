"""Figures of training: curves over steps, rewards by outcome, logs over episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from auvbench.analysis.records import Agent, RunRecord
from auvbench.record import OUTCOMES
from auvbench.reporting.figures import multiples, style
from auvbench.reporting.figures.scene import (
    Drawing,
    FloatArray,
    Scene,
    shown,
    wants_symlog,
    without,
)

RECORDS = "training records"
BINS = 60
FEWEST = 2
"""spans of a training"""
WINDOW = 100
"""episodes of a success share, as in the thesis"""
MOST_POINTS = 1500
"""of a scatter; every n-th episode beyond"""


def curves(scene: Scene) -> Drawing | None:
    """Mean episode length and return over training steps (thesis, figures 3.1 and 3.7)."""
    learners = scene.learners()
    wanted = scene.top(multiples.MOST, learners)
    chosen = scene.trained(wanted)
    if not chosen:
        return None
    found = {name: [binned(scene, agent, name) for agent in chosen] for name in ("steps", "return")}
    log = wants_symlog([y for _, y in found["return"]])
    figure = (
        _together(scene, chosen, found) if len(chosen) <= multiples.FEW else _apart(scene, chosen, found, log)
    )
    if log:
        style.symlog(figure.axes[1])
    caption = (
        f"Mean episode length and return during training, in up to {BINS} equal spans of environment steps, none shorter "
        "than the longest episode of all environments together while at least two are left."
        + multiples.lines_sentence(chosen)
        + multiples.grey_sentence(len(chosen))
        + shown(wanted, learners)
        + without(wanted, chosen, RECORDS)
        + (
            " The return's axis is linear up to ±1000 and logarithmic beyond, since K scales it."
            if log
            else ""
        )
    )
    return Drawing(figure, "Training: episode length and return", caption)


Found = Mapping[str, Sequence[multiples.Curve]]
"""curves by column of the records, in the order of the agents"""
TITLES = {"steps": "steps per episode", "return": "return per episode"}


def _together(scene: Scene, agents: Sequence[Agent], found: Found) -> Canvas:
    """All agents in one panel, length above return."""
    figure = style.canvas(6.4, 5.6)
    for ax, (name, title) in zip(figure.subplots(2, 1, sharex=True), TITLES.items(), strict=True):
        for agent, curve in zip(agents, found[name], strict=True):
            multiples.band(ax, scene, agent, curve)
        ax.set_ylabel(title)
    figure.axes[1].set_xlabel("environment steps of training")
    style.engineering(figure.axes[1].xaxis)
    style.legend(figure, scene.looks_of(agents), markers=False)
    return figure


def _apart(scene: Scene, agents: Sequence[Agent], found: Found, log: bool) -> Canvas:
    """A pair of panels per agent, length above return, side by side on common axes."""
    columns = -(-len(agents) // 2)  # two blocks of two rows: no taller than a screen
    blocks = 2
    figure = style.canvas(2.15 * columns + 0.4, 3.4 * blocks + 0.2)
    grid = figure.subplots(2 * blocks, columns, squeeze=False, sharex=True)
    first = dict(zip(TITLES, grid[:2, 0], strict=True))
    for ax in grid.flat:
        ax.set_visible(False)
    for i, agent in enumerate(agents):
        for row, (name, title) in enumerate(TITLES.items()):
            ax = grid[2 * (i // columns) + row, i % columns]
            ax.set_visible(True)
            if ax is not first[name]:
                ax.sharey(first[name])
            curves = found[name]
            multiples.behind(ax, [*curves[:i], *curves[i + 1 :]])
            multiples.band(ax, scene, agent, curves[i], alone=True)
            ax.tick_params(labelleft=i % columns == 0, labelbottom=False)
            if i % columns == 0:
                ax.set_ylabel(title)
            style.engineering(ax.xaxis)
            if log and name == "return" and ax is not first[name]:
                style.symlog(ax)
        style.title(grid[2 * (i // columns), i % columns], agent.label, 21)
        if i + columns >= len(agents):
            ax.tick_params(labelbottom=True)
            ax.set_xlabel("environment steps")
    return figure


def binned(scene: Scene, agent: Agent, column: str, most: int = BINS) -> multiples.Curve:
    """Centres of the spans (B,) and the means in them by seed (seeds, B), NaN where no episode ended.

    The column `success` is 100 where an episode reached the goal and else 0. A span is as long as the longest episode
    in all environments at once, where that leaves at least `FEWEST` of them: environments that begin together end their
    long episodes together, and a shorter span would hold nothing but failures, or nothing but what ended early.
    """
    found = [(f, run) for run in agent.runs if (f := scene.training(run)) is not None]
    frames = [f for f, _ in found]
    last = min(int(f["step"].iloc[-1]) for f in frames)  # where all seeds have a value
    longest = max(float(f["steps"].max()) * _environments(run) for f, run in found)
    bins = int(np.clip(min(min(len(f) for f in frames) // 5, last // max(longest, 1.0)), FEWEST, most))
    edges = np.linspace(0, last, bins + 1)
    rows = []
    for frame in frames:
        frame = frame[frame["step"] <= last]
        spans = np.clip(np.searchsorted(edges, frame["step"].to_numpy(), side="left") - 1, 0, bins - 1)
        count = np.bincount(spans, minlength=bins)
        values = 100.0 * (frame["outcome"] == "success") if column == "success" else frame[column]
        total = np.bincount(spans, weights=values.to_numpy(np.float64), minlength=bins)
        rows.append(np.divide(total, count, out=np.full(bins, np.nan), where=count > 0))
    return (edges[1:] + edges[:-1]) / 2, np.array(rows).reshape(-1, bins)


def _environments(run: RunRecord) -> int:
    """How many environments fed the learner."""
    n = run.config.get("algo.n_envs")
    return n if type(n) is int and n > 0 else 1


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
        style.title(top, f"{agent.label}, seed {agent.runs[0].seed}", 32)
        _scatter_by_outcome(top, frame)
        _success_share(bottom, frame)
        if i % columns == 0:
            top.set_ylabel("episode return")
            bottom.set_ylabel("success %")
        bottom.set_xlabel("training episode")
    style.outcome_legend(figure)
    caption = (
        "Return of the training episodes of one seed, coloured by outcome; below, the share of successes in "
        f"windows of at most {WINDOW} episodes." + shown(wanted, learners) + without(wanted, chosen, RECORDS)
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
        style.title(grid[0, column], agent.label)
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
