"""`auvbench export`: the policy of a trained run as an ONNX file, checked against the run's own actions, and its card.

The format of both is in docs/policies-as-files.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from auvbench.agents.base import Agent
from auvbench.config import schema
from auvbench.config.agents import AGENTS, learns
from auvbench.config.clock import step_limit
from auvbench.errors import RunError
from auvbench.evaluation import observations
from auvbench.evaluation.evaluate import make_agent, read_summary
from auvbench.policies import cards, exported
from auvbench.policies.cards import FORMAT, SCHEMA_VERSION
from auvbench.policies.exported import NETWORK
from auvbench.runs import identity, integrity, provenance
from auvbench.runs.atomic_io import as_lines, sha256, storage, write_atomic
from auvbench.runs.directory import RunDirectory
from auvbench.runs.plan import load_config
from auvbench.untrusted import path_safety
from auvbench.vehicles import sheet
from auvbench.vehicles.actuators import Actuator
from auvbench.vehicles.model import VehicleModel

LIMIT = 1e-5
"""largest difference between an action of the file and the run's own that is let through, unless the last bits of an
observation change the run's own by much: large weights magnify any rounding"""

ROUNDINGS = 4.0
"""times that change: an observation is rounded once, and what is made of it in each of the layers again, in an order of
summation that is the library's own"""

STEPS = 100
"""of each of the test episodes whose observations the file is checked on"""

RATES = ("success_rate", "collision_rate", "timeout_rate", "mean_steps", "mean_return")
"""of a test's conditions, that a card repeats"""


class NoNetworkError(RunError):
    """The run's actions are not those of a trained network, or they are a file already."""


@dataclass(frozen=True, slots=True)
class Export:
    """A policy that was written."""

    run: RunDirectory
    path: Path
    card_path: Path
    observations: int
    difference: float
    """largest difference of an action from the run's own, on so many observations"""


def export(run: RunDirectory, folder: Path | None = None, more: Mapping[str, Any] | None = None) -> Export:
    """Writes `<run id>.onnx` and `<run id>.json`; what was there under these names is replaced.

    Args:
        run: a complete run of an agent that learns.
        folder: where to; None for the run's own `exports/`.
        more: further entries of the card.

    Raises:
        RunError: the run is not complete, has no network, its files are damaged, or the file's actions are not the run's.
        MissingExtraError: onnx or onnxruntime is not installed.
        TrainingError: the disk is full, read-only or failing.
    """
    from auvbench.agents.learned import onnx_export

    manifest = run.manifest()
    if manifest["state"] != "complete":
        raise RunError(f"{run.path}: {manifest['state']}, not complete; auvbench train finishes it")
    path_safety.check(run.path)
    config = load_config(run)
    _refuse_others(run, config)
    agent = make_agent(run, config.step.frequency)
    network = getattr(agent, "network", None)
    found = None if network is None else network()
    if found is None:
        raise NoNetworkError(f"{run.path}: {no_network(config.algo.name)}")
    policy, scaling = found
    vehicle = sheet.load(config.vehicle)
    n_u = len(vehicle.actuators)
    about = {"run": run.id, "vehicle": vehicle.name, "frequency_hz": f"{config.step.frequency:g}"}
    try:
        data = onnx_export.build(policy, 4 + n_u, scaling, about)
    except RunError as error:
        raise RunError(f"{run.path}: {error}") from error
    count, difference, limit = compare(config, agent, data, n_u, str(run.path))
    target = (folder if folder is not None else run.path / "exports") / f"{run.id}.onnx"
    card = make_card(run, config, vehicle, data, target.name)
    card["check"] = {"observations": count, "largest_difference": difference, "limit": limit}
    card["versions"] = _versions()
    card |= more or {}
    path_safety.check_output(target.parent, (target.name, cards.card_path(target).name))
    with storage(f"cannot write into {target.parent}"):
        # The card first: it names the file's digest, so that an old file beside it is noticed.
        write_atomic(cards.card_path(target), as_lines(card))
        write_atomic(target, data)
    return Export(run, target, cards.card_path(target), count, difference)


def compare(
    config: schema.TrainConfig, agent: Agent, data: bytes, n_u: int, where: str
) -> tuple[int, float, float]:
    """On how many observations an ONNX file was compared with the agent that it is of, the largest difference, its limit.

    Test episodes of the run's own task, and the edges of its observation space; many rows at once and one by one.

    Raises:
        RunError: it exceeds the limit, or an answer is no action.
    """
    seen = np.concatenate([observations.of_episodes(config, agent, STEPS), observations.of_edges(config)])
    own = np.asarray(agent.act(seen), dtype=np.float64)
    sizes = {"observations": seen.shape[1], "actions": n_u}
    many, one = (exported.Policy(data, f"{where} (exported)", rows=n, **sizes) for n in (exported.ROWS, 1))
    few = slice(None, None, max(1, len(seen) // 500))
    difference = max(
        float(np.abs(many.act(seen) - own).max()), float(np.abs(one.act(seen[few]) - own[few]).max())
    )
    limit = LIMIT
    if not difference <= limit:
        nudged = [np.nextafter(seen, np.float32(way), dtype=np.float32) for way in (-np.inf, np.inf)]
        limit = max(limit, *(ROUNDINGS * float(np.abs(agent.act(near) - own).max()) for near in nudged))
    if not difference <= limit:
        raise RunError(
            f"{where}: the exported network's actions differ from the run's by {difference:.3g}, more than {limit:.3g}; "
            "nothing was written"
        )
    return len(seen), difference, limit


def make_card(
    run: RunDirectory, config: schema.TrainConfig, vehicle: VehicleModel, data: bytes, name: str
) -> dict[str, Any]:
    """The card of a run's policy, but for what the check has found."""
    task = config.task
    plain = run.config()
    found = exported.check(data, name)
    manifest = run.manifest()
    return {
        "format": FORMAT,
        "schema_version": SCHEMA_VERSION,
        "name": run.id,
        "file": {
            "name": name,
            "bytes": len(data),
            "sha256": sha256(data),
            "opset": found.file.opset,
            **{
                kind: {
                    "name": port.name,
                    "type": port.type,
                    "shape": ["n" if length is None else length for length in port.shape or ()],
                }
                for kind, port in (("input", found.input), ("output", found.output))
            },
        },
        "vehicle": {
            "name": vehicle.name,
            "title": vehicle.title,
            "sha256": identity.digest_of(identity.without_descriptions(plain["vehicle"]), 64),
        },
        "task": {
            "name": task.name,
            "position_frame": task.position_frame,
            "start_m": list(task.start),
            "waypoint_low_m": list(task.waypoint_low),
            "waypoint_high_m": list(task.waypoint_high),
            "goal_radius_m": task.goal_radius,
            "depth_low_m": task.depth_low,
            "depth_high_m": task.depth_high,
            "max_steps": step_limit(task, config.step.frequency),
        },
        "frequency_hz": config.step.frequency,
        "observation": _observation(task.position_frame, vehicle),
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


def _refuse_others(run: RunDirectory, config: schema.TrainConfig) -> None:
    """What has nothing that a file of weights could hold."""
    if config.algo.agent == "onnx":
        raise NoNetworkError(f"{run.path}: its policy is an ONNX file already: {run.model / NETWORK}")
    if not learns(config.algo):
        raise NoNetworkError(f"{run.path}: {computed(config.algo.name)}")


def answers_by_itself(agent: str) -> bool:
    """Return whether a learner's policy (`algo.agent`) is one feed-forward network; a plug-in's export decides itself."""
    spec = AGENTS.get(agent)
    return spec is None or spec.exportable


def no_network(name: str) -> str:
    """Why a learner has no file of which that is not so."""
    return f"the actions of {name} are not those of a network that answers each observation by itself; it is not exported"


def computed(name: str) -> str:
    """Why an agent that learns nothing has no file."""
    return f"{name} is a controller that auvbench computes, not a trained network; there is nothing to export"


def _observation(frame: str, vehicle: VehicleModel) -> list[dict[str, str]]:
    axes = "world axes (east, north, up)"
    if frame == "body":
        axes = "levelled body axes (forward, port, up), turned by the yaw reading"
    entries = [
        {
            "name": "yaw_error",
            "unit": "rad",
            "meaning": "bearing of the waypoint less yaw, wrapped to [-pi, pi)",
        }
    ]
    entries += [
        {"name": f"position_error_{axis}", "unit": "m", "meaning": f"waypoint less position, {axes}"}
        for axis in "xyz"
    ]
    entries += [
        {
            "name": f"previous_action_{name}",
            "unit": "1",
            "meaning": "what was asked for in the last step, in [-1, 1]; 0 at the start",
        }
        for name in vehicle.actuators
    ]
    return entries


UNITS = {"fin": "rad", "mass_shifter": "m", "buoyancy_engine": "m3", "drop_weight": "1"}
"""of the commands of actuators that are no thrusters"""


def _action(unit: Actuator) -> dict[str, Any]:
    """What -1 and +1 stand for; between them the curve is as the sheet has it."""
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
        "command_unit": UNITS.get(unit.kind, "rad/s" if unit.rotor_constant else "N"),
    }


def _tests(run: RunDirectory, manifest: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The tests of this very model that are there and whole, by name."""
    model = integrity.digests(manifest, "model/")
    found = []
    for path in sorted(run.path.glob("evaluations/*/summary.json")):
        summary = read_summary(run, path.parent.name)
        if summary is None or summary.get("run") != run.id or summary.get("model") != model:
            continue
        found.append(
            {
                "protocol": summary.get("protocol"),
                "fingerprint": summary.get("fingerprint"),
                "conditions": [
                    {key: c[key] for key in ("name", "frequency_hz", "episodes", *RATES) if key in c}
                    for c in summary["conditions"]
                ],
            }
        )
    return found


def _versions() -> dict[str, str]:
    packages = ("onnx", "onnxruntime", "onnxscript")
    return {**provenance.versions(), **{name: metadata.version(name) for name in packages}}
