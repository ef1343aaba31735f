"""The seven claims of the thesis, each a test fixed here and in docs/claims.md before any data are seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from auvbench.analysis.model import ClaimVerdict
from auvbench.analysis.study import testing_claims as testing
from auvbench.analysis.study import training_claims as training
from auvbench.analysis.study.evidence import Evidence
from auvbench.analysis.study.verdict import Part, together


@dataclass(frozen=True, slots=True)
class Claim:
    """A claim in words, and the tests it is judged by."""

    text: str
    parts: Callable[[Evidence], list[Part]]

    def __call__(self, evidence: Evidence) -> ClaimVerdict:
        return together(self.text, self.parts(evidence))


CLAIMS = (
    Claim(
        "In training at 55 Hz the agent (SAC) does not converge, whatever K.",
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
    Claim("Path straightness and step count do not correlate.", testing.straightness_and_steps),
    Claim(
        "SAC is more robust than PPO to a high frequency; PPO at 10 Hz beats SAC at 10 Hz, PPO at 25 Hz fails.",
        testing.sac_is_more_robust_to_frequency,
    ),
)
