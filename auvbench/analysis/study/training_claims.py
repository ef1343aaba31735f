"""The claims of the thesis that training records decide: 1, 2 and 5. Each function returns the claim's parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from auvbench.analysis.formatting import amount, counted, listed
from auvbench.analysis.measures import measure
from auvbench.analysis.study import thesis
from auvbench.analysis.study.evidence import Evidence, cell_of_run
from auvbench.analysis.study.learning import Learning
from auvbench.analysis.study.shares import limits, p_more_than_half, superiority
from auvbench.analysis.study.trend import Point, trend
from auvbench.analysis.study.verdict import FAILS, HOLDS, OPEN, Levels, Part, by_trend
from auvbench.analysis.timing import by_frequency, differs, limit_s
from auvbench.statistics.estimate import Estimate

KS = (1.0, 40.0, 100.0)
"""the thesis's values of K"""
GENERALISES = 0.8
"""claim 5: success rate whose lower limit makes a training one that generalises"""
PREDICTS = 0.75
"""claim 5: the probability that a converged run tests better, below which convergence does not predict"""
FEW = 3
"""claim 5: runs of either kind that are needed"""


def no_convergence_at_55_hz(e: Evidence) -> list[Part]:
    """1: for every K, fewer than half of the SAC trainings at 55 Hz converge within the thesis's 1,000,000 steps.

    The thesis saw one training of each K. What it says of K is said here of the probability that a training converges:
    it holds if for each K the upper limit is below one half, it fails if for some K, or over all of them, more than
    half do; each with an error of 1 - confidence (exact binomial limits; the four tests of "fails" by Bonferroni).
    """
    alpha = 1 - e.confidence
    here = [run for run in e.learnings("sac") if cell_of_run(run.run)[1] == thesis.HIGH_FREQUENCY]
    if not here:
        return [Part(OPEN, missing="training records of SAC at 55 Hz")]
    # One that converged counts whatever its length; one that did not only if it had as long as the thesis's.
    known = [run for run in here if run.converged or run.steps >= thesis.STEPS]
    # Of a mixture of lengths the short ones could only be counted where they converged: then none of them is.
    if any(run.steps < thesis.STEPS and not run.converged for run in here):
        known = [run for run in here if run.steps >= thesis.STEPS]
    ids = tuple(run.run.id for run in here)
    counts = {}
    for k in sorted({cell_of_run(run.run)[0] for run in known}):
        mine = [run.converged for run in known if cell_of_run(run.run)[0] == k]
        counts[k] = (sum(mine), len(mine))
    missing = []
    if short := len(here) - len(known):
        missing.append(f"{thesis.STEPS:,} training steps in {counted(short, 'run')} of fewer")
    if not known:
        return [Part(OPEN, missing="; ".join(missing), run_ids=ids)]
    if absent := sorted(set(KS) - counts.keys()):
        missing.append(f"runs of that length with K={listed([f'{k:g}' for k in absent])}")
    upper = {k: limits(x, n, alpha)[1] for k, (x, n) in counts.items()}
    shown = ", ".join(f"K={k:g}: {x} of {n} (at most {100 * upper[k]:.0f} %)" for k, (x, n) in counts.items())
    tests = [*counts.values(), (sum(x for x, _ in counts.values()), sum(n for _, n in counts.values()))]
    statistic = f"converged: {shown}, with {100 * e.confidence:g} % confidence each"
    if any(p_more_than_half(x, n) < alpha / len(tests) for x, n in tests):
        return [Part(FAILS, statistic, run_ids=ids)]
    if not missing and all(limit < 0.5 for limit in upper.values()):
        return [Part(HOLDS, statistic, run_ids=ids)]
    if few := [k for k, limit in upper.items() if limit >= 0.5]:
        missing.append(
            f"more training seeds with K={listed([f'{k:g}' for k in few])} (five of which none converges would do)"
        )
    return [Part(OPEN, statistic, "; ".join(missing), ids)]


def lower_frequency_converges_sooner(e: Evidence) -> list[Part]:
    """2: at equal K, of two SAC runs the one of the lower frequency converges in fewer steps; permutation test.

    Of a K at which no run converged nothing is said.
    """
    runs = e.learnings("sac")
    strata: dict[float, list[Learning]] = {}
    for run in runs:
        strata.setdefault(cell_of_run(run.run)[0], []).append(run)
    points: list[Point] = []
    for k, members in strata.items():
        # Equal budgets: what converged after the shortest training of the stratum ended counts as not converged.
        budget = min(run.steps for run in members)
        when = [run.converged_at if run.converged_at <= budget else np.inf for run in members]
        if np.isfinite(when).any():
            points += [
                (f"{k:g}", -cell_of_run(run.run)[1], -at) for run, at in zip(members, when, strict=True)
            ]
    ids = tuple(run.run.id for run in runs)
    found = trend(points, e.confidence, e.seed)
    if found is None:
        alone = "SAC runs that differ in frequency at equal K"
        if runs and not points and trend(_levels(strata), e.confidence, e.seed) is not None:
            return [Part(OPEN, "no run converged", "runs that converge", ids)]
        return [Part(OPEN, missing=alone, run_ids=ids)]
    part = by_trend(found, "the lower frequency converges sooner in", Levels.of(e.confidence, 1), ids)
    return [replace(part, statistic=f"{part.statistic}{_other_times(runs)}")]


def _other_times(runs: Sequence[Learning]) -> str:
    """What else changes with the frequency, where an episode lasts so many steps as in the thesis; '' where nothing does."""
    times = by_frequency([run.run for run in runs], limit_s)
    if not differs(times):
        return ""
    shown = [f"{' or '.join(f'{s:g}' for s in found)} s at {f:g} Hz" for f, found in times.items() if found]
    return f"; the time for an episode goes with the frequency ({listed(shown)}) and may be the cause"


def _levels(strata: dict[float, list[Learning]]) -> list[Point]:
    return [(f"{k:g}", -cell_of_run(run.run)[1], 0.0) for k, members in strata.items() for run in members]


def convergence_does_not_predict(e: Evidence) -> list[Part]:
    """5: some run that did not converge tests well, and a converged run is hardly more likely to test better."""
    tested = {
        run.id: (float(agent.success[i].mean()), agent.outcome.shape[1])
        for agent in e.of("sac")
        for i, run in enumerate(agent.runs)
    }
    runs = [run for run in e.learnings("sac") if run.run.id in tested]
    yes = [tested[run.run.id] for run in runs if run.converged]
    no = [tested[run.run.id] for run in runs if not run.converged and run.steps >= thesis.STEPS]
    ids = tuple(run.run.id for run in runs)
    levels = Levels.of(e.confidence, 2)
    better = [x for x, _ in yes], [x for x, _ in no]
    return [_some_generalises(no, levels, ids), _prediction(*better, levels, ids)]


def _some_generalises(no: Sequence[tuple[float, int]], levels: Levels, ids: tuple[str, ...]) -> Part:
    """Some run that did not converge tests above 80 %; not, if fewer than half of such trainings would."""
    missing = f"evaluated SAC runs that did not converge in {thesis.STEPS:,} steps"
    if not no:
        return Part(OPEN, missing=missing, run_ids=ids)
    best, n = max(no)
    # The best of several is optimistic: Bonferroni over the runs it was chosen from.
    low, high = limits(best * n, n, (1 - levels.holds) / 2 / len(no))
    estimate = Estimate(best, low, high, levels.holds)
    reach = sum(x > GENERALISES for x, _ in no)
    share = limits(reach, len(no), (1 - levels.fails) / 2)[1]
    verdict = HOLDS if low > GENERALISES else FAILS if reach == 0 and share < 0.5 else OPEN
    text = amount(estimate, measure("success_rate"))
    statistic = (
        f"the best of {counted(len(no), 'run')} that did not converge succeeds in {text}; {reach} of them above "
        f"{100 * GENERALISES:g} %, so at most {100 * share:.0f} % of such trainings"
    )
    return Part(verdict, statistic, "" if verdict != OPEN else f"more {missing}", ids)


def _prediction(yes: Sequence[float], no: Sequence[float], levels: Levels, ids: tuple[str, ...]) -> Part:
    """How likely a converged run tests better than one that did not.

    The variance of that share is at most p (1 - p) over the smaller number of runs, whatever their distributions (van
    Dantzig 1951; Birnbaum & Klose 1957, Ann. Math. Stat. 28:933): the limits are those of so many binomial trials.
    """
    if min(len(yes), len(no)) < FEW:
        return Part(
            OPEN,
            missing=f"{FEW} evaluated runs that converged (here {len(yes)}) and {FEW} that did not ({len(no)})",
        )
    n = min(len(yes), len(no))
    value = superiority(np.array(yes), np.array(no))

    def at(confidence: float) -> Estimate:
        low, high = limits(value * n, n, (1 - confidence) / 2)
        return Estimate(value, min(low, value), max(high, value), confidence)

    yes_at, no_at = at(levels.holds), at(levels.fails)
    verdict = FAILS if no_at.low > 0.5 else HOLDS if yes_at.high < PREDICTS else OPEN
    statistic = (
        f"a converged run tests better than one that did not with {amount(yes_at, measure('success_rate'))}"
    )
    return Part(verdict, statistic, "" if verdict != OPEN else "more runs of either kind", ids)
