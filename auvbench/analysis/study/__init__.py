"""Studies: claims that a report answers from the runs that exist. `--study thesis` is the one there is.

docs/claims.md states each claim's test; `thesis` holds the original study's numbers, `claims` the tests.
"""

from __future__ import annotations

from collections.abc import Sequence

from auvbench.analysis.records import Agent, ClaimVerdict, RunRecord
from auvbench.analysis.study.claims import CLAIMS
from auvbench.analysis.study.evidence import Evidence
from auvbench.analysis.study.thesis_comparison import ComparisonRow, compare
from auvbench.errors import ReportError, closest

__all__ = ["STUDIES", "ComparisonRow", "answer", "compare"]

STUDIES = {"thesis": CLAIMS}


def answer(
    runs: Sequence[RunRecord],
    agents: Sequence[Agent],
    study: str = "thesis",
    *,
    confidence: float = 0.95,
    seed: int = 0,
) -> list[ClaimVerdict]:
    """Each claim of a study with its verdict: holds, does not hold, cannot be said (and what is missing).

    Args:
        runs: all runs, for their training records; unfinished ones are left out.
        agents: evaluated agents of one condition; grouped by algorithm, K and frequency alone.
        study: name of the study.
        confidence: of every interval.
        seed: of permutations and bootstrap.

    Raises:
        ReportError: no such study.
    """
    if study not in STUDIES:
        raise ReportError(f"--study {study!r} is not known; {closest(study, STUDIES)}")
    evidence = Evidence(runs, agents, confidence, seed)
    return [claim(evidence) for claim in STUDIES[study]]
