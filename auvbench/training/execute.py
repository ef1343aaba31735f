"""Carry out one run: from a frozen directory to a trained model, or to an error in the manifest."""

from __future__ import annotations

import dataclasses
import time
from contextlib import suppress
from typing import Any

import numpy as np

from auvbench import tracking
from auvbench.agents import base as agents
from auvbench.config import complete, schema, simulators
from auvbench.config.algorithms import learns
from auvbench.config.algorithms.onnx import ONNX
from auvbench.config.algorithms.residual import Residual
from auvbench.errors import AuvbenchError, TrainingError
from auvbench.registry import AGENTS, SIMULATORS, resolve
from auvbench.runs import integrity, interruption, provenance, status
from auvbench.runs.atomic_io import storage
from auvbench.runs.directory import RunDirectory, now
from auvbench.runs.lock import LockLostError
from auvbench.runs.plan import load_config
from auvbench.runs.progress import Watch
from auvbench.tasks import base as tasks
from auvbench.tasks import disturbances, filters
from auvbench.tasks.observation_spec import check_vehicle, observation_spec
from auvbench.training import worker
from auvbench.vehicles import sheet

TRIED = 16
"""Number of episodes whose starts and goals are checked in a world with solids before a run is created"""


def check_runnable(config: schema.TrainConfig) -> None:
    """Check, before a run is created, that vehicle, filter, disturbances, world, simulator and agent work together.

    The controller (also the controller of a residual learner) is created. Learners are not created: they work with every
    vehicle and take seconds to build. ROS 2 servers are not contacted, since they may start later.

    Raises:
        ConfigError: the vehicle cannot do the task or lacks the actuator that is configured to fail, the controller cannot
            steer the vehicle, the learner cannot learn the task, Gazebo is not installed, or a start or a goal is inside a
            solid.
        VehicleError: Gazebo cannot simulate the vehicle.
        MissingExtraError: the controller, or train.log, needs a package that is not installed.
    """
    tracking.prepare(config.train.log, config.name)
    vehicle = sheet.load(config.vehicle)
    check_vehicle(config.task, vehicle)
    filters.make(config, vehicle, observation_spec(config.task, vehicle.actuators), 1)
    disturbances.check(config, vehicle)
    if config.world.solid:  # the first starts and goals must be in the water
        tasks.make(config, vehicle, TRIED, config.seed).reset(np.arange(TRIED))
    if check := SIMULATORS[config.simulator.name].check:
        resolve(check)(config.simulator, vehicle)
    residual = getattr(config.algo, "residual", None)
    algo = residual.base if isinstance(residual, Residual) else config.algo
    if algo.agent in AGENTS.own and not learns(algo):
        agents.make(dataclasses.replace(config, algo=algo), vehicle)
    elif algo.agent in AGENTS.own and (check := AGENTS[algo.agent].check):
        resolve(check)(config, vehicle)


def execute(run: RunDirectory, watch: Watch | None = None) -> dict[str, Any]:
    """Train a run to completion, from its last checkpoint on, and return its manifest.

    A complete run does not change, unless its model was lost or damaged: training then continues from the
    last checkpoint. On Ctrl-C or SIGTERM, the run saves and stops; a second signal stops it at once.

    Raises:
        TrainingError: the run failed; the manifest has the error.
        KeyboardInterrupt: a signal stopped the run; the manifest has the state `interrupted`, or `complete` if the signal came
            too late.
    """
    manifest = run.manifest()
    if status.finished(run, manifest):
        return manifest
    config = load_config(run)
    begun = time.monotonic()
    before = float(manifest["wall_time_s"])
    used = time.process_time()
    used_before = float(manifest.get("cpu_time_s") or 0.0)
    with storage(f"cannot write {run.path}"):
        run.update_manifest(
            state="running",
            started=manifest["started"] or now(),
            ended=None,
            error=None,
            attempts=int(manifest["attempts"]) + 1,
            versions=provenance.versions() | complete.releases(config),
            git=provenance.git(),
            host=provenance.host(simulators.threads(config.simulator)),
        )

    def note(**changes: Any) -> dict[str, Any]:
        wall = before + time.monotonic() - begun
        cpu = used_before + time.process_time() - used
        return run.update_manifest(wall_time_s=round(wall, 3), cpu_time_s=round(cpu, 3), **changes)

    def close(state: str, **changes: Any) -> dict[str, Any]:
        return note(state=state, ended=now(), **changes)

    with interruption.deferred() as stop:
        try:
            if learns(config.algo):
                from auvbench.training.learning import learn

                result = learn(run, config, watch, stop, note)
            else:
                result = {"files": _admit(run, config)}
            with storage(f"cannot write {run.path}"):
                # The versions include the simulator's versions, which are known only now.
                manifest = close(
                    "complete", **result, versions=provenance.versions() | complete.releases(config)
                )
        except LockLostError:
            raise  # the run and its manifest belong to another process now
        except (KeyboardInterrupt, Exception) as error:
            interrupted = interruption.cause(error)  # a library may have replaced the interruption
            if interrupted is not None:
                with suppress(OSError):
                    close("interrupted")
                raise interrupted from (None if interrupted is error else error)
            # On a full disk, writing the manifest fails, too. Then only the first error is reported, because it is the cause.
            with suppress(OSError):
                note()
                worker.fail(run, error)
            if isinstance(error, AuvbenchError):
                raise
            raise TrainingError(f"{run.id}: {type(error).__name__}: {error}") from error
    if stop.signal is not None:
        # The signal arrived after the training had ended, but a command that carries out several runs must stop.
        raise interruption.Interrupted(stop.signal, f"{run.path}: complete")
    return manifest


def _admit(run: RunDirectory, config: schema.TrainConfig) -> dict[str, integrity.Entry]:
    """Check an agent that does not learn. Return the files to record in the manifest: the policy's files for `algo=onnx`, else none."""
    if complete.releases(config):
        _try(config)
    if config.algo.agent in AGENTS.own and (check := AGENTS[config.algo.agent].check):
        resolve(check)(config, sheet.load(config.vehicle))
    if not isinstance(config.algo, ONNX):
        return {}
    from auvbench.agents.policy_file import PolicyFile
    from auvbench.evaluation.evaluate import make_agent
    from auvbench.evaluation.exporting import check_policy
    from auvbench.policies.exported import CARD, NETWORK

    agent = make_agent(run, config.step.frequency)
    assert isinstance(agent, PolicyFile)
    check_policy(config, agent)
    model_files = [run.model / name for name in (NETWORK, CARD) if (run.model / name).is_file()]
    return {f"{path.parent.name}/{path.name}": integrity.entry_of(path) for path in model_files}


def _try(config: schema.TrainConfig) -> None:
    """Make one step with the parts of installed packages, so that a run with a defective part fails at its start."""
    from auvbench.envs.batch import Batch

    batch = Batch(config, 1)
    agent = agents.make(config, batch.vehicle)
    agent.reset(np.zeros(1, dtype=np.int64))
    batch.step(np.asarray(agent.act(batch.reset())))
