"""Write a vehicle for Gazebo Harmonic: the options `--sdf`, `--hydrodynamics` and `--step` of `auvbench vehicles`."""

from __future__ import annotations

import argparse
from pathlib import Path

from auvbench.errors import UserError
from auvbench.grammar import Parser, number

EXAMPLE = "auvbench vehicles bluerov2 --sdf gazebo"


def add_options(parser: Parser, outputs: argparse._MutuallyExclusiveGroup) -> None:
    """Add the options to the command's parser; `outputs` is its group of mutually exclusive outputs."""
    outputs.add_argument(
        "--sdf",
        metavar="DIR",
        help="write the vehicle for Gazebo Harmonic: model, world, and bridge and launch files for ROS 2",
    )
    parser.add_argument(
        "--hydrodynamics",
        choices=("corrected", "published"),
        help=(
            "with --sdf: corrected (the default) leaves added mass to DART, published leaves it to the "
            "Hydrodynamics plugin"
        ),
    )
    parser.add_argument(
        "--step", type=number(1e-6, 1.0), help="with --sdf: physics step of the world in s, 0.001 by default"
    )


def write(options: argparse.Namespace) -> bool:
    """Write the files and print their paths if `--sdf` is given; return whether `--sdf` is given.

    Raises:
        UserError: `--hydrodynamics` or `--step` is given without `--sdf`, `--sdf` is given without a vehicle, or the folder
            cannot be written.
        VehicleError: Gazebo cannot simulate the vehicle.
    """
    if options.sdf is None:
        if options.hydrodynamics or options.step:
            raise UserError(f"--hydrodynamics and --step go with --sdf DIR: {EXAMPLE}")
        return False
    if options.vehicle is None:
        raise UserError(f"--sdf needs the name of a vehicle: {EXAMPLE}")

    from auvbench.integrations.gazebo import sdf
    from auvbench.vehicles import sheet

    vehicle = sheet.load(options.vehicle)
    contents = sdf.files(vehicle, options.hydrodynamics or "corrected", options.step or 0.001)
    try:
        paths = sdf.write(Path(options.sdf), contents)
    except OSError as error:
        raise UserError(f"--sdf {options.sdf}: cannot be written: {error.strerror}") from error
    for path in paths:
        print(path)
    world = next(path for path in paths if path.name.endswith(".world.sdf"))
    print(f"gz sim -r -s {world} runs it without a window (docs/gazebo.md).")
    return True
