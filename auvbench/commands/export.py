"""`auvbench export RUN`: the policy of a trained run as an ONNX file with a card."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from auvbench.commands.grammar import Parser
from auvbench.errors import AuvbenchError, RunError


def parser() -> Parser:
    parser = Parser(
        prog="auvbench export",
        where=True,
        description="Writes the policies of trained runs as ONNX files, each with a card in JSON that says what goes in and "
        "out. A file takes raw observations and answers with actions in [-1, 1]; it is compared with the run's own "
        "actions and refused where they differ by more than 1e-5. `algo=onnx algo.path=FILE` enters it, or any "
        "other framework's, into a benchmark (docs/policies-as-files.md).",
    )
    parser.add_argument(
        "paths", nargs="+", type=Path, metavar="PATH", help="run directories or folders of runs"
    )
    parser.add_argument("--out", type=Path, help="folder of the files (default: each run's exports/)")
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
        print(f"left out, for they have no trained network: {', '.join(without[:3])}{more}")
    if done is None:
        raise RunError(f"none of the {len(runs)} runs was exported")
    print(f"next: auvbench train algo=onnx algo.path={shlex.quote(str(done.path))}{_clock(done.card_path)}")
    return 1 if failed else 0


def require() -> None:
    """Look for the packages, before torch is imported for seconds.

    Raises:
        MissingExtraError: one of them is not installed.
    """
    from importlib.util import find_spec

    from auvbench.errors import MissingExtraError

    for package in ("onnx", "onnxruntime", "onnxscript"):
        if find_spec(package) is None:
            raise MissingExtraError(package, extra="onnx", purpose="exported policies")


def _clock(path: Path) -> str:
    """What of the card differs from the defaults and has to be typed."""
    from auvbench.policies.exported import read_card

    card = read_card(path)
    typed = "" if card.vehicle.name == "bluerov2" else f" vehicle={card.vehicle.name}"
    typed += "" if card.frequency_hz == 10.0 else f" step.frequency={card.frequency_hz:g}"
    task = str(card.document["task"].get("name", "waypoint"))
    if task != "waypoint":
        return f"{typed} task={task}"
    return typed + (
        "" if card.task.position_frame == "world" else f" task.position_frame={card.task.position_frame}"
    )
