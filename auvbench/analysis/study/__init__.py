"""Studies: claims that a report answers from the runs that exist. `--study thesis` is the one there is.

docs/claims.md states each claim's test; `thesis` holds the original study's numbers, `claims` the tests.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from auvbench.analysis.formatting import listed
from auvbench.analysis.records import Agent, ClaimVerdict, RunRecord
from auvbench.analysis.study import testing_claims as testing
from auvbench.analysis.study import training_claims as training
from auvbench.analysis.study.evidence import Evidence
from auvbench.analysis.study.straightness import straightness_and_steps
from auvbench.analysis.study.thesis import ComparisonRow as ComparisonRow
from auvbench.analysis.study.thesis import compare as compare
from auvbench.analysis.study.verdict import Part, together
from auvbench.analysis.timing import budget_of
from auvbench.errors import ReportError, closest


@dataclass(frozen=True, slots=True)
class Claim:
    """A claim in words, and the tests it is judged by."""

    text: str
    parts: Callable[[Evidence], list[Part]]

    def __call__(self, evidence: Evidence) -> ClaimVerdict:
        verdict = together(self.text, self.parts(evidence))
        return replace(
            verdict, statistic=" ".join(filter(None, [verdict.statistic, _basis(evidence, verdict)]))
        )


def _basis(evidence: Evidence, verdict: ClaimVerdict) -> str:
    """Return presets, budget and seeds of a verdict's runs as a sentence; empty without runs."""
    known = {run.id: run for run in [*evidence.runs, *(run for a in evidence.agents for run in a.runs)]}
    by_preset: dict[str, list[RunRecord]] = {}
    for run in (known[i] for i in verdict.run_ids if i in known):
        by_preset.setdefault(str(run.config.get("algo.name")), []).append(run)
    parts = []
    for preset, runs in by_preset.items():
        budgets = [f"{steps:,}" for steps in sorted({budget_of(run) for run in runs})]
        seeds = sorted({run.seed for run in runs})
        parts.append(
            f"{preset}, {listed(budgets)} steps, {'seed' if len(seeds) == 1 else 'seeds'} {listed([str(s) for s in seeds], 10)}"
        )
    return f"Runs: {'; '.join(parts)}." if parts else ""


CLAIMS = (
    Claim(
        "In training at 55 Hz the agent (SAC) does not converge for any K.",
        training.no_convergence_at_55_hz,
    ),
    Claim(
        "At equal K, a lower training frequency converges in fewer training steps (SAC).",
        training.lower_frequency_converges_sooner,
    ),
    Claim(
        "A larger K raises the episode reward and not the success: of the best-rewarded episodes more are failures.",
        testing.larger_k_raises_reward_not_success,
    ),
    Claim(
        "SAC with K=1 at 25 Hz (SAC4) is the best SAC agent in testing, and a lower K goes with higher success.",
        testing.sac4_is_best,
    ),
    Claim(
        "Agents that did not converge in training can generalise: convergence does not predict test success (SAC).",
        training.convergence_does_not_predict,
    ),
    Claim("Path straightness and step count do not correlate.", straightness_and_steps),
    Claim(
        "SAC is more robust than PPO to a high frequency; PPO at 10 Hz beats SAC at 10 Hz, PPO at 25 Hz fails.",
        testing.sac_is_more_robust_to_frequency,
    ),
)


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
