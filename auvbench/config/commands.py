"""Specs of auvbench's own commands, in the order of `auvbench --help`. Importing this module imports no command."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.registry import Spec


@dataclass(frozen=True, slots=True)
class CommandSpec(Spec):
    """Description of a command, available without importing its code."""

    name: str
    """Word after `auvbench`."""
    title: str
    """One line of `auvbench --help`."""
    function: str
    """`module:function` that takes the words after the command and returns the exit code, or None for 0."""
    completed: tuple[str, ...] = ()
    """Keys that tab completion offers; set only for commands that accept few keys."""
    schema: None = None

    @property
    def code(self) -> str:
        """Return `module:function` of the command."""
        return self.function


def _own(name: str, title: str, *completed: str) -> CommandSpec:
    return CommandSpec(name, title, f"auvbench.commands.{name}:main", completed)


init = _own("init", "create a project with your own controller, task, vehicle and experiment")
train = _own("train", "train one run, or a grid of runs with -m")
resume = _own("resume", "finish interrupted runs, or extend runs to a larger budget", "train.total_steps")
evaluate = _own("evaluate", "apply a test protocol to trained runs", "protocol", "protocol.episodes")
tune = _own("tune", "search for settings of an algorithm on validation scenarios")
report = _own("report", "rank runs and write tables, figures and a page")
compare = _own("compare", "compare two runs or agents side by side")
publish = _own("publish", "copy a study's rows, tables and figures into a folder for publication")
submit = _own("submit", "check your own entry and write it as one archive")
verify = _own("verify", "test an entry again from its archive, and compare the rows")
bound = _own(
    "bound", "compute lower and upper bounds of the time to each waypoint", "protocol", "vehicle", "output"
)
plan = _own("plan", "compute how many seeds and episodes resolve a difference")
vehicles = _own("vehicles", "list vehicles, or show what one vehicle's numbers imply")
identify = _own(
    "identify",
    "fit the numbers of a vehicle sheet to logs, with intervals",
    "vehicle",
    "parameters",
    "name",
    "frame",
    "window",
    "replicates",
    "gate",
    "output",
)
validate = _own(
    "validate", "compare the predictions of vehicle sheets with logs", "vehicle", "frame", "output"
)
simulate = _own("simulate", "simulate one vehicle open loop, to CSV or a plot")
runs = _own("runs", "list runs with their state, progress and success")
export = _own("export", "write the policy of a run as an ONNX file with a card")
replay = _own("replay", "replay one test episode: summary, figure, film")
completion = _own("completion", "print a script for tab completion in bash, zsh or fish")
