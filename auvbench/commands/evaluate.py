"""`auvbench evaluate`: applies a test protocol to trained runs."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from auvbench.errors import UserError

if TYPE_CHECKING:
    from auvbench.config.schema import EvaluateConfig
    from auvbench.runs.directory import RunDirectory

USAGE = """\
usage: auvbench evaluate PATH... [protocol=NAME] [KEY=VALUE ...]

Applies a test protocol to complete runs: every agent meets the same frozen scenarios, with a deterministic
policy and frozen statistics. What is tested already is skipped.

  PATH            run directories, or folders that hold some
  protocol=NAME   test (default): 500 episodes, seed 123, 10 Hz
                  thesis: the first 200 of them    native: each agent at its own frequency
                  frequency_sweep: 10, 25, 55 Hz   robustness: currents, faults, delays, noise, other masses
                  transfer: the same policy on other vehicles with the same actuators
  force=true      test again what is tested already
  workers=N       runs tested at once (default: one per core)
  --cfg job       print the configuration of the test and stop

examples:
  auvbench evaluate outputs
  auvbench evaluate outputs/default protocol=thesis
"""


def main(arguments: Sequence[str]) -> int:
    if not arguments or any(a in ("-h", "--help") for a in arguments):
        print(USAGE, end="")
        return 0 if arguments else 2
    from auvbench.config.compose import compose
    from auvbench.config.validate import evaluate_config

    if "--cfg" in arguments:
        from omegaconf import OmegaConf

        overrides = [a for a in arguments if "=" in a]
        print(OmegaConf.to_yaml(compose("evaluate", overrides)), end="")
        return 0
    for argument in arguments:
        if argument.startswith("-"):
            raise UserError(f"{argument}: no such option; auvbench evaluate --help shows what there is")
    paths = [a for a in arguments if "=" not in a]
    config = evaluate_config(compose("evaluate", [a for a in arguments if "=" in a]))
    if not paths:
        raise UserError("name a run directory or a folder that holds runs, e.g. auvbench evaluate outputs")
    from auvbench.runs.directory import find_runs

    return _evaluate_all(find_runs(paths), config)


def _evaluate_all(runs: list[RunDirectory], config: EvaluateConfig) -> int:
    from auvbench.commands.bars import counting_bar
    from auvbench.evaluation.parallel import evaluate_all

    done = failed = 0
    with counting_bar(len(runs), f"protocol {config.protocol.name}") as tell:
        results = evaluate_all(
            runs, config.protocol, workers=config.workers, force=config.force, report=tell.doing
        )
        for result in results:
            if result.error:
                failed += 1
                tell.line(f"auvbench: {result.error}", error=True)
            elif result.summary is None:
                done += 1
                tell.line(f"{result.run.id}: {config.protocol.name} done already")
            else:
                for line in _lines(result.run, result.summary):
                    tell.line(line)
    if failed == len(runs):
        raise UserError("nothing could be evaluated")
    which = "" if config.protocol.name == "test" else f" --protocol {config.protocol.name}"
    print(f"next: auvbench report {shlex.quote(str(runs[0].path.parent))}{which}")
    return 1 if failed else 0


def _lines(run: RunDirectory, summary: dict[str, Any]) -> list[str]:
    from auvbench.statistics import wilson

    lines = []
    for condition in summary["conditions"]:
        n, rate = condition["episodes"], condition["success_rate"]
        low, high = wilson(round(rate * n), n)
        name = "" if len(summary["conditions"]) == 1 else f" {condition['name']}:"
        lines.append(
            f"{run.id}:{name} success {100 * rate:.1f} % [{100 * low:.1f}, {100 * high:.1f}] of {n} episodes, "
            f"mean steps {condition['mean_steps']:.0f}"
        )
    return lines
