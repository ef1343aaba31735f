"""`auvbench identify`: fit the numbers of a vehicle sheet to logs, and write a sheet with their uncertainty and a page."""

from __future__ import annotations

import os
import re
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.errors import ConfigError, UserError, closest
from auvbench.grammar import Parser, number, paths_and_overrides, whole
from auvbench.identification.columns import DESCRIBED, READABLE

if TYPE_CHECKING:
    from auvbench.identification.log import Log

KEYS = ("vehicle", "parameters", "name", "frame", "motors", "window", "replicates", "gate", "output")
OUTPUT = "outputs/identify"
FRAMES = ("enu", "ned")


def parser() -> Parser:
    columns = "\n".join(f"  {', '.join(names)}: {text}" for names, text in DESCRIBED)
    parser = Parser(
        prog="auvbench identify",
        description="Fits numbers of a vehicle sheet to logs of the vehicle, says which numbers the logs do not determine,"
        " and writes a sheet with intervals and a page (docs/identification.md).",
        epilog="examples:\n  auvbench identify log.csv vehicle=bluerov2_2026\n  auvbench identify logs/*.csv"
        f" vehicle=bluerov2_2026 parameters=added_mass,linear_damping.yaw name=mine\n\ncolumns of a log:\n{columns}",
        keys=KEYS,
    )
    parser.add_argument(
        "words",
        nargs="*",
        metavar="LOG|KEY=VALUE",
        help=f"logs ({READABLE}, or auvbench's own records); vehicle=NAME: sheet of the prior; parameters=A,B: numbers to fit"
        " (default: added mass, damping, net buoyancy, centre of buoyancy, lag, delay); name=NAME of the new sheet;"
        f" frame=ned for tables with z down; motors=A,-B,...: thrusters in the order of the motors, if no frame of the autopilot fits;"
        f" window=SECONDS; replicates=N of the bootstrap; gate=off: also fit axes that seem to be controlled in closed loop;"
        f" output=DIR (default: {OUTPUT}/NAME)",
    )
    return parser


def main(arguments: Sequence[str]) -> int:
    paths, given = logs_and_keys(
        "identify", parser(), arguments, KEYS, "vehicle=NAME", "is the sheet from which the fit starts"
    )
    base, name = given["vehicle"], given.get("name", f"{given['vehicle']}_identified")
    if not re.fullmatch(r"[A-Za-z0-9][\w.-]{0,99}", name):
        raise UserError(f"name={name}: must have only letters, digits, '_', '-' and '.'")
    frame = choice(given, "frame", FRAMES)
    gated = choice(given, "gate", ("on", "off")) == "on"
    window = _number(given, "window", number(0.2, 120.0))
    replicates = _number(given, "replicates", whole(20, 10_000))
    folder = Path(given.get("output", f"{OUTPUT}/{name}"))
    command = shlex.join(["auvbench", "identify", *arguments])
    from auvbench.identification import readers

    logs = readers.read(paths, frame, motors(given))
    names = [part for part in given.get("parameters", "").split(",") if part]
    return _identify(logs, base, names, name, folder, command, gated, window, replicates)


def _identify(
    logs: Sequence[Log],
    base: str,
    names: Sequence[str],
    name: str,
    folder: Path,
    command: str,
    gated: bool,
    window: float | None,
    replicates: float | None,
) -> int:
    from auvbench.identification import advise, gate, inputs, parameters, sheets
    from auvbench.identification.fit import fit
    from auvbench.reporting import identification as page
    from auvbench.runs.atomic_io import check_writable, write_atomic
    from auvbench.vehicles import reader, sheet

    check_writable(folder / f"{name}.yaml", f"output={folder}")
    vehicle = sheet.load(base)
    content = reader.read(base).data
    by_wrench = logs[0].kind == "wrench"
    inputs.check(logs, vehicle)
    measured = all(log.voltage is not None for log in logs)
    chosen = parameters.choose(vehicle, names, measured)
    if by_wrench:
        chosen = tuple(
            p for p in chosen if p.name.partition(".")[0] not in ("lag", "thrust", "gain", "voltage")
        )
    for log in logs:
        for remark in log.remarks:
            print(f"note: {remark}", file=sys.stderr)
    verdicts = gate.judge(logs, vehicle)
    kept = gate.reasons(verdicts, [p.name for p in chosen]) if gated else {}
    if text := gate.warning(verdicts):
        print(f"warning: {text}", file=sys.stderr)
    result = fit(
        logs,
        vehicle,
        chosen,
        length=window,
        kept=kept,
        replicates=int(replicates or 200),
        told=lambda text: print(text, file=sys.stderr),
    )
    digests = list(dict.fromkeys((Path(log.name.split(" ")[0]).name, log.digest) for log in logs))
    found = sheets.identified_sheet(content, result, name=name, command=command, digests=digests)
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{name}.yaml"
    write_atomic(file, sheets.dump(found).encode())
    advice = advise.advise(result)
    excitation = page.excitation_table(result, verdicts)
    index = page.write_identification(
        folder, result, verdicts, excitation, advice, name=name, command=command
    )
    print(page.terminal(result, excitation, advice))
    print(
        f"{os.path.relpath(file)}: to use it by name: mkdir -p conf/vehicle && cp {shlex.quote(os.path.relpath(file))} conf/vehicle/"
    )
    print(os.path.relpath(index))
    return 0


def motors(given: dict[str, str]) -> list[str] | None:
    """Return the thrusters that the key `motors` lists; None if the key is not given."""
    return given["motors"].split(",") if "motors" in given else None


def logs_and_keys(
    command: str, parser: Parser, arguments: Sequence[str], valid: Sequence[str], vehicle: str, meaning: str
) -> tuple[list[str], dict[str, str]]:
    """Return the paths of logs, and the values of `key=value` words by key.

    Args:
        command: name of the command, for messages.
        parser: parser of the command.
        arguments: words after the command.
        valid: keys that the command accepts.
        vehicle: form of the key `vehicle` in messages, for example `vehicle=NAME`.
        meaning: purpose of the sheets; the message about a missing vehicle contains this text after `vehicle`.

    Raises:
        UserError: no log, no vehicle, or a wrong word.
    """
    paths, overrides = paths_and_overrides(parser.read(arguments, overrides=True).words)
    given = keys(overrides, valid, command)
    if not paths:
        raise UserError(
            f"{command}: no log given: auvbench {command} LOG... {vehicle} (docs/identification.md lists the columns)"
        )
    if "vehicle" not in given:
        raise UserError(f"{command}: no vehicle given: {vehicle} {meaning} (auvbench vehicles)")
    return paths, given


def keys(overrides: Sequence[str], valid: Sequence[str], command: str) -> dict[str, str]:
    """Return the values of `key=value` words by key.

    Raises:
        UserError: an unknown key, a key without a value, or a key given twice.
    """
    given: dict[str, str] = {}
    for word in overrides:
        key, _, value = word.partition("=")
        if key not in valid:
            raise UserError(f"{word}: {command} has no such key; {closest(key, valid)}")
        if not value:
            raise UserError(f"{word}: has no value; type {key}=VALUE")
        if key in given:
            raise UserError(f"{word}: {key} is given twice; give it once")
        given[key] = value
    return given


def choice(given: dict[str, str], key: str, valid: Sequence[str]) -> str:
    """Return the value of a key, which must be in `valid`; if the key is not given, return the first entry of `valid`.

    Raises:
        ConfigError: the value is not in `valid`.
    """
    value = given.get(key, valid[0])
    if value not in valid:
        raise ConfigError(f"{key}={value}: {closest(value, valid)}")
    return value


def _number(given: dict[str, str], key: str, read: object) -> float | None:
    import argparse

    if key not in given:
        return None
    try:
        value: float = read(given[key])  # type: ignore[operator]
    except argparse.ArgumentTypeError as error:
        raise ConfigError(f"{key}={given[key]}: {error}") from None
    return value
