"""Standard output and standard error that survive a character, a closed pipe or a full disk."""

from __future__ import annotations

import contextlib
import os
import sys
from typing import TextIO


def forgiving() -> None:
    """Replace characters that the terminal's encoding lacks by question marks."""
    for stream in (sys.stdout, sys.stderr):
        if getattr(stream, "errors", None) == "strict" and hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def say(text: str) -> None:
    """Print a line to standard error; do nothing where it is closed or full."""
    with contextlib.suppress(OSError, ValueError):
        print(text, file=sys.stderr, flush=True)


def silence(stream: TextIO) -> None:
    """Discard what a stream has buffered, so that Python does not write it while it ends."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
