"""Put the published studies of results/ into the site, next to the pages of docs/."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files


def on_files(files: Files, config: Any) -> Files:
    """Add what a study's README shows and links to; its rows stay in the repository."""
    results = Path(config.docs_dir).parent / "results"
    for path in sorted(results.glob("*/**/*")):
        if path.is_file() and path.suffix != ".parquet":
            name = f"studies/{path.relative_to(results).as_posix()}"
            files.append(File.generated(config, name, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Lead links between docs/ and results/ to the places that both have in the site."""
    if page.file.src_uri.startswith("studies/"):
        return markdown.replace("](../../docs/", "](../../").replace("<details>", "<details markdown>")
    return markdown.replace("](../results/", "](studies/")
