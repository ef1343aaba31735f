"""Print the table of docs/safety.md: transit with and without the filter `cbf` (a quarter of an hour of one core).

`python -m benchmarks.safety --episodes 100` takes a tenth of the time.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from auvbench.agents.base import learner_of, make
from auvbench.config import schema
from auvbench.envs.batch import Batch, Transition
from auvbench.envs.settings import configuration
from auvbench.evaluation.rollout import roll_out
from auvbench.record import Record
from auvbench.statistics.intervals import wilson
from auvbench.vehicles import sheet

BLIND = "task.observation=[position_error,yaw_error,velocity,angular_velocity,gravity,previous_action]"
TOGETHER = 50
"""episodes that are simulated at a time"""
SEED = 123
COLUMNS = (
    *("agent", "filter", "collisions", "rate, %", "success, %", "PAR-1 time, s", "smallest clearance, m"),
    *("steps changed, %", "infeasible steps"),
)

CURRENT = "disturbance.current.speed"
CASES: dict[str, tuple[str, ...]] = {
    "PID without a sonar": ("algo=pid", BLIND),
    **{
        f"the same, current {speed:g} m/s": ("algo=pid", BLIND, f"{CURRENT}={speed:g}")
        for speed in (0.25, 0.5, 1.0)
    },
    "PPO without a sonar, in training": ("algo=ppo_fast", BLIND),
    "PID with a sonar": ("algo=pid",),
    "PID with ideal rays": ("algo=pid", BLIND.replace("]", ",range.ideal]")),
}
FILTERS = {"none": (), "cbf": (), "cbf, ranges": ("filter.knows=ranges",)}
"""by the name in the table: overrides; the last one needs ideal rays"""
SONAR_SHARE = 5
"""a row with a sonar, whose rays take most of the time, has this share of the episodes"""


@dataclass
class Training:
    """A training whose records are kept in memory; see `agents.base.Callbacks`."""

    total_steps: int
    records: list[Record] = field(default_factory=list)

    def begin(self) -> int:
        return 0

    def step(self, steps: int, transition: Transition) -> float:
        self.records += transition.records
        return 0.0

    def checkpoint(self, steps: int) -> None:
        pass

    def log(self, scalars: Any, steps: int) -> None:
        pass


def records_of(config: schema.TrainConfig, episodes: int) -> list[Record]:
    """Return the records of a controller's first episodes, or of the first ones of a training, whose commands are random at first."""
    vehicle = sheet.load(config.vehicle)
    if config.algo.agent != "ppo":
        chosen = np.arange(episodes)
        return roll_out(config, make(config, vehicle), episodes=chosen, seed=SEED, batch=TOGETHER).records
    rounds, n = -(-episodes // config.algo.n_envs), config.algo.n_envs
    training = Training(rounds * n * schema.step_limit(config.task, config.step.frequency))
    learner_of(config, vehicle).learn(Batch(config), config, training)
    first = [record for record in training.records if int(record["episode"]) < rounds]
    return sorted(first, key=lambda record: (record["episode"], record["environment"]))[:episodes]


def rows(episodes: int, agents: str) -> Iterator[tuple[str, ...]]:
    """Yield the rows of the table, of agents with a text in their names."""
    for name, words in CASES.items():
        count = episodes if BLIND in words else max(1, episodes // SONAR_SHARE)
        for chosen, more in FILTERS.items() if agents in name else ():
            if more and "ideal" not in name:
                continue
            config = configuration(
                overrides=["task=transit", f"filter={chosen.partition(',')[0]}", *words, *more]
            )
            yield name, chosen, *_cells(records_of(config, count), config.task.time_limit)


def _cells(records: list[Record], limit: float) -> Iterator[str]:
    """Yield the cells of a row from the records of its episodes; a failure takes the time limit in s."""
    numbers = {key: np.array([record[key] for record in records]) for key in records[0]}
    hits = int((numbers["outcome"] == "collision").sum())
    success = numbers["outcome"] == "success"
    low, high = (100.0 * float(bound) for bound in wilson(hits, len(records)))
    yield f"{hits} of {len(records)}"
    yield f"{low:.1f} to {high:.1f}"
    yield f"{100.0 * success.mean():.1f}"
    yield f"{np.where(success, numbers['duration_s'], limit).mean():.1f}"
    yield f"{numbers['clearance_min_m'].min():.2f}"
    if "intervention_share" in numbers:
        yield f"{100.0 * numbers['intervention_share'].mean():.1f}"
        yield f"{numbers['infeasible_steps'].sum():.0f}"
    else:
        yield from ("", "")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.safety", description=__doc__)
    parser.add_argument("--episodes", type=int, default=1000, help="of a row (default: 1000)")
    parser.add_argument("--agents", default="", help="only rows with this text in the agent's name")
    given = parser.parse_args()
    print(f"| {' | '.join(COLUMNS)} |")
    print(f"|---|---|{'---:|' * (len(COLUMNS) - 2)}")
    for row in rows(given.episodes, given.agents):
        print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
