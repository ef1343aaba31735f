"""Text from elsewhere on its way to a terminal, a table or a figure."""

from __future__ import annotations

LONGEST = 200
"""characters of a name; ours have a dozen"""


def plain(text: object) -> str:
    r"""One line in which every character can be seen: no escape sequences, no line breaks, no turned direction.

    >>> print(plain("a\x1b[31mb\nc\u202e"))
    a\x1b[31mb\nc\u202e
    """
    text = str(text)
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def short(text: object, limit: int = LONGEST) -> str:
    """`plain`, with the middle left out of what is longer than `limit`."""
    shown = plain(str(text)[: 2 * limit] if len(str(text)) > 2 * limit else text)
    if len(shown) <= limit:
        return shown
    return f"{shown[: limit - 1]}…"


def first_line(error: object) -> str:
    r"""What an error says, without what follows its first line; its type where it says nothing.

    >>> first_line(ValueError("no number\nin line 3")), first_line(ValueError())
    ('no number', 'ValueError')
    """
    return (str(error).strip() or type(error).__name__).splitlines()[0]


def cell(value: object) -> object:
    r"""A value for a CSV file that a spreadsheet takes for what it is: a text that would be a formula gets a '.

    Numbers stay numbers, also those that are written as text. A text is one line: a lone carriage return ends a row
    for some readers and none for Python's writer, which does not quote it.

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
