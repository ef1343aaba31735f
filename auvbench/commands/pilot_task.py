"""The task of a pilot: what its controller observes, and the limits of the water. No Hydra, no compiled code."""

from __future__ import annotations

from dataclasses import replace
from importlib import resources
from typing import TYPE_CHECKING, Any

from auvbench.errors import ConfigError, UserError, closest
from auvbench.untrusted.text import short

if TYPE_CHECKING:
    from auvbench.config import tasks
    from auvbench.observation import ObservationSpec
    from auvbench.policies.cards import Card
    from auvbench.vehicles.vehicle_model import VehicleModel

TASKS = ("waypoint", "station_keeping")
"""Tasks whose reference is a pose at rest, as `/goal_pose` gives it."""


def task_of(name: str, where: str) -> tasks.Task:
    """Return a task with the values of its file.

    Raises:
        ConfigError: its reference is not a pose at rest.
    """
    from auvbench.config import tasks

    if name not in TASKS:
        raise ConfigError(
            f"{where} {short(name, 40)}: a pilot takes its reference from /goal_pose, a pose at rest; {closest(name, TASKS)}"
        )
    values = defaults("task", name)
    if "preview" in values:
        values["preview"] = tasks.Preview(**values["preview"])
    made: tasks.Task = tasks.SCHEMAS[name](**values)
    return made


def task_of_policy(
    word: str, card: Card, asked: str | None, vehicle: VehicleModel
) -> tuple[tasks.Task, ObservationSpec]:
    """Return the task of a policy, as its card says, and what it observes.

    Raises:
        UserError: a pilot has no reference for its task, or cannot supply what it observes.
    """
    from auvbench.pilot.observation import SUPPLIED
    from auvbench.tasks.observation import observation_spec

    named = card.document["task"]
    trained = str(named.get("name", "waypoint"))
    if asked not in (None, trained):
        raise UserError(f"--task {asked}: {word} was trained with task={short(trained, 40)}, its card says")
    task = task_of(trained, f"{word}: its task is")
    # "velocity_x" and "velocity_error_x" both begin with "velocity".
    blocks = [
        max((b for b in SUPPLIED if label.startswith(b)), key=len, default="") for label in card.observed
    ]
    try:
        changed: dict[str, Any] = {
            "depth_low": float(named["depth_low_m"]),
            "depth_high": float(named["depth_high_m"]),
            "max_steps": int(named["max_steps"]),
        }
        if trained == "waypoint":
            changed["goal_radius"] = float(named["goal_radius_m"])
    except (KeyError, TypeError, ValueError) as error:
        raise UserError(f"{word}: its card has no valid entry of the task: {short(error)}") from error
    observation = list(dict.fromkeys(filter(None, blocks))) or [*SUPPLIED]
    task = replace(task, position_frame=card.task.position_frame, observation=observation, **changed)
    spec = observation_spec(task, vehicle.actuators)
    supplied = [entry["name"] for entry in spec.card()]
    if supplied != list(card.observed):
        wrong = next((name for name in card.observed if name not in supplied), card.observed[-1])
        raise UserError(
            f"{word}: observes {short(wrong, 40)}, which a pilot does not have; it has {', '.join(SUPPLIED)}"
        )
    return task, spec


def defaults(group: str, name: str) -> dict[str, Any]:
    """Return the values of a file of the configuration, without Hydra."""
    import yaml

    text = (resources.files("auvbench.conf") / group / f"{name}.yaml").read_text(encoding="utf-8")
    values = yaml.safe_load(text)
    values.pop("defaults", None)
    return dict(values)
