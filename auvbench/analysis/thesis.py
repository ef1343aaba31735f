"""Provide the original study's results: its test table, and the cells of its agents in the grid.

The study used 200 test episodes at 10 Hz, one training seed (42) and 1,000,000 training steps. Values that are
unreadable in its scan were restored from sums (rates add up to 100; mean sum = mean norm x mean steps); they
are marked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from auvbench.analysis.measures import measure
from auvbench.analysis.records import Agent
from auvbench.statistics import means
from auvbench.statistics.intervals import Estimate

STEPS = 1_000_000
"""training steps of every agent of the original study"""
HIGH_FREQUENCY = 55.0
"""frequency in Hz at which the original study's agents did not converge"""

CELLS: dict[str, tuple[float, float]] = {
    "0": (40.0, 25.0),
    "1": (1.0, 55.0),
    "2": (40.0, 55.0),
    "3": (100.0, 55.0),
    "4": (1.0, 25.0),
    "5": (100.0, 25.0),
    "6": (1.0, 10.0),
    "7": (40.0, 10.0),
    "8": (100.0, 10.0),
}
"""K, and frequency in Hz, of the study's SAC_i and PPO_i"""

FACTORS = {"algo": "algo.name", "reward.k": "reward.k", "step.frequency": "step.frequency"}
"""factors of the grid, by the short name in an agent's key"""

AGENTS = ("SAC0", "SAC1", "SAC2", "SAC3", "SAC4", "SAC5", "SAC6", "SAC7", "PPO4", "PPO6", "PPO7")


@dataclass(frozen=True, slots=True)
class Reported:
    """One number of the original study."""

    value: float
    mark: str = ""
    """mark: 'r' for a value restored from sums; 'text' for a value from the study's text, not from its table"""


def _row(values: str) -> dict[str, Reported]:
    cells = (value.partition(":") for value in values.split())
    return {
        agent: Reported(float(number), mark)
        for agent, (number, _, mark) in zip(AGENTS, cells, strict=True)
        if number != "-"
    }


TABLE: dict[str, dict[str, Reported]] = {
    "success_rate": _row("98.0 54.5 98.2 94.0:r 100 97.0 90.5 86.0 28.5 99.0 95:text"),
    "collision_rate": _row("0.5 1.5:r 0 1.5:r 0 0.5 0 1.5:r 6.0 1.0 -"),
    "timeout_rate": _row("1.5 44.0 1.8 4.5 0 2.5:r 9.5 12.5 65.5 0 -"),
    "mean_steps": _row("330.14 600.58 351.85 350.69 282.19 384.9 543.11 489.69 831.17 316.92 -"),
    "mean_deviation_mean_m": _row(
        "2.669258 3.250245 2.971181 2.636701 2.618003 2.691143 2.208843 2.751402 6.19 3.75 -"
    ),
    "mean_deviation_std_m": _row(
        "1.434752 1.417536 1.728377 1.312608 1.43048 1.245472 1.245472 0.991807 3.28 3.24 -"
    ),
    "mean_command_norm_mean_N": _row("33.35 32.95 35.97 37.01 36.57 34.89 34.67 29.23 31.75:r 39.74 -"),
    "mean_command_norm_sum_N": _row(
        "11009.2 19786.81 12654.93 12979.35 10320.23 13429.88 18832.15 14313.92 26390.45 12595.05 -"
    ),
}
"""the study's numbers, by our measure and the study's agent; rates in percent. SAC5 and SAC6 have the same
printed deviation_std, so one of the two is a misprint.
"""

TITLES = {
    "success_rate": "success, %",
    "collision_rate": "collision, %",
    "timeout_rate": "timeout, %",
    "mean_steps": "mean steps",
    "mean_deviation_mean_m": "mean deviation, m",
    "mean_deviation_std_m": "std of deviation, m",
    "mean_command_norm_mean_N": "mean norm u, N",
    "mean_command_norm_sum_N": "mean sum norm u, N",
}


@dataclass(frozen=True, slots=True)
class ComparisonRow:
    """A number of the original study, and our estimate of it."""

    agent: str
    """name in the original study, e.g. SAC4"""
    label: str
    """our label; '' if the cell was not run"""
    measure: str
    theirs: Reported
    """the study's number; rates in percent"""
    ours: Estimate | None
    """our estimate; rates in percent"""


def compare(agents: Sequence[Agent], confidence: float = 0.95) -> tuple[ComparisonRow, ...]:
    """Return every number of the study's table, with our estimate for the same algorithm, K and training frequency."""
    labelled = [with_factors(agent) for agent in agents]
    ours = {metric: _estimates(metric, agents, confidence) for metric in TABLE}
    rows = []
    for name in AGENTS:
        labels = [a.label for a in of_family(labelled, name[:3].lower()) if cell(a) == CELLS[name[3:]]]
        label = labels[0] if len(labels) == 1 else ""
        rows += [
            ComparisonRow(name, label, metric, row[name], ours[metric].get(label))
            for metric, row in TABLE.items()
            if name in row
        ]
    return tuple(rows)


def _estimates(metric: str, agents: Sequence[Agent], confidence: float) -> dict[str, Estimate]:
    """Return our estimates by label; rates in percent."""
    m = measure(metric)
    estimates = means(m.table(agents, paired=False), confidence) if agents else []
    return {
        agent.label: replace(e, value=m.scale * e.value, low=m.scale * e.low, high=m.scale * e.high)
        for agent, e in zip(agents, estimates, strict=True)
    }


def with_factors(agent: Agent) -> Agent:
    """Return the agent with all factors of the grid in its key, taken from its runs.

    The value of a factor is None if the runs differ in it.
    """
    key = dict(agent.key)
    for short, full in FACTORS.items():
        if key.get(short) is None:
            values = {run.config.get(full) for run in agent.runs}
            key[short] = values.pop() if len(values) == 1 else None
    return replace(agent, key=key)


def cell(agent: Agent) -> tuple[float, float]:
    """Return K and training frequency of an agent; NaN if its runs differ."""
    k, f = agent.key["reward.k"], agent.key["step.frequency"]
    return (float("nan") if k is None else float(k), float("nan") if f is None else float(f))


def of_family(agents: Sequence[Agent], family: str) -> list[Agent]:
    """Return the agents of an algorithm; if any has the original study's settings (`sac_thesis`), only these agents."""
    names = {str(agent.key["algo"]) for agent in agents}
    name = f"{family}_thesis" if f"{family}_thesis" in names else family
    return [agent for agent in agents if agent.key["algo"] == name]
