"""`auvbench validate`: replay logs with one or several vehicle sheets, and compare their predictions with the measurements."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from auvbench.commands.identify import FRAMES, choice, logs_and_keys, motors
from auvbench.grammar import Parser
from auvbench.identification.columns import READABLE

KEYS = ("vehicle", "frame", "motors", "output")
OUTPUT = "outputs/validate"


def parser() -> Parser:
    parser = Parser(
        prog="auvbench validate",
        description="Replays the inputs of logs in windows of 0.1 to 5 s with each sheet, and compares the predictions with the"
        " measurements. Also shows the errors of two baselines: first state held, and constant velocity (docs/identification.md).",
        epilog="example: auvbench validate log.csv vehicle=bluerov2_2026,bluerov2,bluerov2_wu2018",
        keys=KEYS,
    )
    parser.add_argument(
        "words",
        nargs="*",
        metavar="LOG|KEY=VALUE",
        help=f"logs ({READABLE}, or auvbench's own records); vehicle=A,B,C: names or files of sheets; frame=ned for tables with z"
        f" down; motors=A,-B,...: thrusters in the order of the autopilot's motors; output=DIR (default: {OUTPUT})",
    )
    return parser


def main(arguments: Sequence[str]) -> int:
    paths, given = logs_and_keys(
        "validate", parser(), arguments, KEYS, "vehicle=A,B", "are the sheets to compare"
    )
    frame = choice(given, "frame", FRAMES)
    folder = Path(given.get("output", OUTPUT))
    from auvbench.identification import inputs, readers, validation
    from auvbench.reporting import identification as page
    from auvbench.runs.atomic_io import check_writable
    from auvbench.vehicles import identified, reader, sheet

    check_writable(folder / "index.html", f"output={folder}")
    logs = readers.read(paths, frame, motors(given))
    entries = []
    for name in dict.fromkeys(part for part in given["vehicle"].split(",") if part):
        vehicle = sheet.load(name)
        inputs.check(logs, vehicle)
        entries.append(
            (
                vehicle.name if name.endswith((".yaml", ".yml")) else name,
                vehicle,
                identified.of(reader.read(name)),
            )
        )
    result = validation.validate(logs, entries)
    for remark in result.remarks:
        print(f"note: {remark}", file=sys.stderr)
    folder.mkdir(parents=True, exist_ok=True)
    index = page.write_validation(folder, result, command=shlex.join(["auvbench", "validate", *arguments]))
    print(page.validation_text(result))
    print(os.path.relpath(index))
    return 0
