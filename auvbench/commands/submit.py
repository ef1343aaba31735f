"""`auvbench submit`: check your own entry and write it as one archive."""

from __future__ import annotations

import argparse
import os
import re
import shlex
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from auvbench.errors import ReportError, UserError, closest
from auvbench.grammar import Parser, whole
from auvbench.runs.identity import DEFAULT_TASK

if TYPE_CHECKING:
    from auvbench.analysis.records import RunRecord
    from auvbench.config.schema import Protocol
    from auvbench.reporting.entries import Knowledge

NOTHING = "none"
WORDS = {"true velocities": "velocities"}
"""Kinds of knowledge that a report and `--knows` name differently: name in the report -> word after `--knows`"""


def parser() -> Parser:
    parser = Parser(
        prog="auvbench submit",
        where=True,
        description="Checks the runs of one agent (all its training seeds), or an ONNX file with its card, "
        "and writes one archive:\n"
        "configuration, model, test rows, and your declarations. docs/submitting.md explains the rules.",
        epilog="examples:\n"
        '  auvbench submit outputs/mine --name "My agent" --who "Jane Doe" --knows velocities --trials 20\n'
        "  auvbench submit policies/mine.onnx --name Mine --who 'Jane Doe' --knows none --trials 0 --out mine.zip",
    )
    add = parser.add_argument
    add("path", type=Path, metavar="PATH", help="folder of the agent's runs, or an ONNX file with its card")
    add("--name", required=True, help="name of the agent in tables, at most 60 characters")
    add("--who", required=True, help="your name, as others should cite it")
    add(
        "--knows",
        required=True,
        metavar="WHAT,...",
        help="what the agent knows beyond noisy positions and yaw: sheet (numbers of the vehicle), model (a simulation of it), "
        "preview (the reference ahead), map (the shortest way), velocities (true ones), or none",
    )
    add(
        "--trials",
        required=True,
        type=whole(0, 10**9),
        metavar="N",
        help="number of settings that you tried before the entered settings; 0: none",
    )
    add(
        "--tuned-on",
        default="",
        metavar="TEXT",
        help="scenarios on which you scored the trials, e.g. validation scenarios, scenarios of seed 7",
    )
    add("--protocol", default="test", metavar="NAME", help="test protocol of the rows; default test")
    add("--out", type=Path, metavar="FILE", help="file name of the archive; default NAME.zip")
    return parser


def main(arguments: Sequence[str]) -> int:
    given = parser().read(arguments)
    _check_words(given)
    target = given.out or Path(f"{slug(given.name)}.zip")
    if target.suffix != ".zip":
        raise UserError(f"--out {target}: must end in .zip")
    from auvbench.runs.atomic_io import check_writable

    check_writable(target, f"--out {target}")
    knows = _knows(given.knows)
    protocol = _protocol(given.protocol)
    with tempfile.TemporaryDirectory() as work:
        path = given.path
        if path.suffix == ".onnx":
            path = _entered(path, protocol, Path(work, "outputs"))
        runs = _runs(path, given.where, protocol, knows)
        _write(given, runs, knows, target, Path(work, "entry"))
    print(f"{target}: {len(runs)} run{'s' if len(runs) != 1 else ''}, {target.stat().st_size:,} bytes")
    print(f"next: auvbench verify {shlex.quote(os.path.relpath(target))}")
    return 0


def slug(name: str) -> str:
    """Return a name in a form that suits a file name.

    >>> slug("My agent (v2)")
    'my-agent-v2'
    """
    return re.sub(r"[^a-z0-9.]+", "-", name.lower()).strip("-.") or "entry"


def _check_words(given: argparse.Namespace) -> None:
    for flag, value, most in (
        ("--name", given.name, 60),
        ("--who", given.who, 200),
        ("--tuned-on", given.tuned_on, 500),
    ):
        if len(value) > most or not value.isprintable() or (flag != "--tuned-on" and not value.strip()):
            raise UserError(f"{flag}: must be one line of 1 to {most} characters, got {len(value)}")
    if given.trials and not given.tuned_on:
        raise UserError(
            f"--trials {given.trials}: name the scenarios on which you scored the trials: --tuned-on 'validation scenarios'"
        )


def _knows(text: str) -> tuple[Knowledge, ...]:
    from auvbench.reporting.entries import Knowledge

    words = [word.strip() for word in text.split(",") if word.strip()]
    known = (*get_args(Knowledge), NOTHING)
    for word in words:
        if word not in known:
            raise UserError(f"--knows {word}: unknown; {closest(word, known)}")
    if not words or (NOTHING in words and len(words) > 1):
        raise UserError(f"--knows {text}: name some of {', '.join(known[:-1])}, or {NOTHING}")
    return tuple(word for word in get_args(Knowledge) if word in words)


def _protocol(name: str) -> Protocol:
    from auvbench.config import folders
    from auvbench.config.compose import compose
    from auvbench.config.validate import evaluate_config

    if name not in (known := folders.options("protocol")):
        raise UserError(f"--protocol {name}: unknown; {closest(name, known)}")
    return evaluate_config(compose("evaluate", [f"protocol={name}"])).protocol


def _entered(path: Path, protocol: Protocol, output: Path) -> Path:
    """Create a run of an ONNX file below `output`, test the run by a protocol, and return the run's folder.

    Raises:
        PolicyError: the file or its card cannot be used.
    """
    from auvbench.config.compose import compose
    from auvbench.evaluation.evaluate import evaluate
    from auvbench.policies import exported
    from auvbench.runs.plan import prepare
    from auvbench.training.execute import execute

    card = exported.read_card(exported.card_path(path))
    task = str(card.document["task"].get("name", DEFAULT_TASK))
    words = ["algo=onnx", f"algo.path={path.absolute()}", f"vehicle={card.vehicle.name}", f"task={task}"]
    words += [f"step.frequency={card.frequency_hz:g}", f"output={output}", "name=entry"]
    words.append(f"task.position_frame={card.task.position_frame}")
    if blocks := card.document["task"].get("observation"):
        words.append(f"task.observation=[{','.join(map(str, blocks))}]")
    run = prepare(compose("train", words))
    execute(run)
    evaluate(run, protocol)
    return run.path


def _runs(path: Path, where: Sequence[str], protocol: Protocol, knows: Sequence[str]) -> list[RunRecord]:
    """Return the runs of one agent, all tested on the current scenarios.

    Raises:
        ReportError: the runs cannot be an entry.
    """
    from auvbench.analysis.conditions import default
    from auvbench.analysis.effort import knowledge
    from auvbench.analysis.grouping import agents, failed_training, sections
    from auvbench.analysis.load import load, require
    from auvbench.reporting.verification import refuse_stale, refuse_unfit
    from auvbench.runs.directory import RunDirectory

    runs, problems = load([path], protocol.name, where)
    refuse_unfit(runs)
    require(runs, problems, protocol.name)
    for problem in problems:
        if problem.kind != "failed":
            raise ReportError(
                f"{problem.where}: {problem.message}; an entry must contain every training of the agent"
            )
    parts = sections(runs, protocol.name)
    if len(parts) > 1:
        raise ReportError(
            f"{path}: has {len(parts)} tasks or vehicles; enter one: --where task=NAME vehicle=NAME"
        )
    agents_found, _ = agents(parts[0].runs, protocol.name, default(runs, protocol.name))
    if len(agents_found) != 1:
        labels = ", ".join(agent.label for agent in agents_found[:3])
        raise ReportError(f"{path}: has {len(agents_found)} agents ({labels}); enter one: --where algo=NAME")
    for run in runs:
        if not failed_training(run):
            refuse_stale(RunDirectory(run.directory), protocol)
    for fact in knowledge(runs[0]):
        if (word := WORDS.get(fact, fact)) not in knows:
            raise ReportError(f"--knows: the configuration gives the agent {word} as well; add {word}")
    return list(runs)


def _write(
    given: argparse.Namespace,
    runs: Sequence[RunRecord],
    knows: Sequence[Knowledge],
    target: Path,
    folder: Path,
) -> None:
    from auvbench.analysis.records import task_of
    from auvbench.evaluation.scenario_sets import name_of
    from auvbench.reporting.entries import Entry, pack
    from auvbench.runs import provenance
    from auvbench.runs.atomic_io import storage
    from auvbench.runs.directory import now

    evaluation = next(run.evaluations[given.protocol] for run in runs if given.protocol in run.evaluations)
    inference = evaluation.summary["inference"] or {}
    entry = Entry(
        name=given.name.strip(),
        who=given.who.strip(),
        submitted=now(),
        task=task_of(runs[0]),
        vehicle=str(runs[0].config.get("vehicle.name")),
        protocol=given.protocol,
        scenarios=name_of(evaluation.fingerprint) or evaluation.fingerprint,
        knows=tuple(knows),
        trials=given.trials,
        tuned_on=given.tuned_on,
        cpu=str(inference.get("cpu") or provenance.host()["cpu"]),
        auvbench=provenance.versions()["auvbench"],
        files={},
    )
    folder.mkdir()
    with storage(f"cannot write {target}"):
        pack(entry, runs, folder, target)
