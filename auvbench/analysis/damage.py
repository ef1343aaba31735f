"""Define the error for an unusable file of a run, and the checks that raise it."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from auvbench.runs import integrity
from auvbench.untrusted import archives
from auvbench.untrusted.columns import LARGEST
from auvbench.untrusted.text import LONGEST, plain, short


class Damage(Exception):
    """Error: a file of a run cannot be used; `kind` is the kind of the resulting `Problem`."""

    def __init__(self, message: str, kind: str = "damaged") -> None:
        super().__init__(message)
        self.kind = kind


def is_name(value: Any) -> bool:
    """Return whether a text is a valid name in tables and figures: one line, limited length, every character
    visible.
    """
    return isinstance(value, str) and 0 < len(value) <= LONGEST and plain(value) == value


def finite(table: np.ndarray[Any, Any]) -> bool:
    """Return whether all values are finite numbers of a plausible size."""
    # The dtype is object if any cell is a text. NaN fails the check, because each comparison with NaN is False.
    return table.dtype.kind in "if" and bool((np.abs(table) <= LARGEST).all())


@contextmanager
def named(file: str) -> Iterator[None]:
    """Turn an error in reading a file into `Damage` with the file's name."""
    try:
        yield
    except FileNotFoundError as error:
        raise Damage(f"{file} is missing") from error
    except integrity.VersionError as error:
        raise Damage(f"{file} has {error}", "foreign") from error
    except OSError as error:
        raise Damage(f"{file}: {error.strerror or short(error)}") from error
    except (*archives.FAULTS, TypeError, RecursionError, csv.Error) as error:
        raise Damage(f"{file}: {short(error) or type(error).__name__}") from error


def check_digest(holder: Mapping[str, Any], name: str, data: bytes) -> None:
    """Compare a file's size and digest with the values recorded in the manifest or summary.

    Raises:
        Damage: the file differs.
    """
    # An incomplete run has no recorded digests, so its files are not checked.
    if integrity.FILES in holder and (wrong := integrity.difference(holder, name, data)):
        raise Damage(f"{name} {wrong}")
