"""Kills runs at random instants and compares what they end with to an uninterrupted run, bit by bit.

    python -m tests.soak.campaign --cases sac-1 td3-8 --kills 10 --folder /tmp/soak

A warm process forks a child per attempt, so that an attempt costs no import and no compilation. Two in five
deaths are timed, two fall on a file operation of the run's directory, where timers hardly ever hit, and one is
SIGTERM, which the run answers by saving. Only SIGKILLs are counted. Prints a line of JSON per case.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import random
import shutil
import signal
import sys
import time
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.soak.bits import bits
from tests.soak.killing import kill_at_operation

# Short episodes with every noise and every disturbance on: currents, faults, delays, sensors, drawn vehicles.
_NETS = [
    *("algo.net_arch=[16,16]", "task.max_steps=15", "noise=thesis"),
    *("disturbance=severe", "disturbance.fault.time_high=1.0"),
]
_PPO = ["algo=ppo", *_NETS, "algo.batch_size=32", "algo.n_epochs=2"]
_ON = [*_NETS, "algo.batch_size=32", "algo.n_envs=8", "algo.n_steps=16", "train.total_steps=2000"]
_OFF = [*_NETS, "algo.batch_size=16", "algo.learning_starts=40", "algo.buffer_size=400"]
_ONE = ["algo.n_envs=1", "algo.gradient_steps=1", "train.total_steps=150"]
# The ring of 50 rows is overwritten twice.
_EIGHT = ["algo.n_envs=8", "algo.gradient_steps=2", "train.total_steps=1000"]

CASES: dict[str, list[str]] = {
    "ppo-1": [*_PPO, "algo.n_envs=1", "algo.n_steps=32", "train.total_steps=400"],
    "ppo-8": [*_PPO, "algo.n_envs=8", "algo.n_steps=16", "train.total_steps=2000"],
    **{f"{algo}-1": [f"algo={algo}", *_OFF, *_ONE] for algo in ("sac", "ddpg", "td3")},
    **{
        f"{algo}-8": [f"algo={algo}", *_OFF, *_EIGHT]
        for algo in ("sac", "ddpg", "td3", "tqc", "crossq", "sac_residual")
    },
    "trpo-8": ["algo=trpo", *_ON, "algo.n_critic_updates=2"],
    "recurrent_ppo-8": ["algo=recurrent_ppo", *_ON, "algo.n_epochs=2", "algo.lstm_size=8"],
    "ppo_residual-8": ["algo=ppo_residual", *_ON, "algo.n_epochs=2"],
}


@dataclasses.dataclass
class Tally:
    """What happened to one case."""

    case: str
    kills: int = 0  # attempts that ended by SIGKILL
    at_operation: int = 0  # of these, at a file operation
    terminated: int = 0  # attempts that ended by SIGTERM, having saved
    finished: int = 0  # runs that were brought to their end and compared
    resumed: int = 0  # attempts that began at a checkpoint
    differences: list[str] = dataclasses.field(default_factory=list)


def frozen(folder: Path, name: str, case: str, extra: list[str]) -> Any:
    """The run directory of a case, frozen like that of a command."""
    from auvbench.runs.plan import prepare
    from tests import configs

    config = configs.composed(*CASES[case], "train.progress=false", *extra)
    config.output, config.name = str(folder), name
    return prepare(config)


def attempt(run: Any, death: tuple[str, float] | None) -> int:
    """One forked process that works on a run; its exit status, or minus the signal that ended it."""
    child = os.fork()
    if child == 0:
        status = 1
        try:
            from auvbench.training.execute import execute

            sys.stderr = (run.path / "stderr.txt").open("a")
            if death and death[0] == "operation":
                kill_at_operation(run.path, int(death[1]))
            execute(run)
            status = 0
        except BaseException as error:
            status = getattr(error, "exit_code", 1)
            if status == 1:
                import traceback

                traceback.print_exc(file=sys.stderr)
        finally:
            sys.stderr.flush()
            os._exit(status)
    if death and death[0] != "operation":
        time.sleep(death[1])
        os.kill(child, signal.SIGKILL if death[0] == "time" else signal.SIGTERM)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def campaign(case: str, folder: Path, kills: int, rng: random.Random) -> Tally:
    """Kills runs of one case until there were `kills` SIGKILLs; every run is brought to its end."""
    tally = Tally(case)
    whole = frozen(folder, "whole", case, [])
    began = time.monotonic()
    if status := attempt(whole, None):
        raise SystemExit(
            f"{case}: the uninterrupted run failed with {status}: {(whole.path / 'stderr.txt').read_text()}"
        )
    duration = time.monotonic() - began
    expected = bits(whole.path)
    while tally.kills < kills:
        every = rng.choice([10, 50, 200])
        run = frozen(folder, f"killed-{tally.finished}", case, [f"train.checkpoint.steps={every}"])
        while True:
            kind = rng.choice(["time", "time", "operation", "operation", "terminate"])
            amount = rng.randint(1, 120) if kind == "operation" else rng.uniform(0.0, 0.5 * duration)
            tally.resumed += any(path.name.isdigit() for path in run.path.glob("checkpoints/*"))
            status = attempt(run, (kind, amount) if tally.kills < kills else None)
            if status == 0:
                break
            tally.kills += status == -signal.SIGKILL
            tally.at_operation += status == -signal.SIGKILL and kind == "operation"
            tally.terminated += status in (128 + signal.SIGTERM, -signal.SIGTERM)
            if status not in (-signal.SIGKILL, 128 + signal.SIGTERM, -signal.SIGTERM):
                tally.differences.append(
                    f"exit status {status}: {(run.path / 'stderr.txt').read_text()[-2000:]}"
                )
                return tally
        found = bits(run.path)
        tally.finished += 1
        tally.differences += [
            key for key in expected.keys() | found.keys() if expected.get(key) != found.get(key)
        ]
        if tally.differences:
            return tally
        shutil.rmtree(run.path)
    return tally


def warm_up(folder: Path, cases: Sequence[str]) -> None:
    """Everything that the forked children find ready: libraries, compiled kernels, what torch imports late."""
    import gc

    import numba
    import torch

    from auvbench.training.execute import execute

    torch.set_num_threads(1)
    numba.set_num_threads(1)
    for case in cases:
        execute(frozen(folder, "warm", case, ["train.total_steps=50"]))
    gc.freeze()  # a collection in a child then copies no page


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--kills", type=int, default=20, help="per case")
    parser.add_argument("--seed", type=int, default=0, help="of the instants")
    parser.add_argument("--folder", type=Path, required=True)
    given = parser.parse_args()
    warnings.simplefilter("default")
    warm_up(given.folder, given.cases)
    differ = False
    for case in given.cases:
        began = time.monotonic()
        tally = campaign(case, given.folder / case, given.kills, random.Random(f"{given.seed} {case}"))
        differ |= bool(tally.differences)
        print(
            json.dumps({**dataclasses.asdict(tally), "seconds": round(time.monotonic() - began, 1)}),
            flush=True,
        )
    return int(differ)


if __name__ == "__main__":
    sys.exit(main())
