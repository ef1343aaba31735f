"""Check agents, and also the training of agents that learn."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.agents import base
from auvbench.agents.installed import PluginAgent, action_fault
from auvbench.config import schema
from auvbench.config.algorithms import learns
from auvbench.config.compose import compose
from auvbench.config.validate import train_config
from auvbench.envs.batch import Batch
from auvbench.errors import TrainingError
from auvbench.evaluation.evaluate import make_agent
from auvbench.runs.directory import RunDirectory
from auvbench.runs.plan import prepare
from auvbench.testing import draws
from auvbench.testing.draws import ConformanceError, same
from auvbench.training.execute import execute
from auvbench.training.learning import Session

EPISODES, STEPS = 7, 25
"""Number of vehicles, and number of steps, in the checks of an agent's actions"""

SIZES = (1, 3)
"""Sizes of the batches in which the same episodes are repeated"""

Make = Callable[[], base.Agent]


@dataclass
class Flight:
    """Observations and actions of an agent in test scenarios."""

    config: schema.TrainConfig
    observations: list[NDArray[np.float32]]  # (n, n_obs) per step
    actions: list[NDArray[Any]]  # (n, n_u) per step


def fly(config: schema.TrainConfig, agent: base.Agent) -> Flight:
    """Steer `EPISODES` vehicles for `STEPS` steps and check each action.

    Raises:
        ConformanceError: actions are not (n, n_u) numbers in [-1, 1], or `act` changes the observations.
    """
    batch = Batch(config, EPISODES, test=True, autoreset=True)
    batch.task.assign(np.arange(EPISODES))
    observation = batch.reset().copy()
    agent.reset(np.arange(EPISODES))
    flight = Flight(config, [], [])
    for step in range(STEPS):
        original = observation.copy()
        action = agent.act(observation)
        if fault := action_fault(action, EPISODES, len(batch.vehicle.actuators)):
            raise ConformanceError(f"step {step}: {fault}")
        same(observation, original, f"step {step}: act must not change its observations")
        flight.observations.append(original)
        flight.actions.append(np.array(action))
        observation = batch.step(np.asarray(action)).observation.copy()
    return flight


def replay(flight: Flight, agent: base.Agent, rows: Sequence[int], what: str) -> None:
    """Give an agent the recorded observations of the episodes `rows`, and compare its actions with the recorded actions.

    Raises:
        ConformanceError: the actions differ from the recorded actions.
    """
    chosen = np.asarray(rows)
    agent.reset(chosen.copy())
    for step, (observations, done) in enumerate(zip(flight.observations, flight.actions, strict=True)):
        action = np.asarray(agent.act(observations[chosen]))
        same(action, done[chosen], f"{what}: step {step}: its actions must be the same")


def actions_are_in_range(config: schema.TrainConfig, make: Make) -> None:
    """Check that actions are (n, n_u) numbers in [-1, 1], and that `act` does not change the observations."""
    fly(config, make())


def actions_do_not_depend_on_the_batch(config: schema.TrainConfig, make: Make) -> None:
    """Check that the actions of an episode have the same bits in a batch of any size."""
    flight = fly(config, make())
    for size in SIZES:
        agent = make()
        for start in range(0, EPISODES, size):
            rows = range(start, min(start + size, EPISODES))
            replay(flight, agent, rows, f"in a batch of {len(rows)} instead of {EPISODES}")


def nothing_outlives_an_episode(config: schema.TrainConfig, make: Make) -> None:
    """Check that after `reset` an agent acts like a new agent."""
    agent = make()
    flight = fly(config, agent)
    replay(flight, agent, range(EPISODES), "in the same episodes once more")
    fly(config, agent)
    replay(flight, agent, [EPISODES - 1], "in an episode that follows others")


def actions_are_deterministic(config: schema.TrainConfig, make: Make) -> None:
    """Check that two agents of one configuration act the same, even after other random draws.

    The agents must not draw from a global generator.
    """
    draws.reseed_generators(1)
    agent = make()
    with draws.untouched("steering"):
        flight = fly(config, agent)
    draws.reseed_generators(2)
    replay(flight, make(), range(EPISODES), "made a second time")


AGENT_CHECKS: tuple[Callable[[schema.TrainConfig, Make], None], ...] = (
    actions_are_in_range,
    actions_do_not_depend_on_the_batch,
    nothing_outlives_an_episode,
    actions_are_deterministic,
)
"""Checks of every agent."""


@dataclass
class Trainings:
    """Runs of one configuration in one folder; each run is created when a check first needs it."""

    overrides: tuple[str, ...]
    folder: Path
    _runs: dict[str, RunDirectory]

    def run(self, name: str, *more: str) -> RunDirectory:
        """Return a run that has not started."""
        typed = [*self.overrides, *more, f"output={self.folder}", f"name={name}", "train.progress=false"]
        return prepare(compose("train", typed))

    def whole(self) -> RunDirectory:
        """Return the run of an uninterrupted training."""
        if "whole" not in self._runs:
            draws.reseed_generators(3)
            run = self.run("whole")
            execute(run)
            self._runs["whole"] = run
        return self._runs["whole"]


def files(run: RunDirectory) -> dict[str, str]:
    """Return the digests of a run's model and training episodes."""
    paths = [*sorted(run.model.iterdir()), run.train / "episodes.csv"]
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}


def _compare(first_run: RunDirectory, second_run: RunDirectory, what: str) -> None:
    first, second = files(first_run), files(second_run)
    wrong = [name for name in {**first, **second} if first.get(name) != second.get(name)]
    if wrong:
        raise ConformanceError(
            f"{what} must write the same bits as the first training; different files: {', '.join(sorted(wrong))}"
        )


def training_is_deterministic(trainings: Trainings) -> None:
    """Check that two trainings of one configuration write the same bits, even after other random draws."""
    draws.reseed_generators(4)
    repeated = trainings.run("again")
    execute(repeated)
    _compare(trainings.whole(), repeated, "the same training")


def tests_on_the_way_change_nothing(trainings: Trainings) -> None:
    """Check that tests during training do not change the policy."""
    total = trainings.whole().manifest()["total_steps"]
    tested = trainings.run("tested", f"train.evaluate_every={max(1, total // 2)}")
    execute(tested)
    _compare(trainings.whole(), tested, "a training with tests on its way (train.evaluate_every)")


def nothing_is_pickled(trainings: Trainings) -> None:
    """Check that no file of the model or the checkpoints is a pickle, and that loading the model unpickles no code."""
    run = trainings.whole()
    saved = sorted(path for path in run.model.rglob("*") if path.is_file())
    if not saved:
        raise ConformanceError("save writes no file")
    pickles = [
        path.name
        for path in [*saved, *run.checkpoints.rglob("*")]
        if path.is_file() and draws.is_pickle(path.read_bytes())
    ]
    if pickles:
        raise ConformanceError(f"{pickles[0]} is a pickle, which could run code; save plain arrays instead")
    with draws.no_unpickling("load"):
        make_agent(run, float(run.config()["step"]["frequency"]))


@contextmanager
def stopped_at(step: int) -> Iterator[None]:
    """Inside this context, stop each training with an error when it reaches the environment step `step`."""
    ordinary = Session.step

    def strike(self: Session, steps: int, transition: Any) -> float:
        if steps >= step:
            raise RuntimeError("stopped by the conformance check, which then resumes the training")
        return ordinary(self, steps, transition)

    Session.step = strike  # type: ignore[method-assign]
    try:
        yield
    finally:
        Session.step = ordinary  # type: ignore[method-assign]


def a_stopped_training_ends_as_it_says(trainings: Trainings) -> None:
    """Check that an interrupted training ends with the same bits as an uninterrupted one.

    An agent with `exact_resume` continues from a checkpoint; any other agent restarts its training.
    """
    whole = trainings.whole()
    total = whole.manifest()["total_steps"]
    struck = trainings.run("struck", f"train.checkpoint.steps={max(1, total // 8)}")
    try:
        with stopped_at(max(1, 3 * total // 4)):
            execute(struck)
    except TrainingError:
        pass
    else:
        raise ConformanceError(
            f"learn ended before step {3 * total // 4}; it must train for the whole budget"
        )
    draws.reseed_generators(5)
    saved = struck.checkpoints.is_dir() and any(path.name.isdigit() for path in struck.checkpoints.iterdir())
    execute(struck)
    manifest = struck.manifest()
    exact = base.learner_of(*_config_and_vehicle(trainings.overrides)).exact_resume
    if exact and not saved:
        raise ConformanceError(
            f"exact_resume requires checkpoints; learn did not call callbacks.checkpoint before step {3 * total // 4} of {total}"
        )
    if not exact and not manifest.get("started_over"):
        raise ConformanceError(
            "without exact_resume the training must restart, but its manifest has no started_over"
        )
    _compare(whole, struck, "a training that was stopped")


LEARNER_CHECKS: tuple[Callable[[Trainings], None], ...] = (
    training_is_deterministic,
    tests_on_the_way_change_nothing,
    nothing_is_pickled,
    a_stopped_training_ends_as_it_says,
)
"""Additional checks of every agent that learns."""


def _config_and_vehicle(overrides: Sequence[str]) -> tuple[schema.TrainConfig, Any]:
    config = train_config(compose("train", list(overrides)))
    return config, Batch(config, 1).vehicle


def check_agent(
    *overrides: str,
    steps: int = 2000,
    only: Callable[..., None] | None = None,
) -> None:
    """Check an agent against its contract (`auvbench.agents.base`).

    Args:
        overrides: arguments of `auvbench train`: the agent, `algo=NAME`, and other overrides.
        steps: budget, in environment steps, of each of a learner's four trainings. The budget must be long enough for several
            calls of `callbacks.checkpoint`.
        only: one of `AGENT_CHECKS` or `LEARNER_CHECKS`; default: all.

    Raises:
        ConformanceError: the agent breaks its contract.
        ConfigError: an override is wrong.
    """
    config, vehicle = _config_and_vehicle(overrides)
    checks: list[Any] = [*AGENT_CHECKS, *(LEARNER_CHECKS if learns(config.algo) else ())]
    with tempfile.TemporaryDirectory(prefix="auvbench-testing-") as folder:
        trainings = Trainings((f"train.total_steps={steps}", *overrides), Path(folder), {})

        def make() -> base.Agent:
            agent = base.make(config, vehicle)
            if callable(getattr(agent, "load", None)):  # loads the trained model, or the file of `algo=onnx`
                agent = make_agent(trainings.whole(), config.step.frequency)
            # The wrapper between an agent and the vehicle would hide some of the agent's faults here.
            return agent.inner if isinstance(agent, PluginAgent) else agent

        def run(check: Any) -> None:
            check(trainings) if check in LEARNER_CHECKS else check(config, make)

        draws.run_checks(checks, only, overrides, run)
