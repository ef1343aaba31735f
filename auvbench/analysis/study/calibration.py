"""How often are the verdicts on the thesis's claims wrong? `python -m auvbench.analysis.study.calibration` measures.

Trainings and tests are simulated in worlds in which it is known what is true, at the very edge between a claim and its
contrary where there is one, and judged by the claims' own functions. Printed are the shares of the three verdicts and
which of them is wrong there.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from auvbench.analysis.model import Agent, RunRecord
from auvbench.analysis.study import thesis
from auvbench.analysis.study.claims import CLAIMS
from auvbench.analysis.study.evidence import Evidence
from auvbench.analysis.study.learning import Learning
from auvbench.analysis.study.verdict import FAILS, HOLDS, OPEN, together
from auvbench.statistics.intervals import FloatArray
from auvbench.statistics.power import Rates

Cell = tuple[float, float]
GRID: tuple[Cell, ...] = tuple(thesis.CELLS.values())
SPREAD = 0.6
"""logits by which simulated trainings of one configuration differ"""
EPISODES = 200


@dataclass(eq=False)
class Simulated(Evidence):
    """Evidence that was drawn: training records and paid paths are handed over instead of read."""

    records: Mapping[str, list[Learning]] = field(default_factory=dict)
    paid: Mapping[str, FloatArray] = field(default_factory=dict)
    """by the agent's label"""

    def learnings(self, family: str) -> list[Learning]:
        return self.records.get(family, [])

    def collected(self, agent: Agent, k: float) -> FloatArray | None:
        return self.paid.get(agent.label)


def run_of(algo: str, cell: Cell, seed: int, steps: int = thesis.STEPS) -> RunRecord:
    """A run that was never carried out."""
    config = {"algo.name": algo, "reward.k": cell[0], "step.frequency": cell[1], "task.max_steps": 1000}
    name = f"{algo}-k{cell[0]:g}-f{cell[1]:g}-s{seed}"
    return RunRecord(name, Path(name), "complete", seed, config, {"steps": steps, "total_steps": steps})


def agents_of(
    algo: str,
    rates: Mapping[Cell, float],
    S: int,
    rng: np.random.Generator,
    *,
    sd: float = SPREAD,
    steps: int = thesis.STEPS,
    metrics: Mapping[Cell, Mapping[str, float]] | None = None,
) -> list[Agent]:
    """Agents of the given true success rates, their trainings `sd` logits apart; other metrics are constants."""
    drawn = Rates(sd).draw(list(rates.values()), S, EPISODES, rng)
    found = []
    for cell, success in zip(rates, drawn, strict=True):
        values = {} if metrics is None else metrics[cell]
        found.append(
            Agent(
                label=f"{algo} K={cell[0]:g} {cell[1]:g} Hz",
                key={"algo": algo, "reward.k": cell[0], "step.frequency": cell[1]},
                runs=tuple(run_of(algo, cell, s, steps) for s in range(S)),
                fingerprint="0" * 16,
                outcome=np.where(success > 0, 0, 2).astype(np.int8),
                metrics={"steps": np.full(success.shape, 300.0)}
                | {name: np.full(success.shape, value) for name, value in values.items()},
            )
        )
    return found


def record_of(cell: Cell, seed: int, at: float = np.inf, top: float = 0.0) -> Learning:
    """Training records of a SAC run that converged at a step, of whose best-rewarded episodes a share fails."""
    return Learning(run_of("sac", cell, seed), thesis.STEPS, 1000.0, at, top)


def cells(value: float, **at: float) -> dict[Cell, float]:
    """The same value in every cell, but for the cells of the thesis's numbers: `cells(0.9, _4=0.95)`."""
    return {cell: at.get(f"_{number}", value) for number, cell in thesis.CELLS.items()}


@dataclass(frozen=True, slots=True)
class World:
    """What is true, which verdicts are wrong there, and how its evidence is drawn."""

    claim: str
    """number and letter of the part, 3b; the number alone is the whole claim"""
    truth: str
    wrong: tuple[str, ...]
    draw: Callable[[int, np.random.Generator], Simulated]


def _evidence(
    agents: Sequence[Agent] = (),
    records: Sequence[Learning] = (),
    paid: Mapping[str, FloatArray] | None = None,
) -> Simulated:
    return Simulated((), list(agents), 0.95, 0, records={"sac": list(records)}, paid=paid or {})


def _converging(shares: Sequence[float]) -> Callable[[int, np.random.Generator], Simulated]:
    """Trainings at 55 Hz of which a share converges, by K."""

    def draw(S: int, rng: np.random.Generator) -> Simulated:
        runs = [
            record_of((k, 55.0), s, 5e5 if rng.random() < share else np.inf)
            for k, share in zip((1.0, 40.0, 100.0), shares, strict=True)
            for s in range(S)
        ]
        return _evidence(records=runs)

    return draw


def _sooner(factor: float) -> Callable[[int, np.random.Generator], Simulated]:
    """Steps to convergence, lognormal, longer by a factor from one frequency to the next."""

    def draw(S: int, rng: np.random.Generator) -> Simulated:
        order = {10.0: 0, 25.0: 1, 55.0: 2}
        runs = [
            record_of(cell, s, 2e5 * factor ** order[cell[1]] * float(rng.lognormal(0, 0.5)))
            for cell in GRID
            for s in range(S)
        ]
        return _evidence(records=runs)

    return draw


def _rates(
    rates: Mapping[Cell, float], sd: float = SPREAD
) -> Callable[[int, np.random.Generator], Simulated]:
    return lambda S, rng: _evidence(agents_of("sac", rates, S, rng, sd=sd))


def _both(
    sac: Mapping[Cell, float], ppo: Mapping[Cell, float], sd: float = SPREAD, steps: int = thesis.STEPS
) -> Callable[[int, np.random.Generator], Simulated]:
    return lambda S, rng: _evidence(
        [
            *agents_of("sac", sac, S, rng, sd=sd, steps=steps),
            *agents_of("ppo", ppo, S, rng, sd=sd, steps=steps),
        ]
    )


def _third(gain: float, more: float, top: float) -> Callable[[int, np.random.Generator], Simulated]:
    """K = 100 against K = 1: success higher by `gain`, reward at equal K by `more`, failing top episodes by `top`."""

    def draw(S: int, rng: np.random.Generator) -> Simulated:
        rates = {cell: 0.8 + gain * (cell[0] == 100.0) for cell in GRID}
        agents = agents_of("sac", rates, S, rng)
        paid = {
            agent.label: 2000.0
            + more * (agent.key["reward.k"] == 100.0)
            + 600 * rng.normal(size=(S, 1))
            + 500 * rng.normal(size=(S, 10))
            for agent in agents
        }
        records = [
            record_of(cell, s, 5e5, float(np.clip(0.3 + top * cell[0] / 100 + 0.2 * rng.normal(), 0, 1)))
            for cell in GRID
            for s in range(S)
        ]
        return _evidence(agents, records, paid)

    return draw


def _generalising(
    rates: Sequence[float], superiority: float, noise: float
) -> Callable[[int, np.random.Generator], Simulated]:
    """SAC runs of which every other cell's converged.

    Those that did not have one of these rates, drawn for each, with normal noise on its logit; those that did have a
    logit about one of them that is larger with the probability `superiority`, where the noise is 1.
    """

    def draw(S: int, rng: np.random.Generator) -> Simulated:
        from scipy.special import expit, logit, ndtri

        found: list[Agent] = []
        records = []
        for i, cell in enumerate(GRID):
            (agent,) = agents_of("sac", {cell: 0.5}, S, rng)
            converged = i % 2 == 0
            level = logit(rng.choice(rates, size=S))
            if converged:
                level = level + np.sqrt(2) * ndtri(superiority) + rng.normal(size=S)
            else:
                level = level + noise * rng.normal(size=S)
            success = rng.random((S, EPISODES)) < expit(level)[:, None]
            found.append(replace(agent, outcome=np.where(success, 0, 2).astype(np.int8)))
            records += [record_of(cell, s, 5e5 if converged else np.inf) for s in range(S)]
        return _evidence(found, records)

    return draw


def _points(rho: float, n: int) -> Callable[[int, np.random.Generator], Simulated]:
    """As many agents whose mean deviation and steps correlate so (Spearman's, of a bivariate normal)."""

    def draw(S: int, rng: np.random.Generator) -> Simulated:
        r = 2 * np.sin(np.pi * rho / 6)
        x = rng.normal(size=n)
        y = r * x + np.sqrt(1 - r * r) * rng.normal(size=n)
        rates = {(float(i), 25.0): 0.8 for i in range(n)}
        metrics = {
            cell: {"deviation_mean_m": 3 + 0.1 * float(a), "steps": 300 + 10 * float(b)}
            for cell, a, b in zip(rates, x, y, strict=True)
        }
        return _evidence(agents_of("sac", rates, S, rng, metrics=metrics))

    return draw


BOTH = (HOLDS, FAILS)
HIGH = {cell: (0.9, 0.9, 0.6)[(10.0, 25.0, 55.0).index(cell[1])] for cell in GRID}

WORLDS: tuple[World, ...] = (
    World("1", "half of the trainings converge, whatever K", BOTH, _converging([0.5, 0.5, 0.5])),
    World("1", "half of those with K=1 converge, no other", BOTH, _converging([0.5, 0.0, 0.0])),
    World("1", "20 % of the trainings converge", (FAILS,), _converging([0.2, 0.2, 0.2])),
    World("1", "none converges", (FAILS,), _converging([0.0, 0.0, 0.0])),
    World("1", "90 % converge", (HOLDS,), _converging([0.9, 0.9, 0.9])),
    World("2", "the frequency changes nothing", BOTH, _sooner(1.0)),
    World("2", "each higher frequency takes 1.5 times the steps", (FAILS,), _sooner(1.5)),
    World("3a", "K changes nothing but the pay", BOTH, _third(0.0, 0.0, 0.0)),
    World("3a", "2000 more at equal K", (FAILS,), _third(0.0, 2000.0, 0.0)),
    World("3b", "a gain of 5 points", BOTH, _third(0.05, 0.0, 0.0)),
    World("3b", "no gain", (FAILS,), _third(0.0, 0.0, 0.0)),
    World("3b", "a gain of 15 points", (HOLDS,), _third(0.15, 0.0, 0.0)),
    World("3c", "K changes nothing", BOTH, _third(0.0, 0.0, 0.0)),
    World("3c", "0.4 more of the top fail at K=100", (FAILS,), _third(0.0, 0.0, 0.4)),
    World("3", "all three at their edge", BOTH, _third(0.05, 0.0, 0.0)),
    World("4a", "all cells alike", BOTH, _rates(cells(0.85))),
    World("4a", "SAC4 99 %, the others 70 %", (FAILS,), _rates(cells(0.7, _4=0.99))),
    World("4b", "all cells alike", BOTH, _rates(cells(0.85))),
    World("4b", "all cells alike, seeds 1.5 logits apart", BOTH, _rates(cells(0.85), 1.5)),
    World("4", "all cells alike", BOTH, _rates(cells(0.85))),
    World("5a", "trainings that did not converge test at 80 %", (HOLDS,), _generalising([0.8], 0.5, 0.0)),
    World("5a", "half of them at 70, half at 90 %", (FAILS,), _generalising([0.7, 0.9], 0.5, 0.0)),
    World("5b", "a converged run is better in 75 %", (HOLDS,), _generalising([0.6], 0.75, 1.0)),
    World("5b", "a converged run is better in 50 %", (FAILS,), _generalising([0.6], 0.5, 1.0)),
    World("6", "rho 0.5, 9 agents", (HOLDS,), _points(0.5, 9)),
    World("6", "rho 0, 9 agents", (FAILS,), _points(0.0, 9)),
    World("6", "rho 0.5, 27 agents", (HOLDS,), _points(0.5, 27)),
    World("6", "rho 0, 27 agents", (FAILS,), _points(0.0, 27)),
    World("7a", "both lose 30 points", BOTH, _both(HIGH, HIGH)),
    World("7b", "SAC and PPO alike", BOTH, _both(cells(0.85), cells(0.85))),
    World("7c", "PPO at 25 Hz succeeds in half", BOTH, _both(cells(0.85), cells(0.85, _4=0.5))),
    World("7", "all three at their edge", BOTH, _both(cells(0.85), cells(0.85, _4=0.5))),
    World("3", "nobody learned anything", BOTH, _rates(cells(0.03))),
    World("4b", "nobody learned anything", BOTH, _rates(cells(0.03))),
    World("6", "nobody learned anything", BOTH, _rates(cells(0.03))),
    World("7", "nobody learned anything, 20,000 steps", BOTH, _both(cells(0.03), cells(0.03), steps=20_000)),
)


def shares(world: World, S: int, replications: int, seed: int = 0) -> dict[str, float]:
    """By verdict the share of simulated studies with S training seeds a cell."""
    rng = np.random.default_rng([seed, S])
    claim = CLAIMS[int(world.claim[0]) - 1]
    counts: Counter[str] = Counter()
    for _ in range(replications):
        parts = claim.parts(world.draw(S, rng))
        if len(world.claim) > 1:
            counts[parts["abcdef".index(world.claim[1])].verdict] += 1
        else:
            counts[together(claim.text, parts).verdict] += 1
    return {verdict: counts[verdict] / replications for verdict in (HOLDS, FAILS, OPEN)}


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table of docs/claims.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--replications", type=int, default=400)
    parser.add_argument("--seeds", type=int, nargs="+", default=[3, 5, 10])
    parser.add_argument("--claim", default="", help="only worlds of this claim or part")
    options = parser.parse_args(argv)
    print("| claim | what is true | seeds a cell | holds | does not hold | cannot be said |")
    print("|---|---|---:|---:|---:|---:|")
    for world in WORLDS:
        if not world.claim.startswith(options.claim):
            continue
        for S in options.seeds:
            found = shares(world, S, options.replications)
            told = [
                f"{100 * found[v]:.1f}{' (wrong)' if v in world.wrong else ''}" for v in (HOLDS, FAILS, OPEN)
            ]
            print(f"| {world.claim} | {world.truth} | {S} | {' | '.join(told)} |", flush=True)


if __name__ == "__main__":
    main()
