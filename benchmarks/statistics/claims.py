"""How often the verdicts on the original study's claims are wrong.

Studies are drawn in worlds in which it is known what is true, at the very edge between a claim and its contrary where
there is one, and judged by the claims' own functions (`auvbench.analysis.study`).
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from auvbench.analysis.study import CLAIMS
from auvbench.analysis.study.verdict import FAILS, HOLDS, OPEN, together
from benchmarks.statistics.studies import (
    GRID,
    Draw,
    cells,
    converging,
    generalising,
    points,
    sac_alone,
    sac_and_ppo,
    sooner,
    third,
)

VERDICTS = (HOLDS, FAILS, OPEN)
EITHER = (HOLDS, FAILS)
HIGH = {cell: (0.9, 0.9, 0.6)[(10.0, 25.0, 55.0).index(cell[1])] for cell in GRID}


@dataclass(frozen=True, slots=True)
class World:
    """What is true, how a study there is drawn, and what is asked of it."""

    truth: str
    draw: Draw
    wrong: dict[str, tuple[str, ...]]
    """by claim the verdicts that are wrong there: of a part, 3b, or of the whole claim, 3"""


WORLDS: tuple[World, ...] = (
    World("half of the trainings converge, for any K", converging([0.5, 0.5, 0.5]), {"1": EITHER}),
    World("half of those with K=1 converge, no other", converging([0.5, 0.0, 0.0]), {"1": EITHER}),
    World("20 % of the trainings converge", converging([0.2, 0.2, 0.2]), {"1": (FAILS,)}),
    World("none converges", converging([0.0, 0.0, 0.0]), {"1": (FAILS,)}),
    World("90 % converge", converging([0.9, 0.9, 0.9]), {"1": (HOLDS,)}),
    World("the frequency changes nothing", sooner(1.0), {"2": EITHER}),
    World("each higher frequency takes 1.5 times the steps", sooner(1.5), {"2": (FAILS,)}),
    World(
        "K changes nothing but the pay",
        third(0.0, 0.0, 0.0),
        {"3a": EITHER, "3b": (FAILS,), "3c": EITHER},
    ),
    World("2000 more at equal K", third(0.0, 2000.0, 0.0), {"3a": (FAILS,)}),
    World("a gain of 5 points, nothing else", third(0.05, 0.0, 0.0), {"3b": EITHER, "3": EITHER}),
    World("a gain of 15 points", third(0.15, 0.0, 0.0), {"3b": (HOLDS,)}),
    World("0.4 more of the top fail at K=100", third(0.0, 0.0, 0.4), {"3c": (FAILS,)}),
    World("all cells alike", sac_alone(cells(0.85)), {"4a": EITHER, "4b": EITHER, "4": EITHER}),
    World("all cells alike, seeds 1.5 logits apart", sac_alone(cells(0.85), 1.5), {"4b": EITHER}),
    World("SAC4 99 %, the others 70 %", sac_alone(cells(0.7, _4=0.99)), {"4a": (FAILS,)}),
    World("trainings that did not converge test at 80 %", generalising([0.8], 0.5, 0.0), {"5a": (HOLDS,)}),
    World("half of them at 70, half at 90 %", generalising([0.7, 0.9], 0.5, 0.0), {"5a": (FAILS,)}),
    World("a converged run is better in 75 %", generalising([0.6], 0.75, 1.0), {"5b": (HOLDS,)}),
    World("a converged run is better in 50 %", generalising([0.6], 0.5, 1.0), {"5b": (FAILS,)}),
    World(
        "a converged run is better in 75 %, cells differ",
        generalising([0.6], 0.75, 1.0, 1.3),
        {"5b": (HOLDS,)},
    ),
    World(
        "a converged run is better in 50 %, cells differ",
        generalising([0.6], 0.5, 1.0, 1.3),
        {"5b": (FAILS,)},
    ),
    World("rho 0.5, 9 agents", points(0.5, 9), {"6": (HOLDS,)}),
    World("rho 0, 9 agents", points(0.0, 9), {"6": (FAILS,)}),
    World("rho 0.5, 27 agents", points(0.5, 27), {"6": (HOLDS,)}),
    World("rho 0, 27 agents", points(0.0, 27), {"6": (FAILS,)}),
    World("both lose 30 points", sac_and_ppo(HIGH, HIGH), {"7a": EITHER}),
    World("SAC and PPO alike", sac_and_ppo(cells(0.85), cells(0.85)), {"7b": EITHER}),
    World(
        "SAC and PPO alike, but PPO at 25 Hz succeeds in half",
        sac_and_ppo(cells(0.85), cells(0.85, _4=0.5)),
        {"7c": EITHER, "7": EITHER},
    ),
    World("no agent learned anything", sac_alone(cells(0.03)), dict.fromkeys(("3", "4b", "6"), EITHER)),
    World(
        "no agent learned anything, 20,000 steps",
        sac_and_ppo(cells(0.03), cells(0.03), steps=20_000),
        {"7": EITHER},
    ),
)


def shares(world: World, S: int, replications: int, seed: int = 0) -> dict[str, dict[str, float]]:
    """By claim and verdict the share of simulated studies with S training seeds a cell."""
    rng = np.random.default_rng([seed, S])
    counts: dict[str, Counter[str]] = {asked: Counter() for asked in world.wrong}
    numbers = {int(asked[0]) for asked in world.wrong}
    for _ in range(replications):
        evidence = world.draw(S, rng)
        parts = {number: CLAIMS[number - 1].parts(evidence) for number in numbers}
        for asked, count in counts.items():
            number, letter = int(asked[0]), asked[1:]
            judged = parts[number]
            whole = together(CLAIMS[number - 1].text, judged)
            count[judged["abcdef".index(letter)].verdict if letter else whole.verdict] += 1
    return {
        asked: {verdict: count[verdict] / replications for verdict in VERDICTS}
        for asked, count in counts.items()
    }
