"""The bounds of each scenario of a protocol, computed by workers; finished searches survive a kill."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from auvbench.agents.base import Agent
from auvbench.agents.classical.mpc import MPCController
from auvbench.agents.classical.pid import controller
from auvbench.config import schema, simulators
from auvbench.config.compose import compose
from auvbench.config.validate import train_config
from auvbench.envs.batch import Batch
from auvbench.errors import ConfigError
from auvbench.evaluation.bounds.command_replay import Scenario, kept, scenarios, silent
from auvbench.evaluation.bounds.files import (
    Bound,
    Commands,
    Found,
    Limits,
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
"""Modules that the workers of the pool need."""

CONTROLLERS = {"pid": controller, "mpc": MPCController, "mpc_tuned": MPCController}
"""By name of the algorithm: their commands are where a search starts, and upper bounds themselves."""

Job = tuple[schema.TrainConfig, schema.Protocol, int, Scenario]
"""configuration of the condition, protocol, episode, its scenario"""


def eligible(conditions: Sequence[ResolvedCondition]) -> tuple[list[ResolvedCondition], list[str]]:
    """Return the conditions that have bounds, and a line for each of the others.

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
        return f"simulator={config.simulator.name} has other equations than those that are solved; simulator=fossen has them"
    if not condition.fixed_frequency:
        return "the protocol leaves the frequency to each agent; protocol.frequency=10 fixes one"
    batch = Batch(silent(config), 1, seed=0, test=True, autoreset=False)
    if batch.disturbances is not None:
        return f"disturbance={config.disturbance.name}: bounds hold in still water and for a healthy vehicle"
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
        protocol: which scenarios.
        config: a resolved configuration with the vehicle and the simulator.
        root: folder of bounds; holds finished searches until all are.
        pool: workers for the searches; the result does not depend on their number.
        tell: called with each bound, also with those of an earlier call that was stopped.

    Raises:
        ConfigError: no condition has bounds, or the symbolic equations do not cover the vehicle.
        MissingExtraError: CasADi is not installed.
        TrainingError: a worker was killed, or the disk is at fault.
        RunError: another process computes the same.
        Interrupted: by a signal; finished searches are kept.
    """
    conditions = resolve_conditions(protocol, config)
    good, left_out = eligible(conditions)
    for condition in good:  # refuses before anything is written
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
            # A search of other scenarios has other names.
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
    there = all_scenarios(condition, protocol)
    done: dict[int, Bound] = {}
    for episode in range(len(there)):
        if (bound := read_finished(place / f"{stem}-{episode}.json")) is not None:
            done[episode] = bound
            tell(bound)
    jobs = {e: (config, protocol, e, s) for e, s in enumerate(there) if e not in done}
    for episode, found in _searched(jobs, pool):
        done[episode] = bound = Bound(
            condition.name,
            frequency,
            episode,
            found.steps,
            energy.steps(there[episode], frequency),
            found.start,
            packed(found.commands),
        )
        with storage(f"cannot write {place}"):
            write_atomic(place / f"{stem}-{episode}.json", line_of(bound))
        tell(bound)
    return [done[episode] for episode in range(len(there))]


def _searched(jobs: Mapping[int, Job], pool: Pool) -> Iterator[tuple[int, Found]]:
    with interruption.immediate():
        for episode, found in pool.results(_solve, jobs, "search"):
            if isinstance(found, WorkerDiedError):
                raise WorkerDiedError(f"{found}; finished searches are kept: repeat the command to continue")
            yield episode, found


_built: tuple[schema.TrainConfig, Search, dict[str, Agent]] | None = None
"""Search and controllers of the last job in this process; they take a second to build."""


def _solve(config: schema.TrainConfig, protocol: schema.Protocol, episode: int, scenario: Scenario) -> Found:
    global _built
    if _built is None or _built[0] != config:
        _built = config, Search(config), controllers(config)
    _, search, agents = _built
    return search.find(scenario, commands(config, agents, protocol, episode))


def controllers(config: schema.TrainConfig) -> dict[str, Agent]:
    """Return the controllers that a search starts from, by name."""
    vehicle = sheet.load(config.vehicle)
    algos = {name: train_config(compose("train", [f"algo={name}"], folder=None)).algo for name in CONTROLLERS}
    return {name: make(replace(config, algo=algos[name]), vehicle) for name, make in CONTROLLERS.items()}


def commands(
    config: schema.TrainConfig, agents: Mapping[str, Agent], protocol: schema.Protocol, episode: int
) -> dict[str, Commands]:
    """Return the commands (T, n_u) that reached the actuators until an episode ended, by controller.

    They include the noise of the protocol: replayed without noise they do what the controller did in the test.
    """
    found = {}
    vehicle = sheet.load(config.vehicle)
    for name, agent in agents.items():
        path = one_episode(config, agent, protocol, episode).trajectories[episode]
        found[name] = kept(vehicle.action(np.array(path.command)))
    return found


def all_scenarios(condition: ResolvedCondition, protocol: schema.Protocol) -> list[Scenario]:
    """Return the scenarios of a protocol's episodes, in their order."""
    episodes = np.arange(protocol.episodes)
    batch = batch_of(protocol.scenarios, silent(condition.config), episodes, protocol.seed)
    batch.reset()
    return scenarios(batch)
