"""Export the policy of a trained run as an ONNX file with a card, after comparing the file's and the run's actions.

docs/policies-as-files.md defines the two files.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from auvbench.agents.base import Agent, Observations
from auvbench.agents.policy_file import PolicyFile
from auvbench.config import schema
from auvbench.config.algorithms import learns
from auvbench.config.schema import step_limit
from auvbench.errors import RunError
from auvbench.evaluation.evaluate import make_agent, read_summary, refuse_incomplete
from auvbench.evaluation.rollout import batch_of, embedded
from auvbench.policies import exported
from auvbench.policies.exported import FORMAT, NETWORK, SCHEMA_VERSION, SLACK, Policy, PolicyError
from auvbench.registry import AGENTS
from auvbench.runs import identity, integrity, provenance
from auvbench.runs.atomic_io import as_lines, sha256, storage, write_atomic
from auvbench.runs.directory import RunDirectory
from auvbench.runs.plan import load_config
from auvbench.tasks.bounds import bounded_spec
from auvbench.tasks.observation_spec import observation_spec
from auvbench.untrusted import path_safety
from auvbench.vehicles import sheet
from auvbench.vehicles.actuators import Actuator
from auvbench.vehicles.vehicle_model import VehicleModel

LIMIT = 1e-5
"""Usual limit of the difference between an action of the file and the run's action. Large weights magnify rounding
errors. If rounding an observation changes the run's own action, the limit is at least `ROUNDINGS` times this change
"""
ROUNDINGS = 4.0
"""Limit of the difference, as a multiple of the change that rounding an observation causes in the action; the multiple is
larger than 1, because each layer rounds again
"""
EPISODES = 64
CORNERS = 256
STEPS = 100
"""Number of first steps of each test episode; the comparison uses the observations of these steps"""
CHECK_STEPS = 32
"""Number of first steps of each validation episode; `check_policy` uses the observations of these steps"""
TESTED = (
    "name",
    "frequency_hz",
    "episodes",
    "success_rate",
    "collision_rate",
    "timeout_rate",
    "mean_steps",
    "mean_return",
)
"""results that a card contains for each condition of a test"""


class NoNetworkError(RunError):
    """Error: the run has no network to export, or its policy already is a file."""


@dataclass(frozen=True, slots=True)
class Export:
    """An exported policy."""

    run: RunDirectory
    path: Path
    card_path: Path
    observations: int
    difference: float
    """largest difference between an action of the file and the run's action"""


def export(run: RunDirectory, folder: Path | None = None) -> Export:
    """Write `<run id>.onnx` and `<run id>.json`, replacing existing files.

    Args:
        run: a complete run of an agent that learns.
        folder: folder for the files; None: the run's own `exports/`.

    Raises:
        RunError: the run is incomplete or has no network, its files are damaged, or the file's actions differ
            from the run's by more than the limit.
        MissingExtraError: onnx or onnxruntime is not installed.
        TrainingError: the disk is full, read-only or failing.
    """
    from auvbench.agents.learned import onnx_export

    refuse_incomplete(run)
    path_safety.refuse_links(run.path)
    config = load_config(run)
    if config.algo.agent == "onnx":
        raise NoNetworkError(f"{run.path}: its policy is already an ONNX file: {run.model / NETWORK}")
    if why := why_no_network(config.algo.name, config.algo.agent, learns(config.algo)):
        raise NoNetworkError(f"{run.path}: {why}")
    agent = make_agent(run, config.step.frequency)
    network = getattr(agent, "network", None)
    network_and_scaling = None if network is None else network()
    if network_and_scaling is None:
        raise NoNetworkError(f"{run.path}: {NO_NETWORK.format(name=config.algo.name)}")
    policy, scaling = network_and_scaling
    vehicle = sheet.load(config.vehicle)
    n_u = len(vehicle.actuators)
    spec = observation_spec(config.task, vehicle.actuators)
    about = {"run": run.id, "vehicle": vehicle.name, "frequency_hz": f"{config.step.frequency:g}"}
    try:
        data = onnx_export.build(policy, spec.size, scaling, about)
    except RunError as error:
        raise RunError(f"{run.path}: {error}") from error
    count, difference, limit = compare(config, agent, data, n_u, str(run.path))
    target = (folder if folder is not None else run.path / "exports") / f"{run.id}.onnx"
    card = make_card(run, config, vehicle, data, target.name)
    card["check"] = {"observations": count, "largest_difference": difference, "limit": limit}
    packages = ("onnx", "onnxruntime", "onnxscript")
    card["versions"] = provenance.versions() | {name: metadata.version(name) for name in packages}
    card_path = exported.card_path(target)
    path_safety.check_output(target.parent, (target.name, card_path.name))
    with storage(f"cannot write into {target.parent}"):
        # Write the card first: its digest of the ONNX file reveals an old ONNX file next to a new card.
        write_atomic(card_path, as_lines(card))
        write_atomic(target, data)
    return Export(run, target, card_path, count, difference)


NO_NETWORK = "{name} cannot be exported: its policy is not a network that computes each action from only one observation"


def why_no_network(name: str, agent: str, learner: bool) -> str:
    """Return why an agent cannot be exported; '' if it can.

    For a learner from a plug-in, the result is ''; only `export` checks whether the learner has a network.

    Args:
        name: `algo.name` of the agent.
        agent: `algo.agent` of the agent.
        learner: whether the agent learns.
    """
    if not learner:
        return f"{name} is a controller, not a trained network; there is nothing to export"
    return "" if agent not in AGENTS.own or AGENTS[agent].exportable else NO_NETWORK.format(name=name)


def compare(
    config: schema.TrainConfig, agent: Agent, data: bytes, n_u: int, where: str
) -> tuple[int, float, float]:
    """Compare an ONNX file with its agent, in test episodes and at the edges of the observation space.

    Returns:
        Number of observations, the largest difference between actions, and the limit of this difference.

    Raises:
        RunError: the difference exceeds the limit, or an output is not a valid action.
    """
    observations = np.concatenate([observe_episodes(config, agent, STEPS), observe_edges(config)])
    own = np.asarray(agent.act(observations), dtype=np.float64)
    sizes = {"observations": observations.shape[1], "actions": n_u}
    many, single = (exported.Policy(data, f"{where} (exported)", rows=n, **sizes) for n in (exported.ROWS, 1))
    few = slice(None, None, max(1, len(observations) // 500))
    difference = max(
        float(np.abs(many.act(observations) - own).max()),
        float(np.abs(single.act(observations[few]) - own[few]).max()),
    )
    limit = LIMIT
    if not difference <= limit:
        nudged = [np.nextafter(observations, np.float32(way), dtype=np.float32) for way in (-np.inf, np.inf)]
        limit = max(limit, *(ROUNDINGS * float(np.abs(agent.act(near) - own).max()) for near in nudged))
    if not difference <= limit:
        raise RunError(
            f"{where}: the exported network's actions differ from the run's by {difference:.3g}, more than {limit:.3g}; "
            "nothing was written"
        )
    return len(observations), difference, limit


def make_card(
    run: RunDirectory, config: schema.TrainConfig, vehicle: VehicleModel, data: bytes, name: str
) -> dict[str, Any]:
    """Return the card of a run's policy, without the result of the comparison."""
    from auvbench.agents.learned import onnx_export

    task = config.task
    plain = run.config()
    policy = exported.Policy(data, name)
    ports = [
        {"name": p.name, "type": p.type, "shape": ["n" if length is None else length for length in p.shape]}
        for p in (policy.input, policy.output)
    ]
    manifest = run.manifest()
    return {
        "format": FORMAT,
        "schema_version": SCHEMA_VERSION,
        "name": run.id,
        "file": {
            "name": name,
            "bytes": len(data),
            "sha256": sha256(data),
            "opset": onnx_export.OPSET,
            "input": ports[0],
            "output": ports[1],
        },
        "vehicle": {
            "name": vehicle.name,
            "title": vehicle.title,
            "sha256": identity.digest_of(identity.without_descriptions(plain["vehicle"]), 64),
        },
        "task": {
            "name": task.name,
            "position_frame": task.position_frame,
            **({"block_packages": dict(task.block_packages)} if task.block_packages else {}),
            **task.card(),
            "depth_low_m": task.depth_low,
            "depth_high_m": task.depth_high,
            "max_steps": step_limit(task, config.step.frequency),
        },
        "frequency_hz": config.step.frequency,
        "observation": observation_spec(task, vehicle.actuators).card(),
        "action": [_action(unit) for unit in vehicle.units],
        "run": {
            "id": run.id,
            "algorithm": config.algo.name,
            "seed": config.seed,
            "steps": manifest["steps"],
            "config_sha256": identity.digest_of(
                {"schema_version": identity.SCHEMA_VERSION, "config": identity.relevant(plain)}, 64
            ),
        },
        "tests": _tests(run, manifest),
    }


def _action(unit: Actuator) -> dict[str, Any]:
    """Return an actuator's name and its force or angle at the commands -1, 0 and +1.

    The vehicle's sheet has the curve between these commands.
    """
    low, high = unit.curve.limits
    return {
        "name": unit.name,
        "kind": unit.kind,
        "low": -1.0,
        "high": 1.0,
        "curve": unit.curve.kind,
        "command_low": float(low),
        "command_neutral": float(unit.curve(0.0)),
        "command_high": float(high),
        "command_unit": unit.unit,
    }


def _tests(run: RunDirectory, manifest: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the undamaged tests of the run's present model, sorted by the protocol's name."""
    model = integrity.digests(manifest, "model/")
    tests = []
    for path in sorted(run.path.glob("evaluations/*/summary.json")):
        summary = read_summary(run, path.parent.name)
        if summary is None or summary["run"] != run.id or summary["model"] != model:
            continue
        conditions = [{key: c[key] for key in TESTED if key in c} for c in summary["conditions"]]
        test = {key: summary[key] for key in ("protocol", "fingerprint")}
        tests.append({**test, "conditions": conditions})
    return tests


def observe_episodes(
    config: schema.TrainConfig, agent: Agent, steps: int, scenarios: str = "test"
) -> Observations:
    """Return the observations of an agent in the first steps of `EPISODES` episodes on the embedded
    simulator.

    Raises:
        ActionError: an action of the agent is not valid.
    """
    batch = batch_of(scenarios, embedded(config), np.arange(EPISODES), 0)
    observation = batch.reset()
    agent.reset(np.arange(EPISODES))
    observations = []
    for _ in range(steps):
        observations.append(observation.copy())
        observation = batch.step(agent.act(observation)).observation
    return np.concatenate(observations)


def observe_edges(config: schema.TrainConfig) -> Observations:
    """Return observations (m, size): the centre of the observation space, the centre with one value at its lower
    or upper bound, random corners of the space, and random points in it.
    """
    high = bounded_spec(config, sheet.load(config.vehicle)).bounds.astype(np.float64)
    n = len(high)
    rng = np.random.default_rng(0)
    corners = rng.choice([-1.0, 1.0], size=(CORNERS, n))
    between = rng.uniform(-1.0, 1.0, size=(CORNERS, n))
    points = np.concatenate([np.zeros((1, n)), np.eye(n), -np.eye(n), corners, between])
    return np.asarray(points * high, dtype=np.float32)


def check_policy(config: schema.TrainConfig, agent: PolicyFile) -> None:
    """Check a policy from a file on observations from episodes and at the edges of the observation space.

    Raises:
        PolicyError: an output is not a valid action, changes when it is computed again, or depends on other
            observations of the batch.
    """
    policy = agent.policy
    assert policy is not None
    policy.act(observe_edges(config))
    observations = observe_episodes(config, agent, CHECK_STEPS, scenarios="validation")
    if not np.array_equal(policy.act(observations), policy.act(observations)):
        raise PolicyError(f"{policy.where}: {exported.DIFFERENT}")
    _check_rows(policy, observations[:: max(1, len(observations) // 64)][:64])


def _check_rows(policy: Policy, rows: Observations) -> None:
    """Check that the outputs stay the same for the observations in reverse order, and for one observation at a time.

    Raises:
        PolicyError: an output differs.
    """
    batched, reversed_order = policy.act(rows), policy.act(rows[::-1])[::-1]
    single = np.concatenate([policy.act(row[None]) for row in rows[:8]])
    differs = max(float(np.abs(batched - reversed_order).max()), float(np.abs(batched[:8] - single).max()))
    if differs > SLACK:
        raise PolicyError(
            f"{policy.where}: its action for an observation depends on the other rows of the batch (it differs by "
            f"{differs:.2g}); the file must compute each row of its input independently"
        )
