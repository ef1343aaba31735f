"""Trajectories of one test episode for several agents: in space, from above and from the side."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator

from auvbench.analysis.evaluations import Damage
from auvbench.analysis.recorded import has_paths, paths
from auvbench.analysis.records import Agent
from auvbench.record import OUTCOMES
from auvbench.reporting.figures import style
from auvbench.reporting.figures.scene import Drawing, FloatArray, Scene, shown, without
from auvbench.reporting.figures.testing import depth_limits

MOST = 6
"""paths in one picture"""
EPISODES = 10
"""of a run, among which one is chosen"""
VIEWS = ((0, "in space", (0, 1, 2)), (2, "from above", (0, 1)), (3, "from the side", (0, 2)))
"""column, title and coordinates of the panels"""


def trajectories(scene: Scene) -> Drawing | None:
    """Draw the paths of the first tested seed of each agent in one test episode (original study, figure 3.6)."""
    protocol, condition = scene.ranking.protocol, scene.ranking.condition
    wanted = scene.top(MOST)
    tracks = {agent.label: found for agent in wanted if (found := _positions(scene, agent))}
    chosen = [agent for agent in scene.agents if agent.label in tracks]
    episode = _telling_episode(chosen, tracks, protocol)
    if episode is None:
        return None
    figure = style.canvas(10.6, 4.6)
    # The layout engine does not see the labels of axes in space: the second column keeps them off the next panel.
    layout = figure.add_gridspec(1, 4, width_ratios=[1.25, 0.25, 1.1, 0.8])
    named = "waypoint" if "waypoint_x_m" in chosen[0].metrics else "goal"
    waypoint = np.array([float(chosen[0].metrics[f"{named}_{axis}_m"][0, episode]) for axis in "xyz"])
    start = tracks[chosen[0].label][episode][0]
    config = chosen[0].runs[0].config
    radius = float(config.get("task.goal_radius", config.get("task.tolerance", 0.0)))
    for column, title, axes in VIEWS:
        flat = len(axes) == 2
        ax: Any = figure.add_subplot(layout[column], projection=None if flat else "3d")
        if flat:
            x, y = waypoint[list(axes)]
            ax.add_patch(Circle((x, y), radius, color="#d4d4d4", zorder=0.5))
        else:
            ax.plot(*waypoint[:, None], "o", color="#b4b4b4", markersize=9)
            for axis in (ax.xaxis, ax.yaxis):
                axis.set_major_locator(MaxNLocator(3))  # foreshortened: more would overlap
            ax.set_zlabel("z (m)")
        ax.plot(*start[list(axes), None], "+", color="black", markersize=9)
        for agent in chosen:
            position, look = tracks[agent.label][episode][:, axes].T, scene.looks[agent.label]
            ax.plot(*position, color=look.colour, linestyle=look.linestyle, linewidth=1.5)
            ax.plot(*position[:, -1:], color=look.colour, marker=look.marker, markersize=6)
        ax.set(xlabel="x (m)", ylabel=f"{'xyz'[axes[1]]} (m)", aspect="equal")
        ax.set_title(title, loc="left")
    for limit in depth_limits(chosen[0]):
        ax.axhline(limit, color="#444444", linestyle="--", linewidth=0.9)
    ends = [f"{a.label} {OUTCOMES[int(a.outcome[_tested(a, protocol), episode])]}" for a in chosen]
    style.legend(figure, scene.looks_of(chosen))
    number = _episode_ids(chosen[0], protocol, condition)[episode]
    caption = (
        f"Test episode {number} (first tested seed of each agent), in space, from above and from the side. + "
        f"start; grey: the {named}{f' with its {radius:g} m sphere' if radius else ''}; dashed: the depth limits. "
        f"It ended in: {', '.join(ends)}."
        + shown(wanted, scene.agents)
        + without(wanted, chosen, "trajectories of this episode")
    )
    return Drawing(figure, "Test: trajectories of one episode", caption)


def _tested(agent: Agent, protocol: str) -> int:
    """Return the place of the first tested seed; a failed training has no test."""
    return next(i for i, run in enumerate(agent.runs) if protocol in run.evaluations)


def _episode_ids(agent: Agent, protocol: str, condition: str) -> list[int]:
    frame = agent.runs[_tested(agent, protocol)].evaluations[protocol].episodes
    return sorted(int(e) for e in frame.loc[frame["condition"] == condition, "episode"])


def _positions(scene: Scene, agent: Agent) -> dict[int, FloatArray]:
    """Return the paths (T+1, 3) of the first tested seed, by column of the agent's metrics."""
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
    return {ids[path.episode]: path.position for path in found if path.episode in ids}


def _telling_episode(
    agents: list[Agent], tracks: Mapping[str, Mapping[int, FloatArray]], protocol: str
) -> int | None:
    """Return the common episode with the most different outcomes; among equals, the one furthest away."""
    if not agents:
        return None
    common = set.intersection(*(set(tracks[agent.label]) for agent in agents))

    def telling(episode: int) -> tuple[int, float, int]:
        outcomes = {int(agent.outcome[_tested(agent, protocol), episode]) for agent in agents}
        return len(outcomes), float(agents[0].metrics["initial_distance_m"][0, episode]), -episode

    return max(common, key=telling, default=None)
