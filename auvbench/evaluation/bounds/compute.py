"""The limit of each scenario of a protocol, on several workers; what was found is kept, so a killed search goes on.

Two passes: each scenario by itself, then each once more from what its neighbours found. What a pass gives for a scenario
depends on the pass before alone, not on who computes it or when.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from auvbench.config import schema, simulators
from auvbench.envs.batch import Batch
from auvbench.errors import ConfigError
from auvbench.evaluation.bounds.driven import drive
from auvbench.evaluation.bounds.files import ConditionLimits, Limits, folder_of, known_commands, write
from auvbench.evaluation.bounds.journal import Journal, Key
from auvbench.evaluation.bounds.proven import Energy
from auvbench.evaluation.bounds.search import VERSION, Found, Search
from auvbench.evaluation.bounds.trial import Commands, Scenario, Trial, scenarios, silent
from auvbench.evaluation.protocol import Circumstance, circumstances, fingerprint, fingerprint_parts
from auvbench.evaluation.rollout import batch_of
from auvbench.runs import interruption, lock
from auvbench.runs.atomic_io import make_folder, storage
from auvbench.runs.pool import Pool, WorkerDiedError
from auvbench.vehicles import sheet
from auvbench.vehicles.symbolic import symbolic

PRELOAD = ("auvbench.evaluation.bounds.compute", "casadi")
"""Modules that the workers of the pool need."""
NEIGHBOURS = 2
"""other scenarios from whose solutions the second pass begins"""

Tell = Callable[[Key, Found], None]


@dataclass(frozen=True, slots=True)
class Job:
    """One search."""

    key: Key
    scenario: Scenario
    driven: Commands | None
    known: Found | None
    others: tuple[tuple[Scenario, Commands], ...]


def eligible(conditions: Sequence[Circumstance]) -> tuple[list[Circumstance], list[str]]:
    """The conditions that have a limit, and why each of the others has none, a line each.

    Raises:
        ConfigError: none has one.
    """
    good, refused = [], []
    for condition in conditions:
        if why := _why_not(condition):
            refused.append(f"{condition.name}: {why}")
        else:
            good.append(condition)
    if not good:
        raise ConfigError(f"no condition has a limit: {'; '.join(refused[:3])}")
    return good, refused


def _why_not(condition: Circumstance) -> str:
    config = condition.config
    if not isinstance(config.simulator, simulators.Fossen):
        return f"simulator={config.simulator.name} has other equations than those that are solved; simulator=fossen has them"
    if not condition.fixed_frequency:
        return "the protocol leaves the frequency to each agent; protocol.frequency=10 fixes one"
    batch = Batch(silent(config), 1, seed=0, test=True, autoreset=False)
    if batch.disturbances is not None:
        return f"disturbance={config.disturbance.name}: a limit is for still water and a healthy vehicle"
    return ""


def compute(
    protocol: schema.Protocol,
    config: dict[str, Any],
    root: Path,
    *,
    pool: Pool | None = None,
    passes: int = 2,
    others: Sequence[Path] = (),
    tell: Tell = lambda key, found: None,
) -> Limits:
    """The limits of a protocol for a vehicle, written to `<root>/<protocol>-<vehicle>`.

    Args:
        protocol: which scenarios.
        config: a resolved configuration with the vehicle and the simulator.
        root: folder of limits; the journal of what is found so far lies in it until all is.
        pool: workers for the searches; None: this process. The result is the same.
        passes: 1: each scenario by itself; 2: once more from its neighbours.
        others: folders of other protocols' limits: what they hold for the same scenarios is taken over after a trial.
        tell: called with each result, also with those of before.

    Raises:
        ConfigError: no condition has a limit, or the symbolic equations do not cover the vehicle.
        MissingExtraError: CasADi is not installed.
        TrainingError: a worker was killed, or the disk is at fault.
        RunError: somebody else computes it at present.
        Interrupted: somebody asked to leave; what was found is kept.
    """
    conditions = circumstances(protocol, config)
    good, left_out = eligible(conditions)
    for condition in good:  # refuses before anything is written
        symbolic(sheet.load(condition.config.vehicle), by_thrust=True)
    parts = fingerprint_parts(protocol, conditions)
    vehicle = str(config["vehicle"]["name"])
    header = {
        "schema_version": 1,
        "search": VERSION,
        "protocol": protocol.name,
        "vehicle": vehicle,
        **{f"fingerprint_{name}": digits for name, digits in parts.items()},
    }
    folder = folder_of(root, protocol.name, vehicle)
    place = folder.with_name(f".{folder.name}")
    with storage(f"cannot write {place}"):
        make_folder(place)
    with lock.acquire(place):
        journal = Journal(place / "journal.jsonl", header)
        try:
            found = [
                _limits_of(
                    condition,
                    _search(condition, protocol, journal, pool=pool, passes=passes, others=others, tell=tell),
                    protocol,
                )
                for condition in good
            ]
        except BaseException:
            journal.close()
            raise
        limits = Limits(
            protocol.name,
            vehicle,
            fingerprint(protocol, conditions),
            parts,
            tuple(found),
            tuple(left_out),
            {"version": VERSION, "passes": passes},
        )
        write(folder, limits)
        journal.remove()
    return limits


def _limits_of(condition: Circumstance, found: Sequence[Found], protocol: schema.Protocol) -> ConditionLimits:
    """What was found, beside what is proven, in the order of the episodes."""
    there = all_scenarios(condition, protocol)
    frequency = condition.config.step.frequency
    energy = Energy(sheet.load(condition.config.vehicle), condition.config.task.goal_radius)
    return ConditionLimits(
        name=condition.name,
        frequency=frequency,
        episodes=np.arange(len(there)),
        steps=np.array([f.steps for f in found]),
        least=np.array([energy.steps(scenario, frequency) for scenario in there]),
        places=np.array([[*scenario.waypoint, scenario.yaw] for scenario in there]),
        start=tuple(f.start for f in found),
        commands=tuple(f.commands for f in found),
        least_seconds=np.array([energy.seconds(scenario) for scenario in there]),
    )


def tried(limits: Limits, protocol: schema.Protocol, config: dict[str, Any]) -> list[str]:
    """Plays the commands of limits in the simulator; a line for each that does not arrive as it says.

    Raises:
        ConfigError: as `compute`.
    """
    wrong = []
    by_name = {condition.name: condition for condition in circumstances(protocol, config)}
    for held in limits.conditions:
        condition = by_name[held.name]
        trial = Trial(condition.config)
        there = all_scenarios(condition, protocol)
        for episode, steps, commands in zip(held.episodes.tolist(), held.steps, held.commands, strict=True):
            outcome = trial.run(there[episode], commands)
            if not outcome.arrived or outcome.steps != steps:
                ends = outcome.record["outcome"] if not outcome.arrived else "success"
                wrong.append(
                    f"{held.name}, episode {episode}: {ends} after {outcome.steps} steps, not arrived after {steps}"
                )
    return wrong


def _search(
    condition: Circumstance,
    protocol: schema.Protocol,
    journal: Journal,
    *,
    pool: Pool | None,
    passes: int,
    others: Sequence[Path],
    tell: Tell,
) -> list[Found]:
    """What is found for each episode of a condition."""
    config = condition.config
    own = Search(config)
    there = all_scenarios(condition, protocol)
    driven = drive(config, np.arange(len(there)), protocol.seed, protocol.scenarios)
    adopted = _adopted(own, there, known_commands(others, own.vehicle.name, config.step.frequency, there))
    for e, found in adopted.items():
        for turn in range(1, passes + 1):
            if (condition.name, turn, e) not in journal.found:
                journal.add((condition.name, turn, e), found)
    jobs = [Job((condition.name, 1, e), there[e], driven[e], None, ()) for e in range(len(there))]
    first = _carry_out(jobs, config, own, journal, pool, tell)
    if passes < 2:
        return first
    near = _neighbours(there)
    jobs = [
        Job(
            (condition.name, 2, e),
            there[e],
            None,
            first[e],
            tuple((there[other], first[other].commands) for other in near[e]),
        )
        for e in range(len(there))
    ]
    return _carry_out(jobs, config, own, journal, pool, tell)


def _adopted(
    own: Search, there: Sequence[Scenario], known: Mapping[int, tuple[str, Commands]]
) -> dict[int, Found]:
    """By episode, what others found for the same scenario, where it arrives here too."""
    adopted = {}
    for e, (start, commands) in known.items():
        if commands.shape[1:] == (len(own.vehicle.units),):
            outcome = own.trial.run(there[e], commands)
            if outcome.arrived:
                adopted[e] = Found(outcome.steps, commands[: outcome.steps], start)
    return adopted


def all_scenarios(condition: Circumstance, protocol: schema.Protocol) -> list[Scenario]:
    """Those of the protocol's episodes, in their order."""
    batch = batch_of(protocol.scenarios, silent(condition.config), protocol.episodes, protocol.seed)
    batch.task.assign(np.arange(protocol.episodes))
    batch.reset()
    return scenarios(batch)


def _neighbours(there: Sequence[Scenario]) -> list[list[int]]:
    """The nearest other scenarios of each, as seen from the start, nearest first."""
    targets = np.array([scenario.target for scenario in there])
    found = []
    for e, target in enumerate(targets):
        distance = np.linalg.norm(targets - target, axis=1)
        distance[e] = np.inf
        order = np.argsort(distance, kind="stable")[: min(NEIGHBOURS, len(there) - 1)]
        found.append(order.tolist())
    return found


def _carry_out(
    jobs: Sequence[Job],
    config: schema.TrainConfig,
    own: Search,
    journal: Journal,
    pool: Pool | None,
    tell: Tell,
) -> list[Found]:
    waiting = {}
    for job in jobs:
        known = journal.found.get(job.key)
        if known is None:
            waiting[job.key] = job
        else:
            tell(job.key, known)
    for key, found in _here(waiting, own) if pool is None else _apart(waiting, config, pool):
        journal.add(key, found)
        tell(key, found)
    return [journal.found[job.key] for job in jobs]


def _solve(search: Search, job: Job) -> Found:
    if job.driven is not None:
        return search.first(job.scenario, job.driven)
    assert job.known is not None
    return search.again(job.scenario, job.known, job.others)


def _here(jobs: Mapping[Key, Job], own: Search) -> Iterator[tuple[Key, Found]]:
    for key, job in jobs.items():
        with interruption.immediate() as request:
            try:
                found = _solve(own, job)
            except Exception:  # CasADi may make another error of the interruption, and IPOPT swallow it
                if request.signal is None:
                    raise
        if request.signal is not None:
            raise interruption.Interrupted(request.signal)
        yield key, found


def _apart(jobs: Mapping[Key, Job], config: schema.TrainConfig, pool: Pool) -> Iterator[tuple[Key, Found]]:
    arguments = {key: (config, job) for key, job in jobs.items()}
    with interruption.immediate():
        for key, found in pool.results(_work, arguments, "search"):
            if isinstance(found, WorkerDiedError):
                raise WorkerDiedError(f"{found}; what was found is kept: type the command again")
            yield key, found


_own: tuple[schema.TrainConfig, Search] | None = None
"""Condition and search of the last job in this process; a search takes a second to build."""


def _work(config: schema.TrainConfig, job: Job) -> Found:
    global _own
    if _own is None or _own[0] != config:
        _own = config, Search(config)
    return _solve(_own[1], job)
