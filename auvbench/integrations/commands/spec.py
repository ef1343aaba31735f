"""Specs of the commands that talk to foreign systems. Importing this module imports no command."""

from __future__ import annotations

from auvbench.config.commands import CommandSpec


def _spec(name: str, title: str, *completed: str) -> CommandSpec:
    return CommandSpec(name, title, f"auvbench.integrations.commands.{name}:main", completed)


serve = _spec(
    "serve",
    "connect a simulator to ROS 2 or ArduSub",
    "vehicle",
    "simulator",
    "disturbance",
    "step.frequency",
    "task.start",
    "seed",
)
pilot = _spec("pilot", "steer a vehicle over ROS 2 or MAVLink by an exported policy or a controller")
