"""Simulated studies: trainings and tests drawn from worlds of which the truth is known."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from auvbench.analysis.records import Agent, RunRecord
from auvbench.analysis.study import thesis
from auvbench.analysis.study.evidence import Evidence
from auvbench.analysis.study.learning import Episodes, Learning
from auvbench.statistics.power import Rates
from benchmarks.statistics.worlds import FloatArray

Cell = tuple[float, float]
GRID: tuple[Cell, ...] = tuple(thesis.CELLS.values())
SPREAD = 0.6
"""logits by which simulated trainings of one configuration differ"""
EPISODES = 200

Draw = Callable[[int, np.random.Generator], "Simulated"]
"""f(training seeds a cell, random numbers) -> the evidence of one study"""


@dataclass(eq=False)
class Simulated(Evidence):
    """Evidence that was drawn: training records and paid paths are given instead of read; every limit is attainable."""

    records: Mapping[str, list[Learning]] = field(default_factory=dict)
    paid: Mapping[str, FloatArray] = field(default_factory=dict)
    """by the agent's label"""

    def learnings(self, family: str) -> list[Learning]:
        return self.records.get(family, [])

    def collected(self, agent: Agent, k: float) -> FloatArray | None:
        return self.paid.get(agent.label)

    def failing_top_by_k(self, agent: Agent, ks: Sequence[float]) -> dict[float, float] | None:
        return dict.fromkeys(ks, 0.5)

    def attainable(self, limit: float) -> bool:
        return True


@dataclass(frozen=True, slots=True)
class Drawn(Learning):
    """Training records of which only the date of convergence is drawn."""

    at: float = np.inf

    def converged_at(self, limit: float) -> float:
        return self.at


NO_EPISODES = Episodes(np.zeros(0), np.zeros(0, dtype=np.bool_), np.zeros(0))


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
    return Drawn(run_of("sac", cell, seed), thesis.STEPS, NO_EPISODES, top, at)


def cells(value: float, **at: float) -> dict[Cell, float]:
    """The same value in every cell, but for the cells of the thesis's numbers: `cells(0.9, _4=0.95)`."""
    return {cell: at.get(f"_{number}", value) for number, cell in thesis.CELLS.items()}


def evidence(
    agents: Sequence[Agent] = (),
    records: Sequence[Learning] = (),
    paid: Mapping[str, FloatArray] | None = None,
) -> Simulated:
    return Simulated((), list(agents), 0.95, 0, records={"sac": list(records)}, paid=paid or {})


def converging(shares: Sequence[float]) -> Draw:
    """Trainings at 55 Hz of which a share converges, by K."""

    def draw(S: int, rng: np.random.Generator) -> Simulated:
        runs = [
            record_of((k, 55.0), s, 5e5 if rng.random() < share else np.inf)
            for k, share in zip((1.0, 40.0, 100.0), shares, strict=True)
            for s in range(S)
        ]
        return evidence(records=runs)

    return draw


def sooner(factor: float) -> Draw:
    """Steps to convergence, lognormal, longer by a factor from one frequency to the next."""

    def draw(S: int, rng: np.random.Generator) -> Simulated:
        order = {10.0: 0, 25.0: 1, 55.0: 2}
        runs = [
            record_of(cell, s, 2e5 * factor ** order[cell[1]] * float(rng.lognormal(0, 0.5)))
            for cell in GRID
            for s in range(S)
        ]
        return evidence(records=runs)

    return draw


def sac_alone(rates: Mapping[Cell, float], sd: float = SPREAD) -> Draw:
    return lambda S, rng: evidence(agents_of("sac", rates, S, rng, sd=sd))


def sac_and_ppo(
    sac: Mapping[Cell, float], ppo: Mapping[Cell, float], sd: float = SPREAD, steps: int = thesis.STEPS
) -> Draw:
    return lambda S, rng: evidence(
        [
            *agents_of("sac", sac, S, rng, sd=sd, steps=steps),
            *agents_of("ppo", ppo, S, rng, sd=sd, steps=steps),
        ]
    )


def third(gain: float, more: float, top: float) -> Draw:
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
        return evidence(agents, records, paid)

    return draw


def generalising(rates: Sequence[float], superiority: float, noise: float, shared: float = 0.0) -> Draw:
    """SAC runs of which half, drawn at random, converged.

    Those that did not have one of these rates, drawn for each, with normal noise on its logit; those that did have a
    logit about one of them that is larger with the probability `superiority`, where the noise is 1. The runs of a cell
    share a normal effect with the standard deviation `shared`.
    """

    def draw(S: int, rng: np.random.Generator) -> Simulated:
        from scipy.special import expit, logit, ndtri

        found: list[Agent] = []
        records = []
        for cell in GRID:
            (agent,) = agents_of("sac", {cell: 0.5}, S, rng)
            converged = rng.random(S) < 0.5
            spread = np.where(converged, 1.0, noise)
            gain = np.where(converged, np.sqrt(2) * ndtri(superiority), 0.0)
            level = (
                logit(rng.choice(rates, size=S)) + gain + spread * rng.normal(size=S) + shared * rng.normal()
            )
            success = rng.random((S, EPISODES)) < expit(level)[:, None]
            found.append(replace(agent, outcome=np.where(success, 0, 2).astype(np.int8)))
            records += [record_of(cell, s, 5e5 if converged[s] else np.inf) for s in range(S)]
        return evidence(found, records)

    return draw


def points(rho: float, n: int) -> Draw:
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
        return evidence(agents_of("sac", rates, S, rng, metrics=metrics))

    return draw
