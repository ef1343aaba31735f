"""The pages of docs/: generated blocks, links, length."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from auvbench import metrics
from tests import readme_table

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").rglob("*.md"))
GENERATED = {"configuration.md", "scenario-sets.md", "verification.md"}
"""pages that a program writes"""
NOT_BY_HAND = re.compile(
    r"<!-- (?:begin|measured): .*?<!-- end|<!-- (\S+): begin -->.*?<!-- \1: end|^```.*?^```|^    [^\n]*",
    re.DOTALL | re.MULTILINE,
)
"""tables and blocks that a program writes between markers, and code"""


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda page: page.name)
def test_a_page_contains_its_code_and_no_marker_of_a_snippet(page: Path) -> None:
    # GitHub shows the marker of a snippet instead of the code.
    assert not re.search(r"[-–—]\s*8\s*<|8\s*<\s*[-–—]", page.read_text(encoding="utf-8"))


def test_the_pages_on_packages_show_each_file_of_the_example_that_they_name() -> None:
    shown = {path for blocks in readme_table.PAGES.values() for path in blocks if "/" in path}
    assert {Path(path).name for path in shown} == {
        *("pyproject.toml", "pursuit.yaml", "pursuit.py", "search.py"),
        *("circling.yaml", "circling.py", "view.py", "polyu.yaml", "still.py", "doppler.py", "surge.py"),
    }


def test_a_file_is_shown_as_code_under_its_path() -> None:
    path = "examples/auvbench-example/auvbench_example/view.py"
    first, *lines, last = readme_table.code(path).splitlines()
    assert (first, lines[:2], last) == (f"`{path}`:", ["", "```python"], "```")
    assert "\n".join(lines[2:]) + "\n" == (ROOT / path).read_text(encoding="utf-8")


def test_a_page_without_the_place_of_a_block_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(readme_table.PAGES, "docs/task.md", ("suite",))
    with pytest.raises(ValueError, match=r"docs/task\.md: 0 places for the block <!-- begin: suite -->"):
        readme_table.page("docs/task.md")


@pytest.mark.parametrize("name", readme_table.PAGES)
def test_the_generated_blocks_of_a_page_are_those_of_the_files(name: str) -> None:
    assert (ROOT / name).read_text(encoding="utf-8") == readme_table.page(name), (
        "python -m tests.readme_table"
    )


def test_the_pages_are_short_on_average() -> None:
    texts = [page.read_text(encoding="utf-8") for page in PAGES if page.name not in GENERATED]
    words = NOT_BY_HAND.sub("", "\n".join(texts).replace(metrics.definitions(), ""))
    assert sum(any(map(str.isalnum, word)) for word in words.split()) <= 480 * len(texts)


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 600


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda page: page.name)
def test_every_link_of_a_page_to_a_file_leads_to_one(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)#\s:]+)(?:#[^)]*)?\)", text):
        assert (page.parent / target).exists(), target
