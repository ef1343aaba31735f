"""From a composed configuration to a frozen run, everything checked before anything starts, and back again."""

from __future__ import annotations

import copy
import re
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf, open_dict

from auvbench.ardusub import sitl
from auvbench.config import algorithms, schema
from auvbench.config.compose import typed
from auvbench.config.validate import resolved, train_config
from auvbench.errors import ConfigError
from auvbench.policies import exported
from auvbench.runs import declared, identity, integrity
from auvbench.runs.atomic_io import sha256, storage, write_atomic
from auvbench.runs.directory import RunDirectory, freeze, place
from auvbench.tasks.observation import observation_spec
from auvbench.untrusted import path_safety
from auvbench.untrusted.text import short
from auvbench.vehicles import sheet
from auvbench.vehicles.inspect import shortest_time_constant
from auvbench.vehicles.vehicle_model import VehicleModel


def load_config(run: RunDirectory) -> schema.TrainConfig:
    """The typed configuration of a run directory, its identity checked.

    Raises:
        RunError: the directory is no run, or its configuration was changed.
        ConfigError: a value is out of range.
    """
    return typed(OmegaConf.create(run.check()))


def resolve_run(config: DictConfig) -> RunDirectory:
    """Checks types, values, the vehicle's sheet and a policy's file; returns where the run will lie. Writes nothing.

    Raises:
        ConfigError: a value is wrong.
        VehicleError: the sheet breaks a rule.
        PolicyError: the file of `algo=onnx` cannot be used.
    """
    return place(_plain(_settled(config)))


def check_vehicle(config: schema.TrainConfig) -> VehicleModel:
    """The vehicle, if its sheet is right and it is not too quick to be integrated.

    Raises:
        ConfigError, VehicleError: it is not.
    """
    vehicle = sheet.load(config.vehicle)
    sheet.refuse_stiff_vehicle(vehicle.name, shortest_time_constant(vehicle))
    return vehicle


def prepare(config: DictConfig, command: str = "") -> RunDirectory:
    """`check`, then the run's directory on disk: from here on, editing YAML changes nothing.

    Raises:
        ConfigError, VehicleError, PolicyError: as `check`.
        RunError: the directory holds another configuration, or cannot be written.
        TrainingError: the disk is full or failing.
    """
    plain = _plain(_settled(config))
    # Before the manifest, which says that there is a run.
    _keep_policy(place(plain), plain)
    return freeze(plain, command, _declared(config))


def _declared(config: DictConfig) -> declared.Declared | None:
    """Return the analysis that a composed configuration declares."""
    found: Any = OmegaConf.select(config, declared.KEY)
    return None if found is None else declared.Declared(**{key: found[key] for key in declared.DECLARED})


def _settled(config: DictConfig) -> DictConfig:
    typed = train_config(config)
    return sitl.settled(_with_policy(config, typed, check_vehicle(typed)), typed)


def _plain(config: DictConfig) -> dict[str, object]:
    # The analysis is none of the run's: it lies next to the runs.
    plain = {key: value for key, value in resolved(config).items() if key != declared.KEY}
    if found := identity.first_interpolation(plain):  # from a value with \${ in it
        raise ConfigError(f"{found}: a run's configuration holds no ${{ }}")
    return plain


# The policy file of `algo=onnx`: read and checked once, named by its content, copied into the run. A run's identity holds
# its SHA-256 (`algo.sha256`), not its path.

UNNAMED = "onnx"
"""the name of conf/algo/onnx.yaml, in whose place that of the card or of the file stands"""

LONGEST = 80
"""characters of a name: it is part of a folder's"""


def _with_policy(config: DictConfig, typed: schema.TrainConfig, vehicle: VehicleModel) -> DictConfig:
    """Return the configuration with digest and name of its policy's file, if it has one.

    Args:
        config: composed.
        typed: the same, checked.
        vehicle: that of the configuration.

    Raises:
        ConfigError: the file is another than `algo.sha256` says, or its card is of another vehicle, frequency or frame.
        PolicyError: it cannot be read, is no policy, or not one of this vehicle's size.
        MissingExtraError: ONNX Runtime is not installed.
    """
    algo = typed.algo
    if not isinstance(algo, algorithms.ONNX):
        return config
    if not algo.path:
        raise ConfigError("algo.path: a value is missing; name the file: algo=onnx algo.path=policy.onnx")
    path = Path(algo.path)
    data, card, _ = exported.read(path)
    digest = sha256(data)
    if algo.sha256 not in ("", digest):
        raise ConfigError(f"algo.sha256={algo.sha256}: algo.path={path} has {digest}")
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
    """Copy the file of a settled configuration, and its card, into a run that lacks it.

    Raises:
        PolicyError: it is not the file that the configuration was settled with.
        TrainingError: the disk does not take it.
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
            f"{algo['path']}: was changed while the run was made; type the command again"
        )
    with storage(f"cannot write {run.model}"):
        # The network last: where it is, its card is.
        if card_data is not None:
            write_atomic(run.model / exported.CARD, card_data)
        else:
            (run.model / exported.CARD).unlink(missing_ok=True)
        write_atomic(target, data)


def _compare(card: exported.Card, where: str, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
    """Refuse a file of another vehicle, frame or frequency, which would steer wrongly without an error."""
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
        trained = short(str(card.document["task"].get("name", "waypoint")), 40)
        raise ConfigError(
            f"task={config.task.name}: {where} observes {what}, its card says; it was trained with task={trained} "
            "(task.observation lists what is observed)"
        )
    if card.task.position_frame != config.task.position_frame:
        raise ConfigError(
            f"task.position_frame={config.task.position_frame}: {where} observes the position error in the "
            f"{card.task.position_frame} frame, its card says; type task.position_frame={card.task.position_frame}"
        )
    if card.frequency_hz != config.step.frequency:
        raise ConfigError(
            f"step.frequency={config.step.frequency:g}: {where} acts at {card.frequency_hz:g} Hz, its card says; "
            f"type step.frequency={card.frequency_hz:g} (a protocol may test it at another)"
        )


def _label(name: str) -> str:
    """Return the characters of a card's or file's name that the name of a folder can have.

    >>> _label("my policy (3).best")
    'my-policy-3-.best'
    """
    plain = re.sub(r"[^A-Za-z0-9._+-]+", "-", name).lstrip("._+-")[:LONGEST]
    return plain or UNNAMED
