"""The code blocks of README.md and docs/: lines of `auvbench`, Python, YAML."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
MISTAKES = (
    "evaluate outputs --protocol thesis",
    "report outputs baseline=pid",
    "train algo.tau=0.01",
)
"""shown with their error in docs/grammar.md"""

_EXAMPLE = re.compile(r"<!-- begin: (examples/\S+) -->.*?<!-- end: \1 -->", re.S)
_BLOCK = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```|^    (auvbench [^\n]*)$", re.M | re.S)


def steps(page: Path) -> list[tuple[str, str]]:
    """Return the blocks of a page in order: ("auvbench", a line without that word), ("python", text), ("yaml", text).

    Comments and a final `&` are cut off; `> FILE` stays. Files of `examples/` are left out: they have tests of their own.
    """
    found = []
    text = _EXAMPLE.sub("", page.read_text(encoding="utf-8")).replace("\\\n", " ")
    for language, block, indented in _BLOCK.findall(text):
        if language in ("python", "yaml"):
            found.append((language, block))
            continue
        for line in (block or indented).splitlines():
            for part in re.sub(r"^\$ ", "", line.strip()).split(" && "):
                if part.startswith("auvbench "):
                    command = re.sub(r"\s+(#|&).*", "", part).removeprefix("auvbench ")
                    found.append(("auvbench", re.sub(r"\s+", " ", command).strip()))
    return found
