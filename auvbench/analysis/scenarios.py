"""The scenarios of a test, which every run of a study meets alike, so that a study holds them once:

    <study>/scenarios/<first 16 digits of the SHA-256 of the table>.csv.bz2

has a row for each episode of each condition. The summary of a copy whose rows leave these columns out names the whole
digest, under its seal; whoever reads the rows gets the columns back.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from auvbench.record import SCENARIO_COLUMNS
from auvbench.runs.atomic_io import sha256
from auvbench.untrusted import bz2_io, reading, tables
from auvbench.untrusted.text import short

FOLDER = "scenarios"
NAMED = "scenarios_sha256"
"""what a summary calls the digest"""
KEY = ("condition", "episode")


def split(rows: bytes) -> tuple[bytes, bytes | None]:
    r"""Rows of a test without the columns of the scenario, and the table of these; None where the rows have none.

    >>> split(b"condition,episode,steps,start_yaw_rad\nnominal,0,17,0.5\n")
    (b'condition,episode,steps\nnominal,0,17\n', b'condition,episode,start_yaw_rad\nnominal,0,0.5\n')
    """
    found = csv.DictReader(io.StringIO(rows.decode("utf-8")))
    there = list(found.fieldnames or ())
    shared = [name for name in SCENARIO_COLUMNS if name in there]
    if not shared:
        return rows, None
    content = list(found)
    rest = [name for name in there if name not in shared]
    return tables.text(content, rest), tables.text(content, (*KEY, *shared))


def name_of(digest: str) -> str:
    """The file of a table with this SHA-256, below `FOLDER`."""
    return f"{digest[:16]}.csv{bz2_io.SUFFIX}"


def joined(frame: pd.DataFrame, summary: Mapping[str, Any], directory: Path) -> pd.DataFrame:
    """Rows with the columns of their scenarios, in the order of the rows; the rows themselves where nothing was left out.

    Args:
        frame: rows of an evaluation, with the columns `KEY`.
        summary: of the evaluation.
        directory: of the evaluation, in a run of a study.

    Raises:
        ValueError: the table is missing, damaged, or not that of these rows.
    """
    if NAMED not in summary:
        return frame
    content = of_study(summary[NAMED], directory)
    found = tables.csv(content, words=("condition",))
    if not {*KEY} < {*found.columns} <= {*KEY, *SCENARIO_COLUMNS}:
        raise ValueError(f"{FOLDER}/{name_of(sha256(content))} holds no scenarios")
    if again := sorted({*found.columns} & {*frame.columns} - {*KEY}):
        raise ValueError(f"episodes.csv has {', '.join(again)}, and so has the table of the scenarios")
    together = frame.merge(found, on=[*KEY], how="left", validate="many_to_one")
    if together[found.columns[-1]].isna().any():
        raise ValueError(f"{FOLDER}/{name_of(sha256(content))} does not have the scenario of every episode")
    return together


def of_study(digest: Any, directory: Path) -> bytes:
    """The table with this SHA-256, as the study has it in which the directory of an evaluation lies.

    Raises:
        ValueError: as `joined`.
    """
    if not isinstance(digest, str) or not re.fullmatch(r"[0-9a-f]{64}", digest):
        raise ValueError(f"summary.json names the scenarios {short(repr(digest), 40)}, which is no digest")
    name = f"{FOLDER}/{name_of(digest)}"
    # of <study>/runs/<run>/evaluations/<protocol>
    path = directory.resolve().joinpath("..", "..", "..", "..", name.removesuffix(bz2_io.SUFFIX))
    try:
        content = bz2_io.content(path, reading.DATA)
    except FileNotFoundError as error:
        raise ValueError(f"{name} of its study is missing: a copy is read where it was published") from error
    except (OSError, ValueError) as error:
        raise ValueError(f"{name} of its study cannot be read ({short(error)})") from error
    if sha256(content) != digest:
        raise ValueError(f"{name} of its study differs from its digest: it was changed or damaged")
    return content
