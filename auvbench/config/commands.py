"""The specs of auvbench's own commands, in the order of `auvbench --help`. Importing it imports no command."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.registry import Spec


@dataclass(frozen=True, slots=True)
class CommandSpec(Spec):
    """Everything that auvbench knows of a command without importing it."""

    name: str
    """The word after `auvbench`."""
    title: str
    """One line of `auvbench --help`."""
    function: str
    """`module:function`: called with the words after the command, it returns the exit code, or None for 0."""
    schema: None = None

    @property
    def code(self) -> str:
        """`module:function`."""
        return self.function


def _own(name: str, title: str) -> CommandSpec:
    return CommandSpec(name, title, f"auvbench.commands.{name}:main")


init = _own("init", "make a project with a controller, task, vehicle and experiment of your own")
train = _own("train", "train one run, or a grid of runs with -m")
resume = _own("resume", "finish interrupted runs, or extend runs to a larger budget")
evaluate = _own("evaluate", "apply a test protocol to trained runs")
tune = _own("tune", "search for settings of an algorithm on validation scenarios")
report = _own("report", "rank runs and write tables, figures and a page")
compare = _own("compare", "show two runs or agents side by side")
publish = _own("publish", "copy a study's rows, tables and figures into a folder to ship")
submit = _own("submit", "check an entry of your own and write it as one archive")
verify = _own("verify", "test an entry again from its archive, and compare the rows")
bound = _own("bound", "compute the shortest time known to each waypoint")
plan = _own("plan", "say how many seeds and episodes resolve a difference")
vehicles = _own("vehicles", "list vehicles, or show what one vehicle's numbers imply")
simulate = _own("simulate", "integrate one vehicle open loop, to CSV or a plot")
serve = _own("serve", "put a simulator behind ROS 2, or behind ArduSub")
pilot = _own("pilot", "steer a vehicle over ROS 2 by an exported policy or a controller")
runs = _own("runs", "list runs with state, progress and success")
export = _own("export", "write the policy of a run as an ONNX file with a card")
replay = _own("replay", "show one test episode again: summary, figure, film")
completion = _own("completion", "print a script for tab completion in bash, zsh or fish")
