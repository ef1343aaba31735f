"""The documentation as a site: what it ships, and that a phone shows whole words."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.docs_blocks import ROOT
from tests.integration import test_page_browser as in_browser
from tests.integration.test_page_browser import browser  # noqa: F401  a fixture

pytest.importorskip("mkdocs", reason="needs mkdocs (pip install auvbench[docs])")

BROKEN = """
const broken = [];
for (const node of document.querySelectorAll(".md-content code, .md-content h1, .md-content h2, .md-content th, .md-content td")) {
  const texts = document.createTreeWalker(node, NodeFilter.SHOW_TEXT);
  if (node.closest("pre")) continue;
  while (texts.nextNode()) {
    const data = texts.currentNode.data;
    for (const word of data.matchAll(/[\\w.]+/g)) {
      // What is longer than a line must break somewhere.
      const before = data.slice(0, word.index).match(/\\S*$/)[0], after = data.slice(word.index).match(/^\\S*/)[0];
      if (before.length + after.length > 40) continue;
      const range = document.createRange();
      range.setStart(texts.currentNode, word.index);
      range.setEnd(texts.currentNode, word.index + word[0].length);
      const lines = new Set([...range.getClientRects()].map(box => Math.round(box.top)));
      if (lines.size > 1) broken.push(word[0]);
    }
  }
}
return broken;
"""
"""words of tables, headings and names that are on two lines"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    # As on a machine that keeps bytecode.
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", str(folder)],
        cwd=ROOT,
        env={**environment, "NO_MKDOCS_2_WARNING": "1"},
        check=True,
    )
    return folder


@pytest.mark.slow
def test_the_site_has_no_code_of_its_own(site: Path) -> None:
    assert (site / "index.html").is_file()
    assert [
        path for path in site.rglob("*") if path.suffix in (".py", ".pyc") or path.name == "__pycache__"
    ] == []


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.skipif(
    in_browser.CHROMIUM is None or in_browser.CHROMEDRIVER is None, reason="needs Chromium and its driver"
)
def test_words_stay_whole_on_a_phone(site: Path, browser: Any) -> None:  # noqa: F811
    in_browser.emulate(browser, 390, 900, mobile=True)
    broken = {}
    for page in sorted(site.glob("*.html")):
        in_browser.load(browser, page)
        assert browser.execute_script("return document.documentElement.scrollWidth") <= 390, page.name
        if words := browser.execute_script(BROKEN):
            broken[page.name] = words
    assert broken == {}
