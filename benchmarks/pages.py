"""Renew what was measured in a page of the documentation."""

from __future__ import annotations

import re


def replaced(page: str, name: str, table: str) -> str:
    """Return the page with the table between the markers of that name.

    Raises:
        ValueError: the page has no such markers.
    """
    start, end = f"<!-- measured: {name} -->", "<!-- end -->"
    pattern = re.compile(re.escape(start) + r".*?" + re.escape(end), flags=re.S)
    if not pattern.search(page):
        raise ValueError(f"no {start}")
    return pattern.sub(lambda _: f"{start}\n{table}\n{end}", page, count=1)
