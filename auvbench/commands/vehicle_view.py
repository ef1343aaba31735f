"""Print the numbers of a vehicle's sheet, and the quantities that follow from them, on the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from auvbench.untrusted.text import plain
from auvbench.vehicles import inspect
from auvbench.vehicles.reader import Quantity
from auvbench.vehicles.vehicle_model import VehicleModel
from auvbench.vehicles.warnings import warnings

FloatArray = NDArray[np.float64]

YAW = 5
"""index of the yaw axis"""


def open_console() -> Console:
    """Return a console for the terminal; for a file or a pipe, a console of 140 columns."""
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = 140  # Without a terminal, rich would fold tables at 80 columns.
    return console


def new_table(*columns: str, title: str = "") -> Table:
    table = Table(box=box.SIMPLE_HEAD, title=title or None, title_justify="left", title_style="bold")
    for index, column in enumerate(columns):
        table.add_column(column, justify="left" if index == 0 else "right")
    return table


def show(vehicle: VehicleModel, quantities: Sequence[Quantity] = ()) -> None:
    """Print the quantities that follow from a vehicle's sheet as tables, then the numbers of the sheet and their sources."""
    console = open_console()
    console.print(f"\n[bold]{_text(vehicle.title)}[/bold]  ({_text(vehicle.name)})")
    console.print("Body axes: x forward, y port, z up, from the body origin. SI units.\n")
    _hydrostatics(console, vehicle)
    console.print(_matrix("mass matrix M = M_RB + M_A, kg, kg m, kg m2", vehicle.M, inspect.SYMBOLS))
    if vehicle.units:
        thrusters = [k for k, _ in vehicle.thrusters]
        names = [vehicle.actuators[k] for k in thrusters]
        title = f"allocation: wrench per newton, rank {inspect.rank(vehicle)} of 6"
        # One row per thruster: even for eight thrusters, the table then has six columns of numbers and fits into 80 characters.
        console.print(_matrix(title, vehicle.allocation.T[thrusters], names, inspect.COMPONENTS))
        if thrusters:
            console.print("[bold]thrusters: what +1 N does[/bold]  (yaw in N m)")
            for k in thrusters:
                console.print(f"  {_text(push(vehicle, k))}", soft_wrap=True)
            console.print()
        _actuators(console, vehicle)
    _motion(console, vehicle)
    console.print("[bold]warnings[/bold]")
    for text in warnings(vehicle) or ["none"]:
        console.print(f"  - {_text(text)}", soft_wrap=True)
    console.print()
    _numbers(console, quantities)
    console.print("[bold]sources[/bold]")
    for key, text in vehicle.sources:
        console.print(f"  {_text(key)}: {_text(text)}", soft_wrap=True)


def push(vehicle: VehicleModel, index: int) -> str:
    """Return the direction in which a positive command of a thruster pushes the vehicle, and the wrench of 1 N of thrust.

    For example "thruster1 pushes ahead, to port: surge +0.707, sway +0.707, yaw +0.167 (turns to port)".
    """
    effect = vehicle.allocation[:, index]

    def word(axis: int) -> str:
        return inspect.DIRECTIONS[axis][0 if effect[axis] > 0.0 else 1]

    acts = [axis for axis in (*range(3), YAW) if abs(effect[axis]) > 1e-6]
    towards = ", ".join(word(axis) for axis in acts if axis != YAW)
    parts = [f"{inspect.AXES[axis]} {effect[axis]:+.3g}" for axis in acts]
    turns = f" (turns {word(YAW)})" if YAW in acts else ""
    return f"{vehicle.actuators[index]} pushes {towards}: {', '.join(parts)}{turns}"


def _text(text: str) -> str:
    """Return a sheet's text for the console, with markup and control characters escaped."""
    return escape(plain(text))


_COMPONENTS = {(3,): ("x", "y", "z"), (6,): inspect.AXES}
"""Names of a list's components, by the list's shape. The table uses the names only if each component has its own range."""


def _numbers(console: Console, quantities: Sequence[Quantity]) -> None:
    """Print each number of the sheet with its range and its sources."""
    if not quantities:
        return
    table = new_table("number", "value", "range", "unit", "sources", title="numbers of the sheet")
    for column in table.columns[3:]:
        column.justify = "left"
    for quantity in quantities:
        name, sources = _text(".".join(quantity.path)), _text(", ".join(quantity.sources))
        names = _COMPONENTS.get(np.shape(quantity.value)) if isinstance(quantity.value, list) else None
        if names and quantity.range is not None:
            for index, (part, value, low, high) in enumerate(
                zip(names, quantity.value, *quantity.range, strict=True)
            ):
                first = index == 0
                table.add_row(
                    f"{name} {part}" if first else f"  {part}",
                    f"{value:g}",
                    f"{low:g} to {high:g}" if low < high else "",
                    _text(quantity.unit) if first else "",
                    sources if first else "",
                )
        else:
            span = "{:g} to {:g}".format(*quantity.range) if np.shape(quantity.range) == (2,) else ""
            table.add_row(name, _shortened(quantity.value), span, _text(quantity.unit), sources)
    console.print(table)
    for quantity in quantities:
        if quantity.note:
            console.print(f"  {_text('.'.join(quantity.path))}: {_text(quantity.note)}", soft_wrap=True)
    console.print()


def _shortened(value: object) -> str:
    """Return a number, a text or a list as text; for a matrix or a mapping, return only its size."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (int, float)):
        return f"{value:g}"
    if isinstance(value, Mapping):
        return f"{len(value)} entries"
    if not isinstance(value, list):
        return _text(str(value))
    if value and isinstance(value[0], list):
        return f"{len(value)} x {len(value[0])} matrix"
    return ", ".join(f"{part:g}" for part in value)


def _hull(vehicle: VehicleModel) -> str:
    """Return the description of the spheres that represent the vehicle's shape in collisions with solids."""
    radius, length = vehicle.hull
    whence = (
        "" if vehicle.own_hull else ", estimated from its inertia and actuators, since the sheet has no hull"
    )
    shape = (
        f"spheres of {radius:.3g} m radius over {length:.3g} m along x"
        if length
        else f"a sphere of {radius:.3g} m radius"
    )
    return f"{shape}{whence}"


def _hydrostatics(console: Console, vehicle: VehicleModel) -> None:

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
    fastest = inspect.shortest_time_constant(vehicle)
    motion = f", {'rises' if net > 0 else 'sinks'} at {abs(free):.3f} m/s" if abs(net) > 1e-9 else ""
    rows = [
        ("mass", f"{vehicle.mass:.6g} kg"),
        ("weight, buoyancy", f"{vehicle.weight:.6g} N, {vehicle.buoyancy:.6g} N"),
        ("net buoyancy", f"{net + 0.0:+.4g} N{motion}"),
        ("centre of gravity", f"{_vector(vehicle.center_of_gravity)} m"),
        ("centre of buoyancy", f"{_vector(vehicle.center_of_buoyancy)} m"),
        ("hull in worlds", _hull(vehicle)),
        ("static trim", attitude),
        (
            "shortest time constant",
            f"{fastest:.3g} s, of damping at full thrust; physics steps are at most this long",
        ),
    ]
    width = max(len(name) for name, _ in rows)
    for name, text in rows:
        console.print(f"  {name:<{width}}  {text}")
    console.print()


def _vector(values: FloatArray) -> str:
    return "(" + ", ".join(f"{value + 0.0:.6g}" for value in values) + ")"


def _matrix(
    title: str, values: FloatArray, rows: Sequence[str], columns: Sequence[str] | None = None
) -> Table:
    table = new_table("", *(rows if columns is None else columns), title=title)
    for name, row in zip(rows, values, strict=True):
        table.add_row(_text(name), *(f"{value:.5g}" if abs(value) > 1e-12 else "0" for value in row))
    return table


def _actuators(console: Console, vehicle: VehicleModel) -> None:
    table = new_table(
        "actuator", "kind", "at -1", "at +1", "force, N", title="actuators: what commands -1 and +1 mean"
    )
    table.columns[1].justify = "left"
    for unit, force in zip(vehicle.units, vehicle.force_limits, strict=True):
        low, high = (f"{limit:.5g} {unit.unit}".removesuffix(" 1") for limit in unit.curve.limits)
        newtons = f"{force[0]:+.4g} {force[1]:+.4g}" if unit.name not in vehicle.others else ""
        table.add_row(_text(unit.name), unit.kind.replace("_", " "), low, high, newtons)
    console.print(table)


def _motion(console: Console, vehicle: VehicleModel) -> None:
    rows = inspect.reach(vehicle)
    if not rows:
        return
    taus = inspect.linear_time_constants(vehicle)
    table = new_table("axis", "direction", "force", "speed", "to 63 %", "M/D", title="terminal speeds")
    table.columns[1].justify = "left"
    for axis in sorted({row.axis for row in rows}):
        force_unit, speed_unit = ("N", "m/s") if axis < 3 else ("N m", "rad/s")
        tau = taus[inspect.AXES[axis]]
        for row in _directions(rows, axis):
            table.add_row(
                inspect.AXES[axis],
                row.direction if len(_directions(rows, axis)) > 1 else "both ways",
                f"{row.force:.4g} {force_unit}",
                f"{row.speed:.3f} {speed_unit}",
                f"{row.rise_time:.3g} s",
                "-" if tau is None else f"{tau:.3g} s",
            )
    console.print(table)
    console.print("  Level, at full thrust; time to 63 % of the speed; time constant M/D near rest.")
    for note in _notes(vehicle, rows):
        console.print(f"  {note}", soft_wrap=True)
    console.print()


def _directions(rows: list[inspect.Reach], axis: int) -> list[inspect.Reach]:
    """Return the rows of an axis: one row if the forces of both directions are equal, else one row for each direction."""
    own = [row for row in rows if row.axis == axis]
    return own[:1] if len(own) == 2 and abs(own[0].force - own[1].force) < 1e-3 * own[0].force else own


def _notes(vehicle: VehicleModel, rows: list[inspect.Reach]) -> list[str]:
    """Return notes on what the table of terminal speeds does not show."""
    notes = [
        f"{inspect.AXES[row.axis]}: {row.bollard_force:.4g} N and {row.bollard_speed:.3f} m/s {row.direction} if the thrusters"
        " need not balance the moments"
        for axis in range(3)
        for row in _directions(rows, axis)
        if row.bollard_force > row.force * 1.001
    ]
    lifted = [
        f"{row.speed_with_buoyancy:.3f} m/s {row.direction}"
        for row in rows
        if abs(row.speed_with_buoyancy - row.speed) > 5e-4
    ]
    if lifted:
        notes.append(f"heave with the net buoyancy: {', '.join(lifted)}")
    for axis in (3, 4):
        for row in _directions(rows, axis):
            heel = inspect.heel(vehicle, row.force)
            effect = (
                "turns the vehicle over"
                if heel is None
                else f"holds {np.degrees(heel):.0f} deg against the righting moment"
            )
            notes.append(f"{inspect.AXES[axis]}: full thrust {effect}")
    return notes
