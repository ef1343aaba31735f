"""Write the report as one self-contained HTML page, `report/index.html`."""

from auvbench.reporting.page.writer import write

__all__ = ["write"]
