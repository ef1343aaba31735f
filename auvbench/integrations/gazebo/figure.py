"""Draw the figure of protocol gazebo: the same policies in Gazebo and in the embedded simulator."""

from __future__ import annotations

from auvbench.reporting.figures import looks, style
from auvbench.reporting.figures.scene import Drawing, Scene

CONDITIONS = {"simulator=gazebo": "corrected Gazebo", "simulator=gazebo-published": "published Gazebo"}
"""Labels of protocol gazebo's conditions, by condition"""


def draw(scene: Scene) -> Drawing | None:
    """Draw, for each agent, its PAR-1 steps in Gazebo less its PAR-1 steps in the embedded simulator."""
    results_of = [(agent, scene.tested(agent, "gazebo")) for agent in scene.agents]
    tested = [
        (agent, conditions) for agent, conditions in results_of if any(c.par1_change for c in conditions)
    ]
    if not tested:
        return None
    conditions = [c.name for c in tested[0][1] if c.par1_change]
    names = [agent.label for agent, _ in tested]
    figure = style.canvas(3.6 + 0.075 * max(map(len, names)), 1.6 + 0.3 * len(tested))
    ax = figure.subplots()
    ax.axvline(0.0, color="#444444", linewidth=0.9)
    for place, name in enumerate(conditions):
        colour, marker = looks.COLOURS[place % len(looks.COLOURS)], looks.MARKERS[place % len(looks.MARKERS)]
        offset = 0.5 * ((place + 0.5) / len(conditions) - 0.5)
        for y, (agent, results) in enumerate(tested):
            for change in (c.par1_change.get(agent.label) for c in results if c.name == name):
                if change is not None:
                    ax.hlines(y + offset, change.low, change.high, color=colour, linewidth=1.2)
                    ax.plot(change.value, y + offset, color=colour, marker=marker, markersize=4)
        ax.plot([], [], color=colour, marker=marker, linestyle="", label=CONDITIONS.get(name, name))
    ax.grid(visible=False, axis="y")
    ax.set_yticks(range(len(tested)), names)
    ax.set_ylim(len(tested) - 0.5, -0.5)
    ax.set_xlabel("PAR-1 steps: in Gazebo less embedded\nleft: sooner in Gazebo")
    figure.legend(loc="outside upper right", ncols=len(conditions))
    caption = (
        "PAR-1 steps (a failure counts as the limit) of the same policies in Gazebo less those in the embedded simulator, paired by "
        "seed and scenario (protocol gazebo); left of the line an agent is sooner in Gazebo."
        f" Bars: {100 * scene.ranking.confidence:g} % intervals."
    )
    return Drawing(figure, "In Gazebo", caption)
