"""What is wrong with the text of the sheets that a command line names, said before Hydra reads them.

Hydra answers broken YAML and defaults that loop with a traceback of its own and knows no lines.
"""

from __future__ import annotations

from collections.abc import Sequence


def read_named_sheets(arguments: Sequence[str]) -> None:
    """Read the sheets that `vehicle=NAME` or `vehicle=A,B` name; numbers are checked later, after overrides.

    Raises:
        VehicleError: a sheet cannot be read, with file and line. Unknown names are left to Hydra, which lists all.
    """
    from auvbench.vehicles import reader

    named = [a.removeprefix("vehicle=") for a in arguments if a.startswith("vehicle=")]
    names = {name.strip(" '\"") for choice in named for name in choice.split(",")}
    for name in sorted(names & set(reader.sheet_names())):
        reader.read(name)
