"""Check the policy file of `algo=onnx`, and copy it into a run.

The file is checked before the run is created (`with_policy`), and then copied into the run (`keep`). The run's identity
contains the file's SHA-256 (`algo.sha256`), not its path.
"""

from __future__ import annotations

import copy
import re
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, open_dict

from auvbench.config import schema
from auvbench.config.algorithms.onnx import ONNX
from auvbench.errors import ConfigError
from auvbench.policies import exported
from auvbench.runs import integrity
from auvbench.runs.atomic_io import sha256, storage, write_atomic
from auvbench.runs.directory import RunDirectory
from auvbench.runs.identity import DEFAULT_TASK
from auvbench.tasks.observation_spec import observation_spec
from auvbench.untrusted import path_safety
from auvbench.untrusted.text import short
from auvbench.vehicles.vehicle_model import VehicleModel

UNNAMED = "onnx"
"""value of `algo.name` in conf/algo/onnx.yaml; it is replaced by the name in the policy's card, else by the file's name"""

LONGEST = 80
"""largest number of characters of a policy's name, which is part of a folder's name"""


def with_policy(
    config: DictConfig, typed: schema.TrainConfig, algo: ONNX, vehicle: VehicleModel
) -> DictConfig:
    """Check a policy's file; return the configuration with the file's digest and name.

    Args:
        config: composed configuration.
        typed: the same configuration, typed and checked.
        algo: `algo` of `typed`.
        vehicle: vehicle of the configuration.

    Raises:
        ConfigError: the file's digest differs from `algo.sha256`, or the policy's card differs from the configuration
            in the actuators, observations, frame or frequency.
        PolicyError: the file cannot be read, is not a policy, or has a wrong number of inputs or outputs.
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


def keep(run: RunDirectory, config: dict[str, Any]) -> None:
    """Copy the policy file and its card into a run, unless the run has the file.

    Args:
        run: run directory.
        config: resolved configuration, with the file's digest from `with_policy`.

    Raises:
        PolicyError: the file has changed since `with_policy` read it.
        TrainingError: the disk cannot be written.
    """
    algo = config["algo"]
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
    """Raise ConfigError if the card differs from the configuration in the actuators, observations, frame or frequency.

    Without this check, the policy of a different vehicle or task could steer this vehicle wrongly, without an error.
    """
    if card.actuators != vehicle.actuators:
        raise ConfigError(
            f"algo.path={where}: its card is for the vehicle {card.vehicle.name}, which has the actuators {', '.join(card.actuators)}; "
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
            f"task={config.task.name}: the card of {where} says that the policy observes {what}; type the task and the blocks of "
            f"its training, task={trained} (task.observation lists the blocks)"
        )
    if card.task.position_frame != config.task.position_frame:
        raise ConfigError(
            f"task.position_frame={config.task.position_frame}: the card of {where} says that the position error is in the "
            f"{card.task.position_frame} frame; type task.position_frame={card.task.position_frame}"
        )
    if card.frequency_hz != config.step.frequency:
        raise ConfigError(
            f"step.frequency={config.step.frequency:g}: the card of {where} says that the policy acts at {card.frequency_hz:g} Hz; "
            f"type step.frequency={card.frequency_hz:g} (a protocol may test it at another frequency)"
        )


def _label(name: str) -> str:
    """Return the name of a card or file in the characters that a folder's name may contain.

    >>> _label("my policy (3).best")
    'my-policy-3-.best'
    """
    plain = re.sub(r"[^A-Za-z0-9._+-]+", "-", name).lstrip("._+-")[:LONGEST]
    return plain or UNNAMED
