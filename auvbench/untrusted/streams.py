"""Standard output and standard error that do not fall over for a letter or a full disk."""

from __future__ import annotations

import contextlib
import os
import sys
from typing import TextIO


def forgiving() -> None:
    """A letter that the terminal's encoding lacks becomes a question mark instead of an error."""
    for stream in (sys.stdout, sys.stderr):
        if getattr(stream, "errors", None) == "strict" and hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def say(text: str) -> None:
    """A line to standard error, if that takes one."""
    with contextlib.suppress(OSError, ValueError):
        print(text, file=sys.stderr, flush=True)


def silence(stream: TextIO) -> None:
    """Sends what a stream still holds back nowhere, so that Python does not try again while it ends."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
