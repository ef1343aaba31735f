"""Compute the bounds of each scenario of a protocol with worker processes.

Each finished search is saved, so that an interrupted computation can continue.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.base import Agent
from auvbench.agents.classical.mpc import MPCController
from auvbench.agents.classical.pid import controller
from auvbench.config import schema, simulators
from auvbench.config.compose import compose
from auvbench.config.validate import train_config
from auvbench.envs.batch import Batch
from auvbench.errors import ConfigError
from auvbench.evaluation.bounds.command_replay import Scenario, scenarios, silent
from auvbench.evaluation.bounds.files import (
    Bound,
    Limits,
    Solution,
    Summary,
    folder_of,
    line_of,
    packed,
    read_finished,
    write,
)
from auvbench.evaluation.bounds.lower_bound import Energy
from auvbench.evaluation.bounds.search import VERSION, Search
from auvbench.evaluation.protocol import ResolvedCondition, fingerprint, fingerprint_parts, resolve_conditions
from auvbench.evaluation.rollout import batch_of, one_episode
from auvbench.runs import interruption, lock
from auvbench.runs.atomic_io import make_folder, storage, write_atomic
from auvbench.runs.identity import digest_of
from auvbench.runs.pool import Pool, WorkerDiedError
from auvbench.vehicles import sheet
from auvbench.vehicles.symbolic import symbolic

PRELOAD = ("auvbench.evaluation.bounds.compute", "casadi")
"""Modules that the pool's workers import at the start."""

CONTROLLERS = {"pid": controller, "mpc": MPCController, "mpc_tuned": MPCController}
"""Controllers by algorithm. A search starts from the controllers' trajectories; their times are upper bounds, too."""

Floats = NDArray[np.float64]
Job = tuple[schema.TrainConfig, schema.Protocol, int, Scenario]
"""Arguments of a search: configuration of the condition, protocol, number of the episode, scenario of the episode"""


def eligible(conditions: Sequence[ResolvedCondition]) -> tuple[list[ResolvedCondition], list[str]]:
    """Return the conditions that have bounds, and a line with the reason for each condition without bounds.

    Raises:
        ConfigError: no condition has bounds.
    """
    good, refused = [], []
    for condition in conditions:
        if why := _why_not(condition):
            refused.append(f"{condition.name}: {why}")
        else:
            good.append(condition)
    if not good:
        raise ConfigError(f"no condition has a bound: {'; '.join(refused[:3])}")
    return good, refused


def _why_not(condition: ResolvedCondition) -> str:
    config = condition.config
    if not isinstance(config.simulator, simulators.Fossen):
        return f"simulator={config.simulator.name}: bounds use the equations of simulator=fossen; choose simulator=fossen"
    if not condition.fixed_frequency:
        return (
            "protocol.frequency is not set, since each agent uses its own; set it, e.g. protocol.frequency=10"
        )
    batch = Batch(silent(config), 1, seed=0, test=True, autoreset=False)
    if batch.disturbances is not None:
        return (
            f"disturbance={config.disturbance.name}: bounds exist only for still water and a healthy vehicle"
        )
    return ""


def compute(
    protocol: schema.Protocol,
    config: dict[str, Any],
    root: Path,
    pool: Pool,
    tell: Callable[[Bound], None] = lambda bound: None,
) -> Limits:
    """Compute the bounds of a protocol for a vehicle and write them to `<root>/<protocol>-<vehicle>`.

    Args:
        protocol: protocol that defines the scenarios.
        config: resolved configuration with the vehicle and the simulator.
        root: folder of bounds; also stores the finished searches until all searches are finished.
        pool: workers of the searches; the result does not depend on their number.
        tell: function called with each bound, including bounds of an earlier, interrupted call.

    Raises:
        ConfigError: no condition has bounds, or the symbolic equations do not cover the vehicle.
        MissingExtraError: CasADi is not installed.
        TrainingError: a worker was killed, or the disk failed.
        RunError: another process computes the same bounds.
        Interrupted: a signal arrived; finished searches are saved.
    """
    conditions = resolve_conditions(protocol, config)
    good, left_out = eligible(conditions)
    for condition in good:  # if an equation is missing, raise the error before writing any file
        symbolic(sheet.load(condition.config.vehicle))
    parts = fingerprint_parts(protocol, conditions)
    vehicle = str(config["vehicle"]["name"])
    folder = folder_of(root, protocol.name, vehicle)
    place = folder.with_name(f".{folder.name}")
    with storage(f"cannot write {place}"):
        make_folder(place)
    with lock.acquire(place):
        bounds = []
        for number, condition in enumerate(good):
            # The file names contain a digest of the scenarios, so finished searches for other scenarios are not read.
            stem = f"{digest_of([VERSION, parts], 16)}-{number}"
            bounds += _bounds(condition, protocol, place, stem, pool, tell)
        about = Summary(protocol.name, vehicle, fingerprint(protocol, conditions), parts, left_out)
        limits = Limits(about, tuple(bounds))
        write(folder, limits)
        for path in place.glob("*-*.json"):
            path.unlink()
    return limits


def _bounds(
    condition: ResolvedCondition,
    protocol: schema.Protocol,
    place: Path,
    stem: str,
    pool: Pool,
    tell: Callable[[Bound], None],
) -> list[Bound]:
    config, frequency = condition.config, condition.config.step.frequency
    energy = Energy(sheet.load(config.vehicle), config.task.goal_radius)
    positions = all_scenarios(condition, protocol)
    done: dict[int, Bound] = {}
    for episode in range(len(positions)):
        if (bound := read_finished(place / f"{stem}-{episode}.json")) is not None:
            done[episode] = bound
            tell(bound)
    jobs = {e: (config, protocol, e, s) for e, s in enumerate(positions) if e not in done}
    for episode, result in _searched(jobs, pool):
        done[episode] = bound = Bound(
            condition.name,
            frequency,
            episode,
            result.steps,
            energy.steps(positions[episode], frequency),
            result.start,
            packed(result.commands),
        )
        with storage(f"cannot write {place}"):
            write_atomic(place / f"{stem}-{episode}.json", line_of(bound))
        tell(bound)
    return [done[episode] for episode in range(len(positions))]


def _searched(jobs: Mapping[int, Job], pool: Pool) -> Iterator[tuple[int, Solution]]:
    with interruption.immediate():
        for episode, result in pool.results(_solve, jobs, "search"):
            if isinstance(result, WorkerDiedError):
                raise WorkerDiedError(
                    f"{result}; finished searches are saved: run the command again to continue"
                )
            yield episode, result


_built: tuple[schema.TrainConfig, Search, dict[str, Agent]] | None = None
"""Configuration, search and controllers of the last job in this process, kept because building them takes a second."""


def _solve(
    config: schema.TrainConfig, protocol: schema.Protocol, episode: int, scenario: Scenario
) -> Solution:
    global _built
    if _built is None or _built[0] != config:
        _built = config, Search(config), controllers(config)
    _, search, agents = _built
    return search.find(scenario, flown(config, agents, protocol, episode))


def controllers(config: schema.TrainConfig) -> dict[str, Agent]:
    """Return the controllers of `CONTROLLERS` by name."""
    vehicle = sheet.load(config.vehicle)
    algos = {name: train_config(compose("train", [f"algo={name}"], folder=None)).algo for name in CONTROLLERS}
    return {name: make(replace(config, algo=algos[name]), vehicle) for name, make in CONTROLLERS.items()}


def flown(
    config: schema.TrainConfig, agents: Mapping[str, Agent], protocol: schema.Protocol, episode: int
) -> dict[str, Floats]:
    """Run each controller through an episode of the test, and return the actions (T, n_u) that reached the actuators.

    The episode has the noise of the protocol. The recorded actions include the noise of the commands, so applying
    these actions without noise repeats the controller's motion.
    """
    vehicle = sheet.load(config.vehicle)
    return {
        name: vehicle.action(
            np.array(one_episode(config, agent, protocol, episode).trajectories[episode].command)
        )
        for name, agent in agents.items()
    }


def all_scenarios(condition: ResolvedCondition, protocol: schema.Protocol) -> list[Scenario]:
    """Return the scenarios of a protocol's episodes, in order."""
    episodes = np.arange(protocol.episodes)
    batch = batch_of(protocol.scenarios, silent(condition.config), episodes, protocol.seed)
    batch.reset()
    return scenarios(batch)
