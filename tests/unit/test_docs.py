"""The pages of docs/ include the files that they name."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from auvbench import metrics
from tests import readme_table

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").rglob("*.md"))
INCLUDE = re.compile(r'--8<-- "([^"]+)"')
GENERATED = {"configuration.md", "verification.md"}
"""pages that a program writes"""
NOT_BY_HAND = re.compile(
    r"<!-- (?:begin|measured): .*?<!-- end|<!-- (\S+): begin -->.*?<!-- \1: end|^```.*?^```|^    [^\n]*",
    re.DOTALL | re.MULTILINE,
)
"""tables and blocks that a program writes between markers, and code"""
LOOKS_LIKE_AN_INCLUDE = re.compile(r"[-–—]\s*8\s*<|8\s*<\s*[-–—]")


def includes(text: str) -> list[str]:
    """Return the paths that a page includes.

    Raises:
        ValueError: a marker is malformed, for example `--8 < --"path"`.
    """
    paths = []
    for line in text.splitlines():
        if LOOKS_LIKE_AN_INCLUDE.search(line):
            found = INCLUDE.fullmatch(line.strip())
            if found is None:
                raise ValueError(f'{line}: write --8<-- "path"')
            paths.append(found[1])
    return paths


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_included_file_has_content(page: Path) -> None:
    for path in includes(page.read_text(encoding="utf-8")):
        assert (ROOT / path).read_text(encoding="utf-8").strip(), path


def test_the_page_on_controllers_includes_the_example() -> None:
    found = includes((ROOT / "docs" / "adding-a-controller.md").read_text(encoding="utf-8"))
    assert [Path(path).name for path in found] == [
        "pyproject.toml",
        "pursuit.yaml",
        "pursuit.py",
        "search.py",
    ]


def test_the_page_on_tasks_includes_the_example() -> None:
    found = includes((ROOT / "docs" / "adding-a-task.md").read_text(encoding="utf-8"))
    assert [Path(path).name for path in found] == [
        "pyproject.toml",
        "circling.yaml",
        "circling.py",
        "view.py",
    ]


@pytest.mark.parametrize("line", ['--8 < --"a.py"', '–8<– "a.py"', "--8<-- a.py", '--8<-- "a.py" # note'])
def test_a_malformed_marker_is_an_error(line: str) -> None:
    with pytest.raises(ValueError, match="write --8<--"):
        includes(line)


@pytest.mark.parametrize("name", readme_table.PAGES)
def test_a_table_from_results_is_that_of_the_files(name: str) -> None:
    assert (ROOT / name).read_text(encoding="utf-8") == readme_table.page(name), (
        "python -m tests.readme_table"
    )


def test_the_pages_are_short() -> None:
    texts = [page.read_text(encoding="utf-8") for page in PAGES if page.name not in GENERATED]
    words = NOT_BY_HAND.sub("", "\n".join(texts).replace(metrics.definitions(), ""))
    assert sum(any(map(str.isalnum, word)) for word in words.split()) <= 20_000


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 600


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda page: page.name)
def test_every_link_of_a_page_to_a_file_leads_to_one(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)#\s:]+)(?:#[^)]*)?\)", text):
        assert (page.parent / target).exists(), target
