"""Agents made of arrays, without run directories, for the tests of statistics, ranking and findings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.special import expit

from auvbench.analysis.records import Agent, RunRecord
from auvbench.analysis.sources import RunFolder

CONTROLLERS = ("pid", "lqr", "mpc", "random")
"""these have nothing to learn; any other name is a learner's"""


def record(algo: str, k: float, f: float, seed: int, **manifest) -> RunRecord:
    config = {"algo.name": algo, "reward.k": k, "step.frequency": f, "task.max_steps": 1000}
    name = f"{algo}-k{k:g}-f{f:g}-s{seed}-00000000"
    steps = 0 if algo in CONTROLLERS else 1_000_000
    manifest = {
        "id": name,
        "state": "complete",
        "steps": steps,
        "total_steps": steps,
        "cpu_time_s": 0.0,
    } | manifest
    return RunRecord(name, RunFolder(Path("nowhere") / name), "complete", seed, config, manifest)


def agent(
    algo: str = "sac",
    k: float = 1.0,
    f: float = 25.0,
    *,
    level: float = 1.5,
    steps: float = 300.0,
    seeds: int = 8,
    episodes: int = 200,
    seed_sd: float = 0.3,
    label: str | None = None,
) -> Agent:
    """Success by a logistic model with the logit `level`; the scenarios are the same for all agents."""
    world = np.random.default_rng(123)
    difficulty = world.normal(size=episodes)
    waypoint = world.uniform([-20, -20, -60], [20, 20, -1], size=(episodes, 3))
    rng = np.random.default_rng([ord(algo[0]), round(k), round(f), seeds])
    logit = level + seed_sd * rng.normal(size=(seeds, 1)) - difficulty
    success = rng.random((seeds, episodes)) < expit(logit)
    collision = ~success & (rng.random((seeds, episodes)) < 0.4)
    taken = np.where(
        success, steps * rng.lognormal(0, 0.2, success.shape), np.where(collision, 150.0, 1000.0)
    )
    metrics = {
        "steps": np.round(np.minimum(taken, 1000)),
        "duration_s": np.round(np.minimum(taken, 1000)) / 10,
        "return": 500.0 * success + k * taken * 0.4,
        "deviation_mean_m": rng.gamma(4, 0.6, success.shape),
        "final_distance_m": np.where(success, 2.8, 12.0),
        "initial_distance_m": np.tile(np.linalg.norm(waypoint - np.array([0, 0, -20.0]), axis=1), (seeds, 1)),
        "waypoint_z_m": np.tile(waypoint[:, 2], (seeds, 1)),
    }
    return Agent(
        label=label or f"{algo.upper()} K={k:g} {f:g} Hz",
        key={"algo": algo, "reward.k": k, "step.frequency": f},
        runs=tuple(record(algo, k, f, s) for s in range(seeds)),
        fingerprint="0123456789abcdef",
        outcome=np.where(success, 0, np.where(collision, 1, 2)).astype(np.int8),
        metrics=metrics,
        step_limit=1000.0,
    )
