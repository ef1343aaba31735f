"""The claims of the thesis that training records decide: 1, 2 and 5."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auvbench.analysis.measures import measure
from auvbench.analysis.model import Finding
from auvbench.analysis.prose import amount, counted, listed
from auvbench.analysis.study import thesis
from auvbench.analysis.study.evidence import Evidence, cell_of_run
from auvbench.analysis.study.learning import Learning
from auvbench.analysis.study.trend import trend
from auvbench.analysis.study.verdict import (
    FAILS,
    HOLDS,
    OPEN,
    Part,
    by_trend,
    together,
)
from auvbench.statistics import wilson
from auvbench.statistics.estimate import Estimate

GENERALISES = 0.8
"""claim 5: success rate whose lower limit makes an agent one that generalises"""
PREDICTS = 0.75
"""claim 5: the probability that a converged run tests better, below which convergence does not predict"""
FEW = 3
"""claim 5: runs of either kind that are needed"""


def no_convergence_at_55_hz(e: Evidence) -> Finding:
    """1: for every K, of the SAC runs trained at 55 Hz for the thesis's 1,000,000 steps none converges.

    It fails where, for some K, more than half of the runs do.
    """
    text = "In training at 55 Hz the agent (SAC) does not converge, whatever K."
    here = [run for run in e.learnings("sac") if cell_of_run(run.run)[1] == thesis.HIGH_FREQUENCY]
    if not here:
        return together(text, [Part(OPEN, missing="training records of SAC at 55 Hz")])
    # A run that converged counts whatever its length; one that did not only if it had as long as the thesis's.
    known = [run for run in here if run.converged or run.steps >= thesis.STEPS]
    ids = tuple(run.run.id for run in here)
    shares, counts = [], []
    for k in sorted({cell_of_run(run.run)[0] for run in known}):
        mine = [run.converged for run in known if cell_of_run(run.run)[0] == k]
        shares.append(float(np.mean(mine)))
        counts.append(f"K={k:g}: {sum(mine)} of {len(mine)}")
    converged = sum(run.converged for run in known)
    missing = []
    if short := len(here) - len(known):
        missing.append(
            f"{thesis.STEPS:,} training steps in {counted(short, 'run')} that did not converge in fewer"
        )
    ks = {cell_of_run(run.run)[0] for run in known}
    if absent := sorted({1.0, 40.0, 100.0} - ks):
        missing.append(f"runs of that length with K={listed([f'{k:g}' for k in absent])}")
    if not known:
        return together(text, [Part(OPEN, missing="; ".join(missing), run_ids=ids)])
    low, high = wilson(converged, len(known), e.confidence)
    share = Estimate(converged / len(known), float(low), float(high), e.confidence)
    statistic = f"converged: {amount(share, measure('success_rate'))} of the runs ({', '.join(counts)})"
    if any(s > 0.5 for s in shares):
        return together(text, [Part(FAILS, statistic, run_ids=ids)])
    verdict = HOLDS if not missing and not converged else OPEN
    if converged and not missing:
        missing.append("agreement between training seeds: some runs converged")
    return together(text, [Part(verdict, statistic, "; ".join(missing), ids)])


def lower_frequency_converges_sooner(e: Evidence) -> Finding:
    """2: at equal K, of two SAC runs the one of the lower frequency converges in fewer steps; permutation test."""
    text = "At equal K, a lower training frequency converges in fewer training steps (SAC)."
    runs = e.learnings("sac")
    strata: dict[float, list[Learning]] = {}
    for run in runs:
        strata.setdefault(cell_of_run(run.run)[0], []).append(run)
    points = []
    for k, members in strata.items():
        # Equal budgets: what converged after the shortest training of the stratum ended counts as not converged.
        budget = min(run.steps for run in members)
        for run in members:
            at = run.converged_at if run.converged_at <= budget else np.inf
            points.append((f"{k:g}", -cell_of_run(run.run)[1], -at))
    found = trend(points, e.confidence, e.seed)
    ids = tuple(run.run.id for run in runs)
    if found is None:
        return together(
            text, [Part(OPEN, missing="SAC runs that differ in frequency at equal K", run_ids=ids)]
        )
    if not any(np.isfinite(point[2]) for point in points):
        return together(text, [Part(OPEN, "no run converged", "runs that converge", ids)])
    part = by_trend(found, "the lower frequency converges sooner in", e.confidence, ids)
    return together(text, [part])


def convergence_does_not_predict(e: Evidence) -> Finding:
    """5: some run that did not converge tests well, and a converged run is hardly more likely to test better."""
    text = "Agents that did not converge in training can generalise: convergence does not predict test success (SAC)."
    tested = {
        run.id: (float(agent.success[i].mean()), agent.outcome.shape[1])
        for agent in e.of("sac")
        for i, run in enumerate(agent.runs)
    }
    runs = [run for run in e.learnings("sac") if run.run.id in tested]
    yes = [tested[run.run.id] for run in runs if run.converged]
    no = [tested[run.run.id] for run in runs if not run.converged and run.steps >= thesis.STEPS]
    ids = tuple(run.run.id for run in runs)
    missing_no = f"evaluated SAC runs that did not converge in {thesis.STEPS:,} steps"
    if no:
        m = measure("success_rate")
        best, n = max(no)
        # The best of several is optimistic: Bonferroni over the runs it was chosen from.
        low, high = wilson(round(best * n), n, 1 - (1 - e.confidence) / len(no))
        generalises = float(low) > GENERALISES
        verdict = HOLDS if generalises else FAILS if float(high) < GENERALISES and len(no) >= FEW else OPEN
        estimate = Estimate(best, float(low), float(high), e.confidence)
        statistic = (
            f"the best of {counted(len(no), 'run')} that did not converge succeeds in {amount(estimate, m)}"
        )
        first = Part(verdict, statistic, "" if verdict != OPEN else missing_no, ids)
    else:
        first = Part(OPEN, missing=missing_no, run_ids=ids)
    return together(text, [first, _prediction([x for x, _ in yes], [x for x, _ in no], e, ids)])


def _prediction(yes: Sequence[float], no: Sequence[float], e: Evidence, ids: tuple[str, ...]) -> Part:
    if min(len(yes), len(no)) < FEW:
        return Part(
            OPEN,
            missing=f"{FEW} evaluated runs that converged (here {len(yes)}) and {FEW} that did not ({len(no)})",
        )
    points = [("all", 1.0, x) for x in yes] + [("all", 0.0, x) for x in no]
    found = trend(points, e.confidence, e.seed)
    assert found is not None  # both levels are there
    estimate = found.estimate
    verdict = FAILS if estimate.low > 0.5 else HOLDS if estimate.high < PREDICTS else OPEN
    statistic = (
        f"a converged run tests better than one that did not with {amount(estimate, measure('success_rate'))}"
    )
    return Part(verdict, statistic, "" if verdict != OPEN else "more runs of either kind", ids)
