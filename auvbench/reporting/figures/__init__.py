"""The figures of a report: each one a small function that draws what it is handed."""

from auvbench.reporting.figures.model import Figure

__all__ = ["Figure"]
