"""The bounds of each scenario of a protocol, computed by workers; finished searches survive a kill.

Two passes: each scenario from controllers, then each once more from the results of its neighbours. A result of a pass
depends on the pass before alone, not on the worker or the order.
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
from auvbench.evaluation.bounds.command_replay import Commands, Scenario, Trial, scenarios, silent
from auvbench.evaluation.bounds.files import (
    Bound,
    Found,
    Journal,
    Key,
    Limits,
    folder_of,
    known_results,
    packed,
    place_of,
    write,
)
from auvbench.evaluation.bounds.lower_bound import Energy
from auvbench.evaluation.bounds.search import VERSION, Search
from auvbench.evaluation.bounds.warm_starts import WarmStarts
from auvbench.evaluation.protocol import ResolvedCondition, fingerprint, fingerprint_parts, resolve_conditions
from auvbench.evaluation.rollout import batch_of
from auvbench.runs import interruption, lock
from auvbench.runs.atomic_io import make_folder, storage
from auvbench.runs.pool import Pool, WorkerDiedError
from auvbench.vehicles import sheet
from auvbench.vehicles.symbolic import symbolic

PRELOAD = ("auvbench.evaluation.bounds.compute", "casadi")
"""Modules that the workers of the pool need."""
NEIGHBOURS = 2
"""other scenarios from whose results the second pass begins"""

Tell = Callable[[Key, Found], None]


@dataclass(frozen=True, slots=True)
class Place:
    """What the searches of a condition share."""

    config: schema.TrainConfig
    seed: int
    scenarios: str


@dataclass(frozen=True, slots=True)
class Job:
    """One search: from controllers in the first pass, from earlier results in the second."""

    key: Key
    scenario: Scenario
    known: Found | None
    others: tuple[tuple[Scenario, Commands], ...] = ()


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
    *,
    pool: Pool | None = None,
    passes: int = 2,
    others: Sequence[Path] = (),
    again: bool = False,
    tell: Tell = lambda key, found: None,
) -> Limits:
    """Compute the bounds of a protocol for a vehicle and write them to `<root>/<protocol>-<vehicle>`.

    Args:
        protocol: which scenarios.
        config: a resolved configuration with the vehicle and the simulator.
        root: folder of bounds; holds the journal of finished searches until all are.
        pool: workers for the searches; None: this process. The result is the same.
        passes: 1: each scenario from controllers; 2: once more from its neighbours.
        others: folders of bounds: results for the same scenarios are taken over after a replay.
        again: search these scenarios too; a result is no worse than that of `others`.
        tell: called with each result, also with those of before.

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
        symbolic(sheet.load(condition.config.vehicle), by_thrust=True)
    parts = fingerprint_parts(protocol, conditions)
    vehicle = str(config["vehicle"]["name"])
    header = {"search": VERSION, "protocol": protocol.name, "vehicle": vehicle, **parts}
    folder = folder_of(root, protocol.name, vehicle)
    place = folder.with_name(f".{folder.name}")
    with storage(f"cannot write {place}"):
        make_folder(place)
    with lock.acquire(place):
        journal = Journal(place / "journal.jsonl", header)
        bounds: list[Bound] = []
        try:
            for condition in good:
                search = _Condition(condition, protocol, journal, pool, tell)
                bounds += _bounds(condition, search.there, search.results(passes, others, again))
        finally:
            journal.close()
        limits = Limits(
            protocol.name,
            vehicle,
            fingerprint(protocol, conditions),
            parts,
            tuple(bounds),
            tuple(left_out),
            {"version": VERSION, "passes": passes},
        )
        write(folder, limits)
        journal.path.unlink()
    return limits


def _bounds(
    condition: ResolvedCondition, there: Sequence[Scenario], found: Sequence[Found]
) -> Iterator[Bound]:
    frequency = condition.config.step.frequency
    energy = Energy(sheet.load(condition.config.vehicle), condition.config.task.goal_radius)
    for episode, (scenario, result) in enumerate(zip(there, found, strict=True)):
        yield Bound(
            condition.name,
            frequency,
            episode,
            result.steps,
            energy.steps(scenario, frequency),
            round(energy.seconds(scenario), 6),
            result.start,
            place_of(scenario),
            packed(result.commands),
        )


def wrong_bounds(limits: Limits, protocol: schema.Protocol, config: dict[str, Any]) -> list[str]:
    """Replay the commands of bounds in the simulator; return a line for each that does not arrive in its steps.

    Raises:
        ConfigError: as `compute`.
        RunError: commands are damaged.
    """
    wrong = []
    by_name = {condition.name: condition for condition in resolve_conditions(protocol, config)}
    for name in limits.conditions():
        trial = Trial(by_name[name].config)
        there = all_scenarios(by_name[name], protocol)
        for bound in limits.condition(name):
            outcome = trial.run(there[bound.episode], bound.found().commands)
            if not outcome.arrived or outcome.steps != bound.steps:
                wrong.append(
                    f"{name}, episode {bound.episode}: {outcome.record['outcome']} after {outcome.steps} steps, not "
                    f"arrived after {bound.steps}"
                )
    return wrong


def all_scenarios(condition: ResolvedCondition, protocol: schema.Protocol) -> list[Scenario]:
    """Return the scenarios of a protocol's episodes, in their order."""
    batch = batch_of(protocol.scenarios, silent(condition.config), protocol.episodes, protocol.seed)
    batch.task.assign(np.arange(protocol.episodes))
    batch.reset()
    return scenarios(batch)


class _Condition:
    """The searches of one condition."""

    def __init__(
        self,
        condition: ResolvedCondition,
        protocol: schema.Protocol,
        journal: Journal,
        pool: Pool | None,
        tell: Tell,
    ) -> None:
        self.name = condition.name
        self.place = Place(condition.config, protocol.seed, protocol.scenarios)
        self.there = all_scenarios(condition, protocol)
        self.journal, self.pool, self.tell = journal, pool, tell

    def results(self, passes: int, others: Sequence[Path], again: bool) -> list[Found]:
        """Return the best result of each episode."""
        known = self._known(others)
        for e, found in {} if again else known.items():
            for turn in range(1, passes + 1):
                if (self.name, turn, e) not in self.journal.found:
                    self.journal.add((self.name, turn, e), found)
        jobs = [Job((self.name, 1, e), scenario, known.get(e)) for e, scenario in enumerate(self.there)]
        first = self._carry_out(jobs)
        if passes < 2:
            return first
        jobs = []
        for e, near in enumerate(self._neighbours()):
            starts = tuple((self.there[other], first[other].commands) for other in near)
            jobs.append(Job((self.name, 2, e), self.there[e], first[e], starts))
        return self._carry_out(jobs)

    def _known(self, folders: Sequence[Path]) -> dict[int, Found]:
        """Return by episode the commands of earlier results that arrive here too."""
        trial = Trial(self.place.config)
        known = {}
        found = known_results(folders, trial.vehicle.name, self.place.config.step.frequency, self.there)
        for e, result in found.items():
            if result.commands.shape[1:] == (len(trial.vehicle.units),):
                outcome = trial.run(self.there[e], result.commands)
                if outcome.arrived:
                    known[e] = Found(result.commands[: outcome.steps], result.start)
        return known

    def _neighbours(self) -> list[list[int]]:
        """Return the nearest other scenarios of each, as seen from the start, nearest first."""
        targets = np.array([scenario.target for scenario in self.there])
        distance = np.linalg.norm(targets[:, None] - targets, axis=2)
        np.fill_diagonal(distance, np.inf)
        nearest: list[list[int]] = np.argsort(distance, axis=1, kind="stable").tolist()
        return [row[: min(NEIGHBOURS, len(row) - 1)] for row in nearest]

    def _carry_out(self, jobs: Sequence[Job]) -> list[Found]:
        waiting = {}
        for job in jobs:
            known = self.journal.found.get(job.key)
            if known is None:
                waiting[job.key] = (self.place, job)
            else:
                self.tell(job.key, known)
        for key, found in _here(waiting) if self.pool is None else _apart(waiting, self.pool):
            self.journal.add(key, found)
            self.tell(key, found)
        return [self.journal.found[job.key] for job in jobs]


def _here(jobs: Mapping[Key, tuple[Place, Job]]) -> Iterator[tuple[Key, Found]]:
    for key, (place, job) in jobs.items():
        with interruption.immediate() as request:
            try:
                found = _solve(place, job)
            except Exception:  # CasADi may make another error of the interruption, and IPOPT swallow it
                if request.signal is None:
                    raise
        if request.signal is not None:
            raise interruption.Interrupted(request.signal)
        yield key, found


def _apart(jobs: Mapping[Key, tuple[Place, Job]], pool: Pool) -> Iterator[tuple[Key, Found]]:
    with interruption.immediate():
        for key, found in pool.results(_solve, jobs, "search"):
            if isinstance(found, WorkerDiedError):
                raise WorkerDiedError(f"{found}; finished searches are kept: repeat the command to continue")
            yield key, found


_built: tuple[Place, Search, WarmStarts] | None = None
"""Search of the last job in this process; one takes a second to build."""


def _solve(place: Place, job: Job) -> Found:
    global _built
    if _built is None or _built[0] != place:
        _built = place, Search(place.config), WarmStarts(place.config, place.seed, place.scenarios)
    _, search, starts = _built
    _, turn, episode = job.key
    if turn == 1:
        return search.first(job.scenario, starts.commands(episode), job.known)
    assert job.known is not None
    return search.again(job.scenario, job.known, job.others)
