"""`auvbench export RUN`: write the policy of a trained run as an ONNX file with a card."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from auvbench.errors import AuvbenchError, RunError
from auvbench.grammar import Parser

if TYPE_CHECKING:
    from auvbench.runs.directory import RunDirectory


def parser() -> Parser:
    parser = Parser(
        prog="auvbench export",
        where=True,
        description="Writes the policies of trained runs as ONNX files, each with a JSON card that "
        "describes its inputs and "
        "outputs. A file takes raw observations and returns actions in [-1, 1]. The file's actions are "
        "compared with the run's "
        "own actions; a difference above 1e-5 is an error. `algo=onnx algo.path=FILE` benchmarks the file, "
        "or a file of any "
        "other framework (docs/policies-as-files.md).",
    )
    parser.add_argument(
        "paths", nargs="+", type=Path, metavar="PATH", help="run directories or folders of runs"
    )
    parser.add_argument("--out", type=Path, help="folder for the files (default: each run's exports/)")
    return parser


def main(arguments: Sequence[str]) -> int:
    options = parser().read(arguments)
    from auvbench.runs import run_filter

    if options.out is not None and options.out.is_file():
        raise RunError(f"--out {options.out}: is a file; name a folder")
    runs = run_filter.find(options.paths, options.where)
    require()
    from auvbench.evaluation.exporting import NoNetworkError, export

    done = None
    failed, without = 0, []
    for run in runs:
        try:
            done = export(run, options.out)
        except AuvbenchError as error:
            if len(runs) == 1:
                raise
            if isinstance(error, NoNetworkError):
                without.append(run.id)
                continue
            failed += 1
            print(f"auvbench: {error}", file=sys.stderr)
            continue
        print(
            f"{done.path}\n  largest difference from the run's own actions {done.difference:.1e}, "
            f"{done.observations:,} observations; card: {done.card_path.name}",
            flush=True,
        )
    if without:
        more = f" and {len(without) - 3} more" if len(without) > 3 else ""
        print(f"skipped, no trained network: {', '.join(without[:3])}{more}")
    if done is None:
        raise RunError(f"none of the {len(runs)} runs could be exported")
    print(f"next: auvbench train algo=onnx algo.path={shlex.quote(str(done.path))}{_as_trained(done.run)}")
    return 1 if failed else 0


def require() -> None:
    """Check that the packages for ONNX are installed, before the slow import of torch.

    Raises:
        MissingExtraError: a package is not installed.
    """
    from importlib.util import find_spec

    from auvbench.errors import MissingExtraError

    for package in ("onnx", "onnxruntime", "onnxscript"):
        if find_spec(package) is None:
            raise MissingExtraError(package, extra="onnx", purpose="exported policies")


def _as_trained(run: RunDirectory) -> str:
    """Return the overrides that give `auvbench train algo=onnx` the observations and actions of the exported run."""
    config = run.check()
    vehicle, frequency = config["vehicle"]["name"], config["step"]["frequency"]
    words = [f"vehicle={vehicle}"]
    words += [] if frequency == 10.0 else [f"step.frequency={frequency:g}"]
    words += _task(config["task"])
    return "".join(f" {shlex.quote(word)}" for word in words)


def _task(task: Mapping[str, Any]) -> list[str]:
    """Return the overrides that select the task and observation of a policy.

    If a file of the task has the policy's observation, return one override `task=FILE`. Otherwise, return `task=NAME` and an
    override for each key that differs from the file of this name.
    """
    from omegaconf import OmegaConf

    from auvbench.config import folders
    from auvbench.config.compose import option
    from auvbench.evaluation.protocol import KEPT
    from auvbench.runs.run_filter import flat

    def observed(values: Mapping[str, Any]) -> dict[str, Any]:
        typed = [key for key in KEPT if key in values and key != "block_packages"]
        return flat({key: values[key] for key in typed}, "task.")

    values_of_policy, name = observed(task), str(task["name"])
    other_tasks = [choice for choice in folders.options("task") if choice != name]
    differing: dict[str, Any] = {}
    for choice in (name, *other_tasks):
        defaults = OmegaConf.to_container(option("task", choice))
        assert isinstance(defaults, dict)
        if defaults["name"] != name:
            continue
        has = observed({str(key): value for key, value in defaults.items()})
        changed = {key: value for key, value in values_of_policy.items() if has.get(key) != value}
        if not changed:
            return [f"task={choice}"]
        differing = differing or changed
    values = [f"{key}={json.dumps(value).replace(', ', ',')}" for key, value in differing.items()]
    return [f"task={name}", *(word.replace('"', "") for word in values)]
