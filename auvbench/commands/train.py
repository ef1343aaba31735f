"""`auvbench train`: train one run, or a grid of runs with -m."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from omegaconf import DictConfig

    from auvbench.runs.directory import RunDirectory


def main(arguments: Sequence[str]) -> int:
    from auvbench.config.compose import read
    from auvbench.grammar import read_named_sheets

    read_named_sheets(arguments)
    command = shlex.join(["auvbench", "train", *arguments])
    request = read("train", arguments, grid=True, dry_run=True)
    if request is None:
        return 0
    configs = request.configs
    if request.dry_run:
        return _dry_run(configs)
    # Only grids use launchers, so a single run with a launcher other than `local` becomes a grid of one run.
    if request.grid or configs[0].launcher.name != "local":
        return _grid(configs, command)
    return _train(configs[0], command)


def _remark(configs: Sequence[DictConfig]) -> None:
    from auvbench.runs import budgets

    for remark in budgets.remarks(configs):
        print(f"note: {remark}", file=sys.stderr)


def _grid(configs: Sequence[DictConfig], command: str) -> int:
    from auvbench.scheduling import grid

    _remark(configs)
    return grid.carry_out(configs, command).exit_code


def _dry_run(configs: Sequence[DictConfig]) -> int:
    from auvbench.scheduling import dry_run

    _remark(configs)
    return dry_run.show(configs)


def _train(config: DictConfig, command: str) -> int:
    from auvbench.runs.plan import plan
    from auvbench.training.execute import check_runnable

    planned = plan(config)
    _remark([config])
    check_runnable(planned.config)
    return carry_out(planned.freeze(command), shown=planned.config.train.progress)


def carry_out(run: RunDirectory, *, shown: bool | None = None) -> int:
    """Train one run in this process and return the exit code.

    Args:
        run: run directory with a frozen configuration.
        shown: whether to show a live bar; None: use the value of `train.progress`.
    """
    from auvbench.runs import status

    run_status = status.of(run, deep=True)
    if run_status.state is status.State.COMPLETE:
        print(
            f"{run.path}: complete already, nothing to do (auvbench resume RUN train.total_steps=N extends it)"
        )
        return 0
    # Imported late, since a complete run does not need these modules.
    from auvbench.commands.progress import Bar
    from auvbench.config.algorithms import learns
    from auvbench.config.navigation import is_estimated
    from auvbench.runs.plan import load_config
    from auvbench.runs.progress import WINDOW, telling
    from auvbench.training import worker
    from auvbench.training.execute import execute

    config = load_config(run)
    if shown is None:
        shown = config.train.progress
    trained = learns(run.config()["algo"])
    steps, total = run_status.manifest["steps"], run_status.manifest["total_steps"]
    lost = f"{run_status.lost}: training continues from the last checkpoint; " if run_status.lost else ""
    budget = f", {steps:,} of {total:,} steps" if trained else ""
    print(f"{run.path}: {lost}{run_status.state}{budget}", flush=True)
    bar = Bar(total, now="compiling, first episodes") if shown else None
    with bar or nullcontext():
        worker.carry_out(run, lambda run: execute(run, bar.watch if bar else None))
    manifest = run.manifest()
    rate = telling(manifest["success_rate"], manifest["episodes"])
    last = min(manifest["episodes"], WINDOW)
    success = "" if rate is None else f", success over the last {last} episodes {100 * rate:.0f} %"
    print(
        f"complete: {manifest['steps']:,} steps in {manifest['wall_time_s']:.1f} s{success}"
        if trained
        else "complete: nothing to train"
    )
    print(f"{run.path}")
    # The default protocol sets `noise`, which a configuration with an estimator rejects; protocol=own does not.
    protocol = " protocol=own" if is_estimated(config) else ""
    print(f"next: auvbench evaluate {shlex.quote(str(run.path))}{protocol}")
    return 0
