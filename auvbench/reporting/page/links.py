"""Links from a number on the page to the run it comes from."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

from auvbench.analysis.archive import EPISODES, RUNS
from auvbench.analysis.records import Agent, RunRecord


class Links:
    """Relative links from the page's folder to the files of runs, and anchors within the page.

    `elsewhere` is the address of the page that has the rows of these agents' runs, if it is another one.
    """

    def __init__(
        self,
        page: Path,
        agents: Sequence[Agent],
        runs: Sequence[RunRecord],
        protocol: str,
        elsewhere: str = "",
    ) -> None:
        self._folder = page.parent.resolve()
        self._elsewhere = elsewhere
        self._protocol = protocol
        self._agents = {agent.label: index for index, agent in enumerate(agents)}
        self._runs = {run.id: run for run in runs}
        self._anchors = {run.id: f"run-{number}" for number, run in enumerate(runs, start=1)}

    def to(self, path: Path) -> str:
        """Return a relative URL of a file or folder, percent-encoded; a file: URL on another drive."""
        try:
            # A leading ./ keeps a name with a colon from being read as a URL's scheme.
            return "./" + quote(Path(os.path.relpath(path.resolve(), self._folder)).as_posix())
        except ValueError:  # Windows: no relative path leads to another drive
            return path.resolve().as_uri()

    def anchor(self, run_id: str) -> str:
        """Return the id of the run's row in the table of runs, or ''."""
        return self._anchors.get(run_id, "")

    def manifest(self, run: RunRecord) -> str:
        """Return the link to a run's manifest, else to its folder."""
        if run.archive is not None:
            return self._existing(run.archive.folder / RUNS)
        return self._existing(run.directory / "manifest.json") or self.to(run.directory)

    def training(self, run: RunRecord) -> str:
        """Return the link to a run's training episodes, or ''."""
        return self._existing(run.directory / "train" / "episodes.csv")

    def evaluation(self, run: RunRecord) -> str:
        """Return the link to a run's test episodes under the report's protocol, or ''."""
        evaluation = run.evaluations.get(self._protocol)
        name = EPISODES if run.archive is not None else "episodes.csv"
        return self._existing(evaluation.directory / name) if evaluation else ""

    def of_runs(self, label: str, run_ids: Sequence[str]) -> str:
        """Return the link to an agent's numbers: its run's test episodes, or its rows in the table of runs."""
        known = [self._runs[run_id] for run_id in run_ids if run_id in self._runs]
        if len(known) == 1 and (href := self.evaluation(known[0])):
            return href
        if label in self._agents and known:
            return f"{self._elsewhere}#agent-{self._agents[label]}"
        return f"{self._elsewhere}#{self._anchors[known[0].id]}" if known else ""

    def _existing(self, path: Path) -> str:
        return self.to(path) if path.is_file() else ""
