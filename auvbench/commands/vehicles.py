"""`auvbench vehicles`: list the vehicle sheets, or show what one sheet's numbers imply."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from auvbench import integrations, registry
from auvbench.errors import UserError
from auvbench.grammar import Parser


def parser() -> Parser:
    parser = Parser(
        prog="auvbench vehicles",
        description="Lists vehicle sheets, or shows what one vehicle's numbers imply: mass matrix, allocation,"
        " trim, terminal speeds, stability, and warnings about implausible numbers.",
        epilog="examples: auvbench vehicles | auvbench vehicles bluerov2 | auvbench vehicles my/sheet.yaml"
        " | auvbench vehicles bluerov2 --sheet > conf/vehicle/mine.yaml",
    )
    parser.add_argument(
        "vehicle", nargs="?", help="name of a sheet, or the path of a .yaml file; default: list all sheets"
    )
    outputs = parser.add_mutually_exclusive_group()
    outputs.add_argument("--sheet", action="store_true", help="print the sheet, as a template for your own")
    for export in _exports():
        export.add_options(parser, outputs)
        parser.epilog = f"{parser.epilog} | {export.EXAMPLE}"
    return parser


def _exports() -> list[Any]:
    return [registry.resolve(module) for module in integrations.EXPORTS]


def main(arguments: Sequence[str]) -> int:
    options = parser().read(arguments)
    name = options.vehicle
    if any(export.write(options) for export in _exports()):
        return 0
    if name is None and options.sheet:
        raise UserError("--sheet needs the name of a vehicle: auvbench vehicles bluerov2 --sheet")
    if options.sheet:
        _print_sheet(name)
    elif name is None:
        _list()
    else:
        from auvbench.commands.vehicle_view import show
        from auvbench.vehicles import reader, sheet

        vehicle = sheet.load(name)  # raises the error for a wrong sheet before anything is printed
        show(vehicle, reader.quantities(reader.read(name).data))
    return 0


def _print_sheet(name: str) -> None:
    from auvbench.vehicles import sheet
    from auvbench.vehicles.reader import sheets

    sheet.load(name)  # Raises the error for an unknown name or a wrong sheet.
    path = Path(name)
    file = path if path.suffix in (".yaml", ".yml") else sheets()[name]
    print(file.read_text(encoding="utf-8"), end="")


def _list() -> None:
    from rich.text import Text

    from auvbench.commands.vehicle_view import new_table, open_console
    from auvbench.errors import VehicleError
    from auvbench.untrusted.text import plain
    from auvbench.vehicles import sheet
    from auvbench.vehicles.reader import sheet_names

    table = new_table("name", "actuators", "mass, kg", "")
    table.columns[-1].justify = "left"
    for name in sheet_names():
        try:
            vehicle = sheet.load(name)
        except VehicleError as error:  # One broken sheet must not hide the others.
            cells = ("", "", f"broken: {error}")
        else:
            cells = (str(len(vehicle.actuators)), f"{vehicle.mass:.2f}", vehicle.title)
        table.add_row(Text(plain(name)), *cells[:2], Text(plain(cells[2])))
    console = open_console()
    console.print(table)
    console.print("auvbench vehicles NAME shows one; auvbench train vehicle=NAME trains on it.")
