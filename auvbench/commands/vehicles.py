"""`auvbench vehicles`: the sheets there are, or what one sheet's numbers imply."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from auvbench.commands.grammar import Parser
from auvbench.errors import UserError


def parser() -> Parser:
    parser = Parser(
        prog="auvbench vehicles",
        description="Lists vehicle sheets, or shows what one vehicle's numbers imply: mass matrix, allocation,"
        " trim, terminal speeds, stability, and what looks odd.",
        epilog="examples: auvbench vehicles | auvbench vehicles bluerov2 | auvbench vehicles my/sheet.yaml --json"
        " | auvbench vehicles bluerov2 --sheet > conf/vehicle/mine.yaml",
    )
    parser.add_argument(
        "vehicle", nargs="?", help="name of a sheet, or the path of a .yaml file; without it, a list"
    )
    parser.add_argument("--sheet", action="store_true", help="print the sheet itself, to start your own from")
    parser.add_argument(
        "--json", action="store_true", help="print JSON, SI units, body axes forward, port, up"
    )
    return parser


def main(arguments: Sequence[str]) -> int:
    options = parser().read(arguments)
    if options.sheet and (options.vehicle is None or options.json):
        raise UserError(
            "--sheet needs the name of one vehicle, and goes without --json: auvbench vehicles bluerov2 --sheet"
        )
    if options.sheet:
        _print_sheet(options.vehicle)
    elif options.vehicle is None:
        _list(as_json=options.json)
    else:
        _show(options.vehicle, as_json=options.json)
    return 0


def _print_sheet(name: str) -> None:
    from auvbench.vehicles import sheet
    from auvbench.vehicles.reader import sheets

    sheet.load(name)  # an unknown name and a wrong sheet get their message
    path = Path(name)
    text = (path if path.suffix in (".yaml", ".yml") else sheets()[name]).read_text(encoding="utf-8")
    sys.stdout.write(text)


def _list(*, as_json: bool) -> None:
    from auvbench.commands.vehicle_view import new_table, open_console
    from auvbench.errors import VehicleError
    from auvbench.vehicles import sheet
    from auvbench.vehicles.reader import sheet_names

    rows: list[dict[str, Any]] = []
    for name in sheet_names():
        try:
            vehicle = sheet.load(name)
        except VehicleError as error:  # one broken sheet does not hide the others
            rows.append({"name": name, "title": f"broken: {error}", "actuators": None, "mass_kg": None})
            continue
        rows.append(
            {
                "name": name,
                "title": vehicle.title,
                "actuators": len(vehicle.actuators),
                "mass_kg": vehicle.mass,
            }
        )
    if as_json:
        print(json.dumps(rows, indent=2))
        return
    table = new_table("name", "actuators", "mass, kg", "")
    table.columns[-1].justify = "left"
    for row in rows:
        counts = ("", "") if row["mass_kg"] is None else (str(row["actuators"]), f"{row['mass_kg']:.2f}")
        table.add_row(row["name"], *counts, row["title"])
    console = open_console()
    console.print(table)
    console.print("auvbench vehicles NAME shows one; auvbench train vehicle=NAME trains on it.")


def _show(name: str, *, as_json: bool) -> None:
    from auvbench.commands.vehicle_view import facts, show
    from auvbench.vehicles import sheet

    vehicle = sheet.load(name)
    if as_json:
        print(json.dumps(_finite(facts(vehicle)), indent=2, allow_nan=False))
        return
    show(vehicle)


def _finite(value: Any) -> Any:
    """JSON has no infinity: what never ends (a speed without damping) is null."""
    if isinstance(value, dict):
        return {key: _finite(child) for key, child in value.items()}
    if isinstance(value, list):
        return [_finite(child) for child in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
