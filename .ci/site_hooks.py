"""Put the published studies of results/ into the site, next to the pages of docs/."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

STUDY = "study.md"  # a README would be the page of the whole section
PLACES = (
    ("](../../docs/", "](../../"),
    ("](../results/", "](studies/"),
    ("/README.md", f"/{STUDY}"),
    ("<details>", "<details markdown>"),
)
"""how pages of docs/ and results/ write it, and how the site has it"""


def on_files(files: Files, config: Any) -> Files:
    """Add what a study's README shows and links to; its rows stay in the repository."""
    results = Path(config.docs_dir).parent / "results"
    for path in sorted(results.glob("*/**/*")):
        if path.is_file() and path.suffix != ".parquet":
            name = path.relative_to(results).as_posix().replace("README.md", STUDY)
            files.append(File.generated(config, f"studies/{name}", abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Lead links between docs/ and results/ to their places in the site."""
    for here, there in PLACES:
        markdown = markdown.replace(here, there)
    return markdown
