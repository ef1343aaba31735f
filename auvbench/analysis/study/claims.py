"""The seven claims of the thesis, each a test fixed here and in docs/statistics.md before any data are seen."""

from __future__ import annotations

from collections.abc import Callable

from auvbench.analysis.model import Finding
from auvbench.analysis.study import testing_claims as testing
from auvbench.analysis.study import training_claims as training
from auvbench.analysis.study.evidence import Evidence

CLAIMS: tuple[Callable[[Evidence], Finding], ...] = (
    training.no_convergence_at_55_hz,
    training.lower_frequency_converges_sooner,
    testing.larger_k_raises_reward_not_success,
    testing.sac4_is_best,
    training.convergence_does_not_predict,
    testing.straightness_and_steps,
    testing.sac_is_more_robust_to_frequency,
)
