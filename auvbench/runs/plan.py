"""Turn a composed configuration into a frozen run, with all checks before anything starts, and load it again."""

from __future__ import annotations

import copy
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf, open_dict

from auvbench.config import schema
from auvbench.config.algorithms.onnx import ONNX
from auvbench.config.compose import once_for_all_seeds, typed
from auvbench.config.validate import resolved, train_config
from auvbench.errors import ConfigError
from auvbench.policies import exported
from auvbench.registry import AGENTS, WORLDS, resolve
from auvbench.runs import declared, declaring, identity, integrity
from auvbench.runs.atomic_io import sha256, storage, write_atomic
from auvbench.runs.directory import RunDirectory, freeze, now, place, unwritable
from auvbench.runs.identity import DEFAULT_TASK
from auvbench.tasks.observation_spec import observation_spec
from auvbench.untrusted import path_safety
from auvbench.untrusted.text import short
from auvbench.vehicles import sheet
from auvbench.vehicles.inspect import shortest_time_constant
from auvbench.vehicles.vehicle_model import VehicleModel


def load_config(run: RunDirectory) -> schema.TrainConfig:
    """Return the typed configuration of a run directory, its identity checked.

    Raises:
        RunError: the directory is not a run, or its configuration was changed.
        ConfigError: a value is out of range.
    """
    values = run.check()
    return once_for_all_seeds(
        "run", values, lambda: typed(OmegaConf.create(values)), lambda config, own: replace(config, **own)
    )


@dataclass(frozen=True, slots=True)
class Plan:
    """A run after all checks that are possible before it is written to disk."""

    config: schema.TrainConfig
    values: dict[str, Any]
    """all values, as `config.yaml` will contain them"""

    @property
    def run(self) -> RunDirectory:
        """Return the run's future directory."""
        return place(self.values)

    def freeze(self, command: str = "") -> RunDirectory:
        """Create the run's directory: from now on, editing YAML changes nothing.

        Raises:
            RunError: the directory has a different configuration, or cannot be written.
            PolicyError: the file of `algo=onnx` was changed after the check.
            TrainingError: the disk is full or failing.
        """
        return freeze_all([self], command)[0]


def freeze_all(plans: Sequence[Plan], command: str = "") -> list[RunDirectory]:
    """Declare the runs of an experiment, then create their directories; return them in the order of the
    plans.

    Raises:
        ConfigError: an analysis names an unknown protocol or condition; nothing is written then.
        RunError, PolicyError, TrainingError: see `Plan.freeze`.
    """
    digests = _declare(plans)
    runs = []
    for item in plans:
        # Written before the manifest, which marks the run as existing.
        _keep_policy(item.run, item.values)
        runs.append(freeze(item.values, command, digests.get(item.run.path)))
    return runs


def _declare(plans: Sequence[Plan]) -> dict[Path, str]:
    """Declare the runs that have an analysis; return the digests for their manifests."""
    completed: dict[str, declared.Declared] = {}
    analyses: dict[Path, declared.Declared] = {}
    for item in plans:
        if (analysis := item.config.analysis) is not None:
            if (key := repr(analysis)) not in completed:
                completed[key] = declaring.completed(analysis)
            analyses[item.run.path] = completed[key]
    configs = {item.run.path: item.values for item in plans}
    try:
        return declaring.declare_all(analyses, configs, now())
    except OSError as error:
        raise unwritable(next(iter(analyses)).parent, error) from error


def plan(config: DictConfig) -> Plan:
    """Check types, values, the vehicle's sheet and the files of a composed configuration. Write nothing.

    Raises:
        ConfigError: a value is wrong.
        VehicleError: the sheet breaks a rule.
        PolicyError: the file of `algo=onnx` cannot be used.
    """
    checked = train_config(config)
    vehicle = check_vehicle(checked)
    if isinstance(checked.algo, ONNX):
        config = _with_policy(config, checked, checked.algo, vehicle)
    elif checked.algo.agent in AGENTS.own and (settled := AGENTS[checked.algo.agent].settled):
        config = resolve(settled)(config, checked.algo)
    if settled := WORLDS[checked.world.name].settled:
        config = resolve(settled)(config, checked.world)
    values = resolved(config)
    values.pop(declared.KEY, None)  # not part of the run: stored in the folder of the experiment
    if interpolation := identity.first_interpolation(values):  # left by a value with \${ in it
        raise ConfigError(f"{interpolation}: a run's configuration must not contain ${{ }}")
    return Plan(checked, values)


def prepare(config: DictConfig, command: str = "") -> RunDirectory:
    """Plan a run, then write it to the disk.

    Raises:
        ConfigError, VehicleError, PolicyError, RunError, TrainingError: see `plan` and `Plan.freeze`.
    """
    return plan(config).freeze(command)


def check_vehicle(config: schema.TrainConfig) -> VehicleModel:
    """Return the vehicle after checking its sheet and that its dynamics are slow enough to integrate.

    Raises:
        ConfigError, VehicleError: a check fails.
    """
    vehicle = sheet.load(config.vehicle)
    sheet.refuse_stiff_vehicle(vehicle.name, shortest_time_constant(vehicle))
    return vehicle


# The policy file of `algo=onnx` is read and checked once, named by its content, and copied into the run. The
# run's identity has the file's SHA-256 (`algo.sha256`), not its path.

UNNAMED = "onnx"
"""name in conf/algo/onnx.yaml, replaced by the name of the card or of the file"""

LONGEST = 80
"""largest number of characters of a policy's name, which is part of a folder's name"""


def _with_policy(
    config: DictConfig, typed: schema.TrainConfig, algo: ONNX, vehicle: VehicleModel
) -> DictConfig:
    """Return the configuration with digest and name of its policy's file.

    Args:
        config: composed configuration.
        typed: the same configuration, typed and checked.
        algo: `algo` of `typed`.
        vehicle: vehicle of the configuration.

    Raises:
        ConfigError: the file's digest differs from `algo.sha256`, or its card has another vehicle, frequency
            or frame.
        PolicyError: the file cannot be read, is not a policy, or does not fit the vehicle's sizes.
        MissingExtraError: ONNX Runtime is not installed.
    """
    if not algo.path:
        raise ConfigError("algo.path: a value is missing; name the file: algo=onnx algo.path=policy.onnx")
    path = Path(algo.path)
    data, card, _ = exported.read(path)
    digest = sha256(data)
    if algo.sha256 not in ("", digest):
        raise ConfigError(f"algo.sha256={algo.sha256}: algo.path={path} has the digest {digest}")
    if card is not None:
        _compare(card, str(path), typed, vehicle)
    sizes = {
        "observations": observation_spec(typed.task, vehicle.actuators).size,
        "actions": len(vehicle.actuators),
    }
    exported.Policy(data, str(path), card=card, **sizes)
    result = copy.deepcopy(config)
    with open_dict(result):
        result.algo.sha256 = digest
        if algo.name == UNNAMED:
            result.algo.name = _label(card.name if card is not None else path.stem)
    return result


def _keep_policy(run: RunDirectory, config: dict[str, Any]) -> None:
    """Copy the policy file of a settled configuration, and its card, into a run that lacks them.

    Raises:
        PolicyError: the file has changed since the configuration was settled.
        TrainingError: the disk cannot be written.
    """
    algo = config["algo"]
    if algo.get("agent") != "onnx":
        return
    path_safety.refuse_links(run.path)
    target = run.model / exported.NETWORK
    if target.is_file() and integrity.entry_of(target)["sha256"] == algo["sha256"]:
        return
    data, _, card_data = exported.read(Path(algo["path"]))
    if sha256(data) != algo["sha256"]:
        raise exported.PolicyError(
            f"{algo['path']}: was changed while the run was created; run the command again"
        )
    with storage(f"cannot write {run.model}"):
        # The network is written last: if it exists, its card exists.
        if card_data is not None:
            write_atomic(run.model / exported.CARD, card_data)
        else:
            (run.model / exported.CARD).unlink(missing_ok=True)
        write_atomic(target, data)


def _compare(card: exported.Card, where: str, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
    """Raise ConfigError for a file of another vehicle, frame or frequency, which would steer wrongly without
    an error.
    """
    if card.actuators != vehicle.actuators:
        raise ConfigError(
            f"algo.path={where}: its card is of {card.vehicle.name}, which has the actuators {', '.join(card.actuators)}; "
            f"vehicle={vehicle.name} has {', '.join(vehicle.actuators)}"
        )
    own = [entry["name"] for entry in observation_spec(config.task, vehicle.actuators).card()]
    if own != list(card.observed):
        missing = [name for name in card.observed if name not in own]
        what = (
            f"{missing[0]}, which is not observed here"
            if missing
            else f"{len(card.observation)} of the {len(own)} numbers"
        )
        trained = short(str(card.document["task"].get("name", DEFAULT_TASK)), 40)
        raise ConfigError(
            f"task={config.task.name}: the card of {where} says that it observes {what}, for task={trained} "
            "(task.observation lists the blocks)"
        )
    if card.task.position_frame != config.task.position_frame:
        raise ConfigError(
            f"task.position_frame={config.task.position_frame}: the card of {where} says that the position error is in the "
            f"{card.task.position_frame} frame; type task.position_frame={card.task.position_frame}"
        )
    if card.frequency_hz != config.step.frequency:
        raise ConfigError(
            f"step.frequency={config.step.frequency:g}: the card of {where} says that it acts at {card.frequency_hz:g} Hz; "
            f"type step.frequency={card.frequency_hz:g} (a protocol may test it at another frequency)"
        )


def _label(name: str) -> str:
    """Return the characters of a card's or file's name that a folder's name may contain.

    >>> _label("my policy (3).best")
    'my-policy-3-.best'
    """
    plain = re.sub(r"[^A-Za-z0-9._+-]+", "-", name).lstrip("._+-")[:LONGEST]
    return plain or UNNAMED
