"""`auvbench evaluate`: apply a test protocol to trained runs."""

from __future__ import annotations

import re
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from auvbench.errors import RunError, UserError
from auvbench.grammar import Parser, paths_and_overrides

if TYPE_CHECKING:
    from auvbench.config.schema import Protocol
    from auvbench.runs.directory import RunDirectory
    from auvbench.runs.status import RunStatus

EPILOG = """\
protocols:
  test (default)    500 episodes, seed 123, 10 Hz
  thesis            the first 200 episodes of test
  native            each agent at its training frequency
  frequency_sweep   10, 25, 55 Hz
  robustness        currents, faults, delays, noise, other masses
  transfer          the same policy on other vehicles with the same actuators
  suite             one disturbance at a time, also waves, for every task
  models            the published models of a BlueROV2, in still water and in 1 m/s of current
  own               each run with the task, noise and disturbances of its training
  FILE.json         a sealed protocol (docs/sealed.md)

Exit code 0 when every complete run is tested; 1 when a test failed or another process works on a run; 2 when there is
nothing to test or an argument is wrong.

examples:
  auvbench evaluate outputs
  auvbench evaluate outputs/default protocol=thesis
  auvbench evaluate outputs protocol=sealed-example.json
"""

KEYS = ("protocol", *(f"protocol.{key}" for key in ("episodes", "batch", "trajectories")))
"""Keys of the test that the command line may set"""


def parser() -> Parser:
    parser = Parser(
        prog="auvbench evaluate",
        description="Applies a test protocol to complete runs: every agent meets the same scenarios, with "
        "a deterministic policy\n"
        "and frozen normalisation statistics. Skips finished tests. Lists incomplete runs and leaves them out.",
        epilog=EPILOG,
        where=True,
        keys=KEYS,
        workers="runs, or episodes of a slow controller,",
    )
    add = parser.add_argument
    add("words", nargs="*", metavar="PATH", help="runs or folders of runs; protocol=NAME, protocol.KEY=VALUE")
    add("-c", "--cfg", choices=("job",), help="print the configuration of the test and exit")
    add("--force", action="store_true", help="repeat finished tests")
    return parser


def main(arguments: Sequence[str]) -> int:
    options = parser().read(arguments, overrides=True)
    from auvbench.config.compose import compose
    from auvbench.config.validate import evaluate_config
    from auvbench.runs import run_filter

    paths, overrides = paths_and_overrides(options.words)
    _refuse_mixed(overrides, options.where)
    protocol: Protocol
    if file := _sealed(overrides):
        from auvbench.evaluation import sealed

        protocol = sealed.read(file)
    else:
        composed = compose("evaluate", overrides)
        if options.cfg:
            from omegaconf import OmegaConf

            print(OmegaConf.to_yaml(composed), end="")
            return 0
        protocol = evaluate_config(composed).protocol
    if not paths:
        raise UserError("name a run directory or a folder of runs, e.g. auvbench evaluate outputs")
    return _evaluate_all(run_filter.find(paths, options.where), protocol, options.workers, options.force)


def _sealed(overrides: Sequence[str]) -> Path | None:
    """Return the file of a sealed protocol; None for a named protocol.

    Raises:
        UserError: an override would change the sealed protocol.
    """
    files = [word for word in overrides if word.startswith("protocol=") and word.endswith(".json")]
    if not files:
        return None
    if overriding := [word for word in overrides if word not in files[:1]]:
        raise UserError(f"{overriding[0]}: a sealed protocol cannot be changed; leave {overriding[0]} out")
    return Path(files[0].removeprefix("protocol="))


def _refuse_mixed(overrides: Sequence[str], terms: Sequence[str]) -> None:
    """Reject keys at the wrong place: keys of a run's configuration before `--where`, and keys of the test after `--where`."""
    from auvbench.config.schema import TrainConfig

    for word in overrides:
        if re.split(r"[.=]", word)[0] in TrainConfig.__annotations__:
            raise UserError(
                f"{word}: is a key of runs, not of the test; to test only matching runs type --where {word}"
            )
    for term in terms:
        if term.partition("=")[0] in KEYS:
            raise UserError(f"--where {term}: selects runs; to set {term} type it before --where")


def _evaluate_all(runs: list[RunDirectory], protocol: Protocol, workers: int, force: bool) -> int:
    from auvbench.commands.progress import RunBar
    from auvbench.evaluation.parallel import PRELOAD, evaluate_all
    from auvbench.runs.directory import as_words
    from auvbench.runs.interruption import Interrupted, immediate
    from auvbench.runs.pool import Pool

    ready, unfinished = _ready(runs)
    if not ready:
        raise UserError(f"nothing to evaluate: {_left_out(unfinished)}")
    ends = Counter[str]()
    episodes = protocol.episodes * len(protocol.conditions)
    with (
        RunBar(len(ready), f"protocol {protocol.name}", episodes) as tell,
        Pool(workers, PRELOAD) as pool,
        immediate() as request,
    ):
        try:
            for result in evaluate_all(ready, protocol, pool, force=force, report=tell.doing):
                if result.error and request.signal is not None:
                    break
                if result.error:
                    ends["locked" if result.locked else "failed"] += 1
                    tell.line(f"auvbench: {result.error}", error=True)
                elif result.summary is None:
                    ends["already"] += 1
                    tell.line(None)
                else:
                    ends["tested"] += 1
                    again = [f"{result.run.id}: tested again: {result.why}"] if result.why else []
                    tell.line("\n".join([*again, *_lines(result.run, result.summary)]))
                if request.signal is not None:
                    break
        except (
            Interrupted,
            Exception,
        ):  # On an interruption, a solver may raise any exception, or swallow the interruption.
            if request.signal is None:
                raise
        if request.signal is not None:
            done = (
                f"interrupted: {ends['tested'] + ends['already']} of {len(ready)} runs are tested and "
                "saved; run the same command to continue"
            )
            raise Interrupted(request.signal, done) from None
    if done_before := ends["already"]:
        what = "run is" if done_before == 1 else "runs are"
        print(f"{done_before} {what} already tested by protocol {protocol.name} (--force tests again)")
    if unfinished:
        print(f"auvbench: {_left_out(unfinished)}", file=sys.stderr)
    if not ends["tested"] and not done_before:
        if ends["locked"]:
            return 1
        raise UserError("no run could be evaluated")
    argument = "" if protocol.name == "test" else f" --protocol {protocol.name}"
    print(f"next: auvbench report {as_words([run.path for run in ready], alone=0)}{argument}")
    return 1 if ends["failed"] or ends["locked"] else 0


def _ready(runs: Sequence[RunDirectory]) -> tuple[list[RunDirectory], list[RunStatus]]:
    """Return the runs to test, and the incomplete runs. The runs to test include damaged runs, whose damage the test reports."""
    from auvbench.runs import status

    ready, unfinished = [], []
    for run in runs:
        try:
            present: RunStatus | None = status.of(run)
        except RunError:
            present = None
        if present is None or present.state is status.State.COMPLETE:
            ready.append(run)
        else:
            unfinished.append(present)
    return ready, unfinished


def _left_out(unfinished: Sequence[RunStatus]) -> str:
    """Return one line: the number of incomplete runs by state, and the command that finishes them."""
    from auvbench.runs.directory import as_words
    from auvbench.runs.status import State

    counts = Counter(entry.state for entry in unfinished)
    states = ", ".join(f"{counts[state]} {state}" for state in State if counts[state])
    text = f"{len(unfinished)} {'run is' if len(unfinished) == 1 else 'runs are'} incomplete and left out ({states})"
    paths = [entry.run.path for entry in unfinished if entry.state is not State.RUNNING]
    if not paths:
        return f"{text}: evaluate again later"
    return f"{text}; finish with auvbench resume {as_words(paths)}"


def _lines(run: RunDirectory, summary: dict[str, Any]) -> list[str]:
    from auvbench.statistics import wilson

    lines = []
    for condition in summary["conditions"]:
        n, rate = condition["episodes"], condition["success_rate"]
        low, high = wilson(round(rate * n), n)
        name = "" if len(summary["conditions"]) == 1 else f" {condition['name']}:"
        lines.append(
            f"{run.id}:{name} success {100 * rate:.1f} % [{100 * low:.1f}, {100 * high:.1f}] of {n} episodes, "
            f"PAR-1 steps {condition['par1_steps']:.0f}"
        )
    for what in (summary.get("sealed") or {}).get("not_tested", []):
        lines.append(f"{run.id}: not tested: {what}")
    return lines
