"""Trajectories of one test episode for several agents: in space, from above and from the side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from auvbench.analysis.evaluations import Damage
from auvbench.analysis.paths import has_paths, paths
from auvbench.analysis.records import Agent
from auvbench.record import OUTCOMES
from auvbench.reporting.figures import style
from auvbench.reporting.figures.scene import Drawing, FloatArray, Scene, shown, without
from auvbench.reporting.figures.testing import depth_limits, goal_radius

MOST = 6
"""paths in one picture"""
EPISODES = 10
"""of a run, among which the one that is drawn is chosen"""


def trajectories(scene: Scene) -> Drawing | None:
    """Paths of the first tested seed of each agent in one test episode (thesis, figure 3.6)."""
    protocol, condition = scene.ranking.protocol, scene.ranking.condition
    wanted = scene.top(MOST)
    tracks: dict[str, dict[int, FloatArray]] = {}
    for agent in wanted:
        if found := _positions(scene, agent):
            tracks[agent.label] = found
    chosen = [agent for agent in scene.agents if agent.label in tracks]
    episode = _telling_episode(chosen, tracks, protocol)
    if episode is None:
        return None
    figure = style.canvas(10.6, 4.6)
    layout = figure.add_gridspec(1, 3, width_ratios=[1.25, 1.15, 0.8])
    space = figure.add_subplot(layout[0], projection="3d")
    above, side = figure.add_subplot(layout[1]), figure.add_subplot(layout[2])
    waypoint = np.array([float(chosen[0].metrics[f"waypoint_{axis}_m"][0, episode]) for axis in "xyz"])
    limits = depth_limits(chosen[0])
    _frame(space, above, side, waypoint, goal_radius(chosen), limits)
    _bounds(space, above, side, [tracks[a.label][episode] for a in chosen], waypoint, limits)
    ends = []
    for agent in chosen:
        position = tracks[agent.label][episode]
        look = scene.looks[agent.label]
        line: Mapping[str, Any] = {"color": look.colour, "linestyle": look.linestyle, "linewidth": 1.5}
        end: Mapping[str, Any] = {
            "color": look.colour,
            "marker": look.marker,
            "linestyle": "",
            "markersize": 6,
        }
        for ax, axes in ((space, (0, 1, 2)), (above, (0, 1)), (side, (0, 2))):
            ax.plot(*(position[:, i] for i in axes), **line)
            ax.plot(*(position[-1:, i] for i in axes), **end)
        outcome = int(agent.outcome[_tested(agent, protocol), episode])
        ends.append(f"{agent.label} {OUTCOMES[outcome]}")
    style.legend(figure, scene.looks_of(chosen))
    number = _episode_ids(chosen[0], protocol, condition)[episode]
    caption = (
        f"Test episode {number} (first tested seed of each agent), in space, from above and from the side. + "
        f"start; grey: the waypoint with its {goal_radius(chosen):g} m sphere; dashed: the depth limits. "
        f"It ended in: {', '.join(ends)}."
        + shown(wanted, scene.agents)
        + without(wanted, chosen, "trajectories of this episode")
    )
    return Drawing(figure, "Test: trajectories of one episode", caption)


def _tested(agent: Agent, protocol: str) -> int:
    """Place of the first seed that has a policy that was tested: a training that failed has none."""
    return next(i for i, run in enumerate(agent.runs) if protocol in run.evaluations)


def _episode_ids(agent: Agent, protocol: str, condition: str) -> list[int]:
    frame = agent.runs[_tested(agent, protocol)].evaluations[protocol].episodes
    return sorted(int(e) for e in frame.loc[frame["condition"] == condition, "episode"])


def _positions(scene: Scene, agent: Agent) -> dict[int, FloatArray]:
    """Paths (T+1, 3) of the first seed, by column of the agent's metrics; a damaged file becomes a problem."""
    protocol, condition = scene.ranking.protocol, scene.ranking.condition
    if all(protocol not in run.evaluations for run in agent.runs):
        return {}
    run = agent.runs[_tested(agent, protocol)]
    evaluation = run.evaluations[protocol]
    if not has_paths(evaluation):
        return {}
    ids = {episode: column for column, episode in enumerate(_episode_ids(agent, protocol, condition))}
    try:
        found = list(paths(run.id, evaluation, condition, EPISODES))
    except Damage as damage:
        scene.problem(run, damage)
        return {}
    return {ids[episode]: position for episode, _, position, _ in found if episode in ids}


def _telling_episode(
    agents: list[Agent], tracks: Mapping[str, Mapping[int, FloatArray]], protocol: str
) -> int | None:
    """The episode all agents have that ended most differently; among equals, the one furthest away."""
    if not agents:
        return None
    common = set.intersection(*(set(tracks[agent.label]) for agent in agents))

    def telling(episode: int) -> tuple[int, float, int]:
        outcomes = {int(agent.outcome[_tested(agent, protocol), episode]) for agent in agents}
        return len(outcomes), float(agents[0].metrics["initial_distance_m"][0, episode]), -episode

    return max(common, key=telling, default=None)


def _frame(
    space: Any, above: Axes, side: Axes, waypoint: FloatArray, radius: float, limits: tuple[float, float]
) -> None:
    """Waypoint sphere, start, depth limits, labels."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 19), np.linspace(0, np.pi, 10))
    ball = [np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)]
    space.plot_wireframe(
        *(radius * b + w for b, w in zip(ball, waypoint, strict=True)), color="#9a9a9a", linewidth=0.4
    )
    space.plot([0], [0], [-20], marker="+", color="black", markersize=9, linestyle="")
    space.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)")
    for axis in (space.xaxis, space.yaxis):
        axis.set_major_locator(MaxNLocator(3))  # foreshortened: more would overlap
    space.set_title("in space", loc="left")
    space.tick_params(labelsize=7, pad=0)
    circle = np.linspace(0, 2 * np.pi, 80)
    for ax, j, start, name, title in (
        (above, 1, 0.0, "y", "from above"),
        (side, 2, -20.0, "z", "from the side"),
    ):
        ax.fill(
            waypoint[0] + radius * np.cos(circle),
            waypoint[j] + radius * np.sin(circle),
            color="#d4d4d4",
            zorder=0.5,
        )
        ax.plot(0, start, marker="+", color="black", markersize=9)
        ax.set(xlabel="x (m)", ylabel=f"{name} (m)", aspect="equal")
        ax.set_title(title, loc="left")
    for limit in limits:
        side.axhline(limit, color="#444444", linestyle="--", linewidth=0.9)


def _bounds(
    space: Any,
    above: Axes,
    side: Axes,
    positions: Sequence[FloatArray],
    waypoint: FloatArray,
    limits: tuple[float, float],
) -> None:
    """One scale for all three views, from what is in the picture; the depth limits are always in it."""
    points = np.vstack([*positions, waypoint - 4, waypoint + 4])
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = (low + high) / 2, float(max(high[:2] - low[:2])) / 2 + 1.5
    x, y = ((middle[i] - half, middle[i] + half) for i in (0, 1))
    z = min(limits[0], low[2]) - 2, max(limits[1], high[2]) + 2
    space.set(xlim=x, ylim=y, zlim=z)
    space.set_box_aspect((2 * half, 2 * half, z[1] - z[0]), zoom=0.95)
    above.set(xlim=x, ylim=y)
    side.set(xlim=x, ylim=z)
    corners = np.array([(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1]), (x[0], y[0])])
    for limit in limits:
        space.plot(corners[:, 0], corners[:, 1], limit, color="#444444", linestyle="--", linewidth=0.7)
