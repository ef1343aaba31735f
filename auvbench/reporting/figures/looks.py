"""Choose the looks of agents: colours for colour-blind readers, markers and line styles for black-and-white print."""

from __future__ import annotations

import colorsys
from collections.abc import Iterable, Sequence
from typing import Literal, NamedTuple

from auvbench.analysis.records import Agent
from auvbench.envs.rendering import COLOURS as COLOURS

MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">", "h")
Linestyle = Literal["-", "--", "-.", ":"]
LINESTYLES: tuple[Linestyle, ...] = ("-", "--", "-.", ":")


class Look(NamedTuple):
    """Look of an agent in every figure of a report."""

    colour: str
    marker: str
    linestyle: Linestyle


def colour_of(agents: Sequence[Agent]) -> dict[str, Look]:
    """Return the look of each agent by label; no two agents have the same colour.

    The first eight agents, usually the best-ranked, get the colours that are easiest to tell apart.
    """
    return {
        agent.label: Look(
            colour,
            MARKERS[i % len(MARKERS)],
            LINESTYLES[(i + i // len(COLOURS)) % len(LINESTYLES)],
        )
        for i, (agent, colour) in enumerate(zip(agents, palette(len(agents)), strict=True))
    }


def palette(n: int) -> tuple[str, ...]:
    """Return n different colours: first `COLOURS`, then hues in steps of the golden ratio around the colour circle."""
    hues = [
        hexadecimal(colorsys.hsv_to_rgb(0.618034 * i % 1.0, (0.55, 0.95)[i % 2], (0.75, 0.55, 0.4)[i % 3]))
        for i in range(n - len(COLOURS))
    ]
    return (*COLOURS[:n], *hues)


def hexadecimal(colour: Iterable[float]) -> str:
    """Return a colour (red, green, blue), each from 0 to 1, as hexadecimal text.

    >>> hexadecimal((0.0, 0.5, 1.0))
    '#0080ff'
    """
    return "#" + "".join(f"{round(255 * share):02x}" for share in colour)
