"""Heat maps: success over K and step frequency, and who does better than whom."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.image import AxesImage
from numpy.typing import NDArray

from auvbench.analysis.conditions import UNDISTURBED, in_words, split
from auvbench.analysis.labels import part
from auvbench.analysis.records import Row
from auvbench.analysis.rounding import rounded
from auvbench.reporting.figures import rates, style
from auvbench.reporting.figures.conditions import of_how_many, vehicles
from auvbench.reporting.figures.rates import Curve
from auvbench.reporting.figures.scene import Drawing, FloatArray, Scene

MOST_IN_MATRIX = 15
MOST_IN_LIST = 40
"""agents, one below the other"""
UNDER_CONDITIONS = ("robustness", "transfer")
"""the protocols whose conditions stand side by side"""


def success_over_grid(scene: Scene) -> Drawing | None:
    """Success rate over K and step frequency, a panel per algorithm; None where neither of them varies."""
    rows = [r for r in scene.ranking.rows if {"reward.k", "step.frequency"} <= r.key.keys()]
    algos: dict[str, list[Row]] = {}
    for row in rows:
        algos.setdefault(str(row.key.get("algo", "")), []).append(row)
    algos = {name: members for name, members in sorted(algos.items()) if len(members) > 1}
    if not algos:
        return None
    members = [row for group in algos.values() for row in group]
    ks = sorted({float(row.key["reward.k"]) for row in members})
    fs = sorted({float(row.key["step.frequency"]) for row in members}, reverse=True)
    if len(ks) * len(fs) > 150:
        return None  # drawn at random, not a grid
    columns = min(3, len(algos))
    lines = -(-len(algos) // columns)
    width = max(1.0, 0.62 * len(ks)) + 0.9
    figure = style.canvas(max(4.2, columns * width + 1.0), max(2.2, lines * (0.5 * len(fs) + 0.9)))
    grid = figure.subplots(lines, columns, squeeze=False)
    image: AxesImage | None = None
    for i, ax in enumerate(grid.flat):
        ax.set_visible(i < len(algos))
    lowest = 10 * np.floor(10 * min(row.estimates["success_rate"].value for row in members))
    for ax, (name, group) in zip(grid.flat, algos.items(), strict=False):
        values = np.full((len(fs), len(ks)), np.nan)
        texts = np.full(values.shape, "", dtype=object)
        for row in group:
            where = fs.index(float(row.key["step.frequency"])), ks.index(float(row.key["reward.k"]))
            values[where] = 100 * row.estimates["success_rate"].value
            texts[where] = rounded(row.estimates["success_rate"], 100)[0]  # as in the table
        image = _heat(ax, values, "cividis", min(lowest, 90.0), 100, texts)
        ax.set_title(part("algo", name) if name else "all", loc="left")
        ax.set_xticks(range(len(ks)), [f"{k:g}" for k in ks])
        ax.set_yticks(range(len(fs)), [f"{f:g}" for f in fs])
        ax.set_xlabel("K")
    for ax in grid[:, 0]:
        ax.set_ylabel("step frequency (Hz)")
    if image is not None:
        figure.colorbar(image, ax=grid, label="test success (%)", shrink=0.8)
    caption = (
        "Test success over reward coefficient K and training step frequency. A cell with a cross has no evaluated "
        "run. Intervals are in the table."
    )
    return Drawing(figure, "Success over K and step frequency", caption)


def success_over_conditions(scene: Scene) -> Drawing | None:
    """Success of every agent under every condition of robustness and transfer; None where no agent was tested by them."""
    curves: dict[str, dict[str, float]] = {}
    headings: dict[str, tuple[str, str]] = {}
    for protocol in UNDER_CONDITIONS:
        found = rates.by_agent(scene, protocol, MOST_IN_LIST)
        for name in _columns(scene, found, transfer=bool(headings)):
            headings[name] = in_words(name)
            for label, curve in found.items():
                if name in curve:
                    curves.setdefault(label, {})[name] = curve[name].value
    tested = [agent for agent in scene.agents if agent.label in curves][:MOST_IN_LIST]
    if not tested or len(headings) < 2:
        return None
    values = np.array([[curves[a.label].get(name, np.nan) for name in headings] for a in tested])
    texts = np.array([_whole(value) for value in values.flat], dtype=object).reshape(values.shape)
    figure = style.canvas(2.4 + 0.34 * len(headings), 1.5 + 0.23 * len(tested))
    ax = figure.subplots()
    image = _heat(ax, values, "cividis", 0, 100, texts)
    factors = [split(name)[0] for name in headings]
    for i in range(1, len(factors)):
        if factors[i] != factors[i - 1]:
            ax.axvline(i - 0.5, color="white", linewidth=4)
    words = [
        f"{factor} {level}".strip() if factor != "vehicle" else level for factor, level in headings.values()
    ]
    ax.set_xticks(range(len(words)), words, rotation=45, ha="right", rotation_mode="anchor")
    ax.set_yticks(range(len(tested)), [agent.label for agent in tested])
    figure.colorbar(image, ax=ax, label="test success (%)", shrink=0.8)
    caption = (
        "Test success of the same policies under each condition of robustness and on the vehicles of transfer, agents "
        "in the order of the ranking; 100 is every episode. Intervals are in conditions.csv."
        + (" A cross: not tested." if np.isnan(values).any() else "")
        + of_how_many(tested, scene, MOST_IN_LIST)
    )
    return Drawing(figure, "Success under each condition", caption)


def _columns(scene: Scene, found: Mapping[str, Curve], *, transfer: bool) -> list[str]:
    """The conditions of a protocol, without the undisturbed one where that stands there already."""
    names = rates.names(found)
    own = vehicles([agent for agent in scene.agents if agent.label in found])
    if UNDISTURBED in names:
        # The vehicle that all were trained on is the undisturbed condition again.
        names = [name for name in names if {split(name)[1]} != own]
    return [name for name in names if not (transfer and name == UNDISTURBED)]


def _whole(percent: float) -> str:
    """Whole percents, in which nothing but every episode is 100 and nothing but none is 0.

    >>> _whole(99.97), _whole(100.0), _whole(0.2), _whole(54.5)
    ('99', '100', '1', '54')
    """
    return f"{percent if percent in (0.0, 100.0) else min(max(percent, 1.0), 99.0):.0f}"


def improvement(scene: Scene) -> Drawing | None:
    """Probability that the row's agent does better than the column's on a scenario."""
    whole = np.asarray(scene.ranking.improvement, dtype=np.float64)
    if whole.shape != (len(scene.ranking.rows),) * 2:
        return None
    # An agent that is compared with no other has no value in its row.
    apart = whole + np.where(np.eye(len(whole)), np.nan, 0.0)
    compared = [i for i in range(len(whole)) if np.isfinite(apart[i]).any()]
    chosen = compared[:MOST_IN_MATRIX]
    if len(chosen) < 2:
        return None
    labels = [scene.ranking.rows[i].label for i in chosen]
    matrix = whole[np.ix_(chosen, chosen)]
    values = 100 * matrix
    np.fill_diagonal(values, np.nan)
    side = 2.6 + 0.42 * len(labels)
    figure = style.canvas(side + 1.4, side)
    ax = figure.subplots()
    texts = np.array([f"{value:.0f}" for value in values.flat], dtype=object).reshape(values.shape)
    image = _heat(ax, values, "PuOr", 0, 100, texts, cross=False)
    ax.set_xticks(range(len(labels)), labels, rotation=45, ha="right", rotation_mode="anchor")
    ax.set_yticks(range(len(labels)), labels)
    figure.colorbar(image, ax=ax, label="row better than column (%)", shrink=0.8)
    caption = (
        "Probability that the row's agent does better than the column's on a random test scenario "
        f"(by {scene.ranking.rank_by}, ties by {scene.ranking.then}); 50 % is no difference."
        + (
            f" Shown: {len(chosen)} of {len(compared)} agents, the best-ranked."
            if len(chosen) < len(compared)
            else ""
        )
        + _not_compared(len(whole) - len(compared))
    )
    return Drawing(figure, "Probability of improvement", caption)


def _not_compared(n: int) -> str:
    """'' or the sentence of a caption on agents that are compared with no other."""
    if not n:
        return ""
    return (
        f" {n} agent{'' if n == 1 else 's'} with one training seed {'is' if n == 1 else 'are'} not compared."
    )


def _heat(
    ax: Axes,
    values: FloatArray,
    colours: str,
    low: float,
    high: float,
    texts: NDArray[np.object_],
    *,
    cross: bool = True,
) -> AxesImage:
    """An image with the `texts` of its values written in; NaN cells are crossed out or left blank."""
    image = ax.imshow(values, cmap=colours, vmin=low, vmax=high, aspect="auto")
    ax.grid(visible=False)
    ax.spines[:].set_visible(False)
    ax.tick_params(length=0)
    for (i, j), value in np.ndenumerate(values):
        if np.isfinite(value):
            red, green, blue, _ = image.to_rgba(np.array([value]))[0]
            dark = 0.299 * red + 0.587 * green + 0.114 * blue < 0.55
            ax.text(
                j,
                i,
                str(texts[i, j]),
                ha="center",
                va="center",
                color="white" if dark else "black",
                size=7.5,
            )
        elif cross:
            ax.text(j, i, "✕", ha="center", va="center", color="#a0a0a0")
    return image
