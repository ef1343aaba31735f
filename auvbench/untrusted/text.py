"""Clean untrusted text for a terminal, a table or a figure, and protect the standard streams."""

from __future__ import annotations

import contextlib
import os
import re
import sys
from typing import TextIO

LONGEST = 200
"""largest number of characters of a name; names in auvbench have about a dozen"""
_LONG_WORD = re.compile(r"\S{500,}")


def plain(text: object) -> str:
    r"""Return one line of visible characters: no escape sequences, line breaks or direction marks.

    >>> print(plain("a\x1b[31mb\nc\u202e"))
    a\x1b[31mb\nc\u202e
    """
    text = str(text)
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def plain_lines(text: str) -> str:
    r"""Return a text with its line breaks, each line as `plain` returns it.

    >>> plain_lines("a\x1b[2J\n  b\n")
    'a\\x1b[2J\n  b\n'
    """
    return "\n".join(map(plain, text.split("\n")))


def short(text: object, limit: int = LONGEST) -> str:
    """Return the text as `plain` does, cut to at most `limit` characters."""
    shown = plain(str(text)[: 2 * limit] if len(str(text)) > 2 * limit else text)
    if len(shown) <= limit:
        return shown
    return f"{shown[: limit - 1]}…"


def message(error: object) -> str:
    """Return an error's line for the terminal: `plain`, with very long words cut."""
    return short(_LONG_WORD.sub(lambda word: f"{word[0][:LONGEST]}…", plain(error)), 5000)


def first_line(error: object) -> str:
    r"""Return the first line of an error, or its type if it has no text.

    >>> first_line(ValueError("no number\nin line 3")), first_line(ValueError())
    ('no number', 'ValueError')
    """
    return (str(error).strip() or type(error).__name__).splitlines()[0]


def cell(value: object) -> object:
    r"""Return a value for a CSV file; a text that a spreadsheet would read as a formula gets a leading '.

    Numbers stay unchanged, even numbers written as text. A text becomes one line, because Python's writer
    does not quote a lone carriage return, which ends a row for some readers.

    >>> cell("=1+1"), cell("PPO"), cell(-1.5), cell("-1.5"), cell("a\rb")
    ("'=1+1", 'PPO', -1.5, '-1.5', 'a\\rb')
    """
    if not isinstance(value, str):
        return value
    value = plain(value)
    if not value.lstrip().startswith(("=", "+", "-", "@")):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value


def present() -> None:
    """Open closed standard streams on the null device; otherwise the next opened file would get a stream's descriptor."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            nowhere = os.open(os.devnull, os.O_RDWR)
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)
            os.set_inheritable(number, True)  # workers inherit it
        if getattr(sys, name) is None:
            mode = "r" if name == "stdin" else "w"
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115


def forgiving() -> None:
    """Let the standard streams print a question mark for a character that their encoding lacks."""
    for stream in (sys.stdout, sys.stderr):
        if getattr(stream, "errors", None) == "strict" and hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")


def say(text: str) -> None:
    """Print a line to standard error; do nothing if standard error is closed or cannot be written."""
    with contextlib.suppress(OSError, ValueError):
        print(text, file=sys.stderr, flush=True)


def silence(stream: TextIO) -> None:
    """Discard what a stream has buffered, so that Python does not write it on exit."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
