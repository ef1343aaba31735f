"""Measure, and print a table (`make bench`); `--write` replaces the table in docs/performance.md."""

from __future__ import annotations

import argparse
import sys
from datetime import UTC, datetime
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks.measurements import SECTIONS, Row, machine

PAGE = Path(__file__).resolve().parents[1] / "docs" / "performance.md"
BEGIN, END = "<!-- begin: make bench -->", "<!-- end: make bench -->"


def main() -> int:
    parser = argparse.ArgumentParser(prog="make bench", description=__doc__)
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=f"of {', '.join(SECTIONS)}")
    parser.add_argument("--write", action="store_true", help="renew the table in docs/performance.md")
    arguments = parser.parse_args()
    for name in arguments.sections:
        if name not in SECTIONS:
            parser.error(f"{name}: no such section; valid: {', '.join(SECTIONS)}")
    console = Console(stderr=True)
    rows: list[Row] = []
    for name in arguments.sections or SECTIONS:
        console.print(f"measuring {name} ...")
        rows += SECTIONS[name]()
    table = Table(title=machine(), title_justify="left")
    for column, justify in (("what", "left"), ("figure", "right"), ("unit", "left"), ("remark", "left")):
        table.add_column(column, justify=justify)  # type: ignore[arg-type]
    for row in rows:
        table.add_row(*row)
    Console().print(table)
    if arguments.write:
        _write(rows)
    return 0


def _write(rows: list[Row]) -> None:
    text = PAGE.read_text(encoding="utf-8")
    head, rest = text.split(BEGIN)
    _, tail = rest.split(END)
    lines = [
        f"Measured on {datetime.now(UTC):%Y-%m-%d} on: {machine()}.",
        "",
        "| what | figure | unit | remark |",
        "|---|---:|---|---|",
        *(f"| {' | '.join(row)} |" for row in rows),
    ]
    PAGE.write_text(head + BEGIN + "\n" + "\n".join(lines) + "\n" + END + tail, encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
