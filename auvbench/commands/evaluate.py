"""`auvbench evaluate`: applies a test protocol to trained runs."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from auvbench.errors import AuvbenchError, UserError

if TYPE_CHECKING:
    from auvbench.config.schema import EvaluateConfig
    from auvbench.runs.directory import RunDirectory

USAGE = """\
usage: auvbench evaluate PATH... [protocol=NAME] [KEY=VALUE ...]

Applies a test protocol to complete runs: every agent meets the same frozen scenarios, with a deterministic
policy and frozen statistics. What is tested already is skipped.

  PATH            run directories, or folders that hold some
  protocol=test   500 episodes, seed 123, 10 Hz (default); protocol=thesis: the first 200 of them
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
    from auvbench.evaluation.evaluate import evaluate, is_done

    protocol = config.protocol
    failed = 0
    for run in runs:
        try:
            if not config.force and is_done(run, protocol):
                print(f"{run.id}: {protocol.name} done already")
                continue
            summary = evaluate(run, protocol)
            for condition in summary["conditions"]:
                print(
                    f"{run.id}: {condition['name']}: success {100 * condition['success_rate']:.1f} % of "
                    f"{condition['episodes']}, mean steps {condition['mean_steps']:.0f}",
                    flush=True,
                )
        except AuvbenchError as error:
            failed += 1
            print(f"auvbench: {error}", file=sys.stderr)
    if failed == len(runs):
        raise UserError("nothing could be evaluated")
    print(f"next: auvbench report {runs[0].path.parent}")
    return 1 if failed else 0
