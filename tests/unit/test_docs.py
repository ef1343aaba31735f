"""The pages of docs/ include the files that they name."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").rglob("*.md"))
INCLUDE = re.compile(r'--8<-- "([^"]+)"')
LOOKS_LIKE_AN_INCLUDE = re.compile(r"-+\s*8\s*<")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_included_file_exists(page: Path) -> None:
    for line in page.read_text(encoding="utf-8").splitlines():
        if LOOKS_LIKE_AN_INCLUDE.search(line):
            found = INCLUDE.fullmatch(line.strip())
            assert found, f'{line}: write --8<-- "path"'
            assert (ROOT / found[1]).is_file(), line
