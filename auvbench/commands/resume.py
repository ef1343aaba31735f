"""`auvbench resume`: finish interrupted runs, or extend complete runs to a larger budget."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from typing import TYPE_CHECKING

from auvbench.errors import AuvbenchError, ConfigError, RunError
from auvbench.grammar import Parser, paths_and_overrides

if TYPE_CHECKING:
    from auvbench.runs.directory import RunDirectory

BUDGET = "train.total_steps"

_EPILOG = """examples:
  auvbench resume outputs                                  finish every interrupted, failed or pending run
  auvbench resume outputs --where algo=ppo                 finish the runs of PPO
  auvbench resume outputs/default/ppo-bluerov2_2026-k1-f10-s42-6ee0abf6  finish this run
  auvbench resume outputs/default/ppo-bluerov2_2026-k1-f10-s42-6ee0abf6 train.total_steps=2000000
                                                           extend this run to a larger budget, as a new run

A resumed run ends with the same bits as a run that was never interrupted (docs/resume.md).
"""


def main(arguments: Sequence[str]) -> int:
    options = parser().read(arguments, overrides=True)
    paths, overrides = paths_and_overrides(options.runs)
    if not paths:
        raise ConfigError("resume: name at least one run or folder, e.g. auvbench resume outputs")
    from auvbench.commands import train
    from auvbench.runs import run_filter
    from auvbench.runs.directory import RunDirectory

    runs = run_filter.find(paths, options.where)
    for override in overrides:
        runs = _extended(runs, _budget(override), shlex.join(["auvbench", "resume", *arguments]))
    if len(runs) > 1:  # in parallel, each in its own process
        from auvbench.scheduling.grid import sweep
        from auvbench.scheduling.local import LocalBackend

        return sweep(runs, LocalBackend(options.workers), check=RunDirectory.check).exit_code
    runs[0].check()
    return train.carry_out(runs[0])


def parser() -> Parser:
    parser = Parser(
        prog="auvbench resume",
        description="Finishes interrupted, failed and pending runs, or extends runs to a larger budget.",
        epilog=_EPILOG,
        where=True,
        workers="runs",
    )
    parser.add_argument(
        "runs",
        nargs="*",
        metavar="RUN",
        help=f"run directories or folders of runs; {BUDGET}=N extends the runs to N steps",
    )
    return parser


def _budget(override: str) -> int:
    """Return the number in `train.total_steps=N`."""
    from auvbench.config.schema import whole

    key, _, value = override.partition("=")
    if key != BUDGET:
        raise ConfigError(
            f"{override}: resume accepts only {BUDGET}=N; use auvbench train for a different run"
        )
    if (total := whole(value)) is None:
        raise ConfigError(f"{override}: {value!r} is not a whole number")
    return total


def _extended(runs: Sequence[RunDirectory], total: int, command: str) -> list[RunDirectory]:
    from auvbench.training.checkpoint.extending import prepare

    extensions, problems = [], []
    for run in runs:  # Check all extensions before the first new run is written.
        try:
            extensions.append(prepare(run, total))
        except AuvbenchError as error:
            problems.append(error)
    if problems and len(runs) > 1:
        raise RunError(
            f"{problems[0]} ({len(problems)} of {len(runs)} runs cannot be extended; no run was changed)"
        )
    if problems:
        raise problems[0]
    targets = []
    for extension in extensions:
        target = extension.begin(command)
        print(f"{target.path}: extends {extension.run.id} to {total:,} steps")
        targets.append(target)
    return targets
