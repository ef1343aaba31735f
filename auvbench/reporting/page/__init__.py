"""The report as one self-contained HTML page: `write` makes `report/index.html`."""

from auvbench.reporting.page.writer import write

__all__ = ["write"]
