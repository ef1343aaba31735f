"""`auvbench vehicles`: the sheets there are, or what one sheet's numbers imply."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from auvbench.errors import UserError

if TYPE_CHECKING:
    import numpy as np
    from rich.console import Console
    from rich.table import Table

    from auvbench.vehicles.model import VehicleModel


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(
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
    options = parser.parse_args(arguments)
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


def _console() -> Console:
    from rich.console import Console

    console = Console(highlight=False, soft_wrap=False)
    if not console.is_terminal:
        # A file or a pipe has no width; tables must not be folded at 80 characters.
        console = Console(highlight=False, width=140)
    return console


def _table(*columns: str, title: str = "") -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, title=title or None, title_justify="left", title_style="bold")
    for index, column in enumerate(columns):
        table.add_column(column, justify="left" if index == 0 else "right")
    return table


def _print_sheet(name: str) -> None:
    from auvbench.vehicles import sheet
    from auvbench.vehicles.reader import sheets

    sheet.load(name)  # an unknown name and a wrong sheet get their message
    path = Path(name)
    text = (path if path.suffix in (".yaml", ".yml") else sheets()[name]).read_text(encoding="utf-8")
    sys.stdout.write(text)


def _list(*, as_json: bool) -> None:
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
    table = _table("name", "actuators", "mass, kg", "")
    table.columns[-1].justify = "left"
    for row in rows:
        counts = ("", "") if row["mass_kg"] is None else (str(row["actuators"]), f"{row['mass_kg']:.2f}")
        table.add_row(row["name"], *counts, row["title"])
    console = _console()
    console.print(table)
    console.print("auvbench vehicles NAME shows one; auvbench train vehicle=NAME trains on it.")


def _show(name: str, *, as_json: bool) -> None:
    from auvbench.vehicles import sheet

    vehicle = sheet.load(name)
    if as_json:
        print(json.dumps(_finite(facts(vehicle)), indent=2, allow_nan=False))
        return
    _print(vehicle)


def _finite(value: Any) -> Any:
    """JSON has no infinity: what never ends (a speed without damping) is null."""
    if isinstance(value, dict):
        return {key: _finite(child) for key, child in value.items()}
    if isinstance(value, list):
        return [_finite(child) for child in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def facts(vehicle: VehicleModel) -> dict[str, Any]:
    """Everything that the tables show, as plain numbers and lists (SI, body axes forward, port, up)."""
    from auvbench.vehicles import inspect

    trim = inspect.static_trim(vehicle)
    return {
        "name": vehicle.name,
        "title": vehicle.title,
        "mass_kg": vehicle.mass,
        "weight_N": vehicle.weight,
        "buoyancy_N": vehicle.buoyancy,
        "net_buoyancy_N": inspect.net_buoyancy(vehicle),
        "free_rise_mps": inspect.free_speed(vehicle),
        "center_of_gravity_m": vehicle.center_of_gravity.tolist(),
        "center_of_buoyancy_m": vehicle.center_of_buoyancy.tolist(),
        "trim": {
            "roll_rad": trim.roll,
            "pitch_rad": trim.pitch,
            "restoring_Nm_per_rad": trim.moment,
            "determined": trim.determined,
        },
        "mass_matrix": vehicle.M.tolist(),
        "added_mass": vehicle.M_A.tolist(),
        "linear_damping": vehicle.linear_damping.tolist(),
        "quadratic_damping": vehicle.quadratic_damping.tolist(),
        "actuators": [
            {
                "name": unit.name,
                "kind": unit.kind,
                "command_limits": list(unit.curve.limits),
                "force_limits_N": limits.tolist(),
            }
            for unit, limits in zip(vehicle.units, vehicle.force_limits, strict=True)
        ],
        "allocation": vehicle.allocation.tolist(),
        "rank": inspect.rank(vehicle),
        "independent_axes": [inspect.AXES[axis] for axis in inspect.independent_axes(vehicle)],
        "reach": [
            {
                "axis": inspect.AXES[row.axis],
                "direction": row.direction,
                "force": row.force,
                "terminal_speed": row.speed,
                "terminal_speed_with_buoyancy": row.speed_with_buoyancy,
                "rise_time_s": row.rise_time,
                "bollard_force": row.bollard_force,
                "bollard_speed": row.bollard_speed,
            }
            for row in inspect.reach(vehicle)
        ],
        "linear_time_constants_s": inspect.linear_time_constants(vehicle),
        "instabilities": [
            {"plane": case.plane, "above_mps": case.above, "growth_per_s": case.growth, "at_mps": case.speed}
            for case in inspect.instabilities(vehicle)
        ],
        "warnings": inspect.warnings(vehicle),
        "sources": dict(vehicle.sources),
    }


def _print(vehicle: VehicleModel) -> None:
    from rich.markup import escape

    from auvbench.vehicles import inspect

    console = _console()
    console.print(f"\n[bold]{escape(vehicle.title)}[/bold]  ({escape(vehicle.name)})")
    console.print("Body axes: x forward, y port, z up, from the body origin. SI units.\n")
    _hydrostatics(console, vehicle)
    console.print(_matrix("mass matrix M = M_RB + M_A, kg, kg m, kg m2", vehicle.M, inspect.SYMBOLS))
    if vehicle.units:
        names = [unit.name for unit in vehicle.units]
        title = f"allocation: wrench per newton, rank {inspect.rank(vehicle)} of 6"
        console.print(_matrix(title, vehicle.allocation, inspect.COMPONENTS, names))
        _actuators(console, vehicle)
    _motion(console, vehicle)
    console.print("[bold]warnings[/bold]")
    for text in inspect.warnings(vehicle) or ["none"]:
        console.print(f"  - {escape(text)}", soft_wrap=True)
    console.print("\n[bold]sources[/bold]")
    for key, text in vehicle.sources:
        console.print(f"  {escape(key)}: {escape(text)}", soft_wrap=True)


def _hydrostatics(console: Console, vehicle: VehicleModel) -> None:
    import numpy as np

    from auvbench.vehicles import inspect

    trim, net, free = (
        inspect.static_trim(vehicle),
        inspect.net_buoyancy(vehicle),
        inspect.free_speed(vehicle),
    )
    attitude = (
        f"roll {np.degrees(trim.roll):.2f} deg, pitch {np.degrees(trim.pitch):.2f} deg,"
        f" righting moment {trim.moment:.4g} N m/rad"
        if trim.determined
        else "any attitude (no righting moment)"
    )
    motion = f", {'rises' if net > 0 else 'sinks'} at {abs(free):.3f} m/s" if abs(net) > 1e-9 else ""
    rows = [
        ("mass", f"{vehicle.mass:.6g} kg"),
        ("weight, buoyancy", f"{vehicle.weight:.6g} N, {vehicle.buoyancy:.6g} N"),
        ("net buoyancy", f"{net + 0.0:+.4g} N{motion}"),
        ("centre of gravity", f"{_vector(vehicle.center_of_gravity)} m"),
        ("centre of buoyancy", f"{_vector(vehicle.center_of_buoyancy)} m"),
        ("static trim", attitude),
    ]
    width = max(len(name) for name, _ in rows)
    for name, text in rows:
        console.print(f"  {name:<{width}}  {text}")
    console.print()


def _vector(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{value + 0.0:.6g}" for value in values) + ")"


def _matrix(
    title: str, values: np.ndarray, rows: Sequence[str], columns: Sequence[str] | None = None
) -> Table:
    table = _table("", *(rows if columns is None else columns), title=title)
    for name, row in zip(rows, values, strict=True):
        table.add_row(name, *(f"{value:.5g}" if abs(value) > 1e-12 else "0" for value in row))
    return table


def _actuators(console: Console, vehicle: VehicleModel) -> None:
    table = _table("actuator", "kind", "at command -1", "at command +1", "force, N", title="actuators")
    table.columns[1].justify = "left"
    units = {"fin": "rad", "mass_shifter": "m", "buoyancy_engine": "m3", "drop_weight": ""}
    for unit, force in zip(vehicle.units, vehicle.force_limits, strict=True):
        rotor = "rad/s" if unit.rotor_constant else "N"
        symbol = units.get(unit.kind, rotor)
        low, high = (f"{limit:.5g} {symbol}".strip() for limit in unit.curve.limits)
        newtons = f"{force[0]:+.4g} to {force[1]:+.4g}" if unit.kind == "thruster" else ""
        table.add_row(unit.name, unit.kind.replace("_", " "), low, high, newtons)
    console.print(table)


def _motion(console: Console, vehicle: VehicleModel) -> None:
    import numpy as np

    from auvbench.vehicles import inspect

    rows = inspect.reach(vehicle)
    taus = inspect.linear_time_constants(vehicle)
    table = _table(
        "axis",
        "direction",
        "force",
        "terminal speed",
        "time to 63 %",
        "M/D at rest",
        "",
        title="steady motion, level, at full thrust",
    )
    table.columns[1].justify = table.columns[-1].justify = "left"
    for row in rows:
        force, speed = ("N", "m/s") if row.axis < 3 else ("N m", "rad/s")
        notes = []
        if abs(row.speed_with_buoyancy - row.speed) > 5e-4:
            notes.append(f"{row.speed_with_buoyancy:.3f} {speed} with net buoyancy")
        if row.bollard_force > row.force * 1.001:
            notes.append(
                f"{row.bollard_force:.4g} N and {row.bollard_speed:.3f} {speed} with moments unbalanced"
            )
        if row.axis in (3, 4):
            heel = inspect.heel(vehicle, row.force)
            notes.append(
                "turns it over"
                if heel is None
                else f"holds {np.degrees(heel):.0f} deg against the righting moment"
            )
        tau = taus[inspect.AXES[row.axis]]
        table.add_row(
            inspect.AXES[row.axis],
            row.direction,
            f"{row.force:.4g} {force}",
            f"{row.speed:.3f} {speed}",
            f"{row.rise_time:.3g} s",
            "no linear damping" if tau is None else f"{tau:.3g} s",
            "; ".join(notes),
        )
    if rows:
        console.print(table)
