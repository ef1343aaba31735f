"""`auvbench verify`: test an entry again with only its archive, and compare the rows."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.errors import UserError
from auvbench.grammar import Parser

if TYPE_CHECKING:
    from auvbench.reporting.entries import Entry, Verified

BEGIN, END = "<!-- begin: entries -->", "<!-- end: entries -->"


def parser() -> Parser:
    parser = Parser(
        prog="auvbench verify",
        description="Unpacks an entry, tests its models again on the same scenarios, and compares the "
        "rows: they must have the same\n"
        "bits on the same processor, and the same verdict against PID on another processor. Trainings are not repeated.",
        epilog="Exit code 0 when the entry is verified, 1 when its rows differ.\n\n"
        "examples:\n  auvbench verify my-agent.zip\n  auvbench verify my-agent.zip --to results/entries",
        workers="runs, or episodes of a slow controller,",
    )
    add = parser.add_argument
    add(
        "entry", type=Path, metavar="ENTRY", help="archive of auvbench submit, or a folder in results/entries"
    )
    add(
        "--to",
        type=Path,
        metavar="DIR",
        help="store the entry and the result in a folder of entries: results/entries",
    )
    return parser


def main(arguments: Sequence[str]) -> int:
    """Verify an entry; return 1 if its rows differ, else 0."""
    options = parser().read(arguments)
    if options.to is not None and options.to.exists() and not options.to.is_dir():
        raise UserError(f"--to {options.to}: is a file; name a folder")
    from auvbench.commands.submit import slug
    from auvbench.config import folders
    from auvbench.config.compose import compose
    from auvbench.config.validate import evaluate_config
    from auvbench.evaluation.parallel import PRELOAD
    from auvbench.reporting.entries import unpack
    from auvbench.reporting.verification import compare
    from auvbench.runs.pool import Pool

    with tempfile.TemporaryDirectory() as place:
        folder, work = Path(place, "entry"), Path(place, "outputs")
        folder.mkdir()
        entry = unpack(options.entry, folder)
        if entry.protocol not in folders.options("protocol"):
            raise UserError(
                f"{options.entry}: protocol {entry.protocol}: unknown to this version of auvbench"
            )
        protocol = evaluate_config(compose("evaluate", [f"protocol={entry.protocol}"])).protocol
        print(f"{entry.name} by {entry.who}: {entry.task}, {entry.vehicle}, {entry.scenarios}", flush=True)
        with Pool(options.workers, PRELOAD) as pool:
            outcome = compare(entry, folder, work, protocol, pool)
        for line in outcome.lines:
            print(f"  {line}")
        if options.to is not None:
            _keep(entry, outcome.verified, folder, options.to, slug(entry.name))
    verified = outcome.verified
    if not verified.ok:
        print(f"not verified: the rows of {entry.name} differ")
        return 1
    print(f"verified: {'the same bits' if verified.same_bits else 'the same verdict on another processor'}")
    return 0


def _keep(entry: Entry, verified: Verified, folder: Path, entries: Path, name: str) -> None:
    """Copy an unpacked entry and its result into a folder of entries, and update the folder's table."""
    from auvbench.reporting.entries import overview, write_verified
    from auvbench.runs.atomic_io import storage, write_atomic
    from auvbench.untrusted import path_safety

    path_safety.check_output(entries, (name, "README.md"))
    with storage(f"cannot write {entries}"):
        target = entries / name
        if target.exists():
            _refuse_other(target, entry)
            shutil.rmtree(target)
        shutil.copytree(folder, target)
        write_verified(target, verified)
        readme = entries / "README.md"
        text = readme.read_text(encoding="utf-8") if readme.is_file() else f"# Entries\n\n{BEGIN}\n{END}\n"
        before, begin, remainder = text.partition(BEGIN)
        _, end, after = remainder.partition(END)
        if not begin or not end:
            raise UserError(f"{readme}: add the lines {BEGIN} and {END} where the table belongs")
        write_atomic(readme, f"{before}{BEGIN}\n{overview(entries)}{END}{after}".encode())
    print(f"  kept in {os.path.relpath(target)}")


def _refuse_other(target: Path, entry: Entry) -> None:
    """Raise UserError if a folder contains another person's entry, or something that is not an entry."""
    from auvbench.reporting.entries import FILE, read
    from auvbench.untrusted import reading

    data = reading.content(target / FILE) if (target / FILE).is_file() else b""
    if not data or read(data, target).who != entry.who:
        raise UserError(f"{target}: already exists and is not an entry of {entry.who}; rename the entry")
