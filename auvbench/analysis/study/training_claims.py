"""The claims of the original study that training records decide: 1, 2 and 5. Each function returns the claim's parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from auvbench.analysis.formatting import amount, counted, listed
from auvbench.analysis.measures import measure
from auvbench.analysis.study import thesis
from auvbench.analysis.study.evidence import Evidence, cell_of_run
from auvbench.analysis.study.learning import Learning
from auvbench.analysis.study.trend import Point, trend
from auvbench.analysis.study.verdict import FAILS, HOLDS, OPEN, Levels, Part, by_trend
from auvbench.analysis.timing import by_frequency, differs, limit_s
from auvbench.statistics import limits, p_more_than_half, probability_of_improvement
from auvbench.statistics.intervals import Estimate

KS = (1.0, 40.0, 100.0)
"""the original study's values of K"""
GENERALISES = 0.8
"""claim 5: success rate whose lower limit makes a training one that generalises"""
PREDICTS = 0.75
"""claim 5: the probability that a converged run tests better, below which convergence does not predict"""
Cell = tuple[float, float]
"""K and frequency in Hz"""
FEW = 3
"""claim 5: pairs of runs that are needed, one of either kind and both of one cell"""


def no_convergence_at_55_hz(e: Evidence) -> list[Part]:
    """1: for every K, fewer than half of the SAC trainings at 55 Hz converge within 1,000,000 steps.

    The original study saw one training of each K. Here the claim is about the probability that a training converges: it
    holds if for each K the upper limit is below one half, and fails if for some K, or over all of them, more than half
    converge (exact binomial limits, error 1 - confidence each; the four tests of "fails" by Bonferroni). It cannot hold
    where no control converges within the time limit of an episode.
    """
    alpha = 1 - e.confidence
    here = [run for run in e.learnings("sac") if cell_of_run(run.run)[1] == thesis.HIGH_FREQUENCY]
    if not here:
        return [Part(OPEN, missing="training records of SAC at 55 Hz")]
    # One that converged counts with any length; one that did not only if it had the original study's budget.
    known = [run for run in here if run.converged or run.steps >= thesis.STEPS]
    # Of a mixture of lengths the short ones could only be counted where they converged: then none of them is.
    if any(run.steps < thesis.STEPS and not run.converged for run in here):
        known = [run for run in here if run.steps >= thesis.STEPS]
    ids = tuple(run.run.id for run in here)
    counts = {}
    for k in sorted({cell_of_run(run.run)[0] for run in known}):
        mine = [run.converged for run in known if cell_of_run(run.run)[0] == k]
        counts[k] = (sum(mine), len(mine))
    missing = _unattainable(e, here)
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
            f"more training seeds with K={listed([f'{k:g}' for k in few])} (five that do not converge are enough)"
        )
    return [Part(OPEN, statistic, "; ".join(missing), ids)]


def _unattainable(e: Evidence, runs: Sequence[Learning]) -> list[str]:
    """Return what is missing where no control converges within the runs' time limits."""
    found = sorted({run.limit for run in runs if not e.attainable(run.limit)})
    if not found:
        return []
    times = listed([f"{limit:.3g}" for limit in found])
    return [f"a time limit within which a control converges (no evaluated policy does within {times} s)"]


def lower_frequency_converges_sooner(e: Evidence) -> list[Part]:
    """2: at equal K, of two SAC runs the one of the lower frequency converges in fewer steps; permutation test.

    Runs whose time limit no control meets are left out, and so is a K without a converged run. Where episodes may last
    more seconds at one frequency than at another, the answer needs two tests that agree: each run within its own time
    limit, and all runs of a K within the shortest of theirs. The first favours the longer limit, the second the
    shorter one, for which its run was trained. A policy that learns nothing ties with itself in the second.
    """
    runs = e.learnings("sac")
    judged = [run for run in runs if e.attainable(run.limit)]
    ids = tuple(run.run.id for run in judged)
    points = {own: _dates(judged, own) for own in (False, True)}
    found = {own: trend(points[own], e.confidence, e.seed) for own in points}
    shortest, own_limit = found[False], found[True]
    if shortest is None or own_limit is None:
        pairs = [(f"{k:g}", f, 0.0) for k, f in (cell_of_run(run.run) for run in judged)]
        if trend(pairs, e.confidence, e.seed) is not None:
            return [Part(OPEN, "no run converged", "runs that converge", ids)]
        missing = ["SAC runs that differ in frequency at equal K", *_unattainable(e, runs)]
        return [Part(OPEN, missing="; ".join(missing), run_ids=ids)]
    what = "the lower frequency converges sooner in"
    levels = Levels.of(e.confidence, 1)
    part = by_trend(shortest, what, levels, ids)
    if times := _other_times(judged):
        other = by_trend(own_limit, f"{what.removesuffix(' in')} within its own limit in", levels, ids)
        part = replace(part, statistic=f"{part.statistic}; {other.statistic}; {times}")
        if other.verdict != part.verdict:
            why = "training episodes of as many seconds at every frequency: the two limits do not agree"
            part = replace(part, verdict=OPEN, missing=why)
    if excluded := [run for run in runs if run not in judged]:
        at = listed([f"{f:g}" for f in sorted({cell_of_run(run.run)[1] for run in excluded})])
        left = f"left out: {counted(len(excluded), 'run')} at {at} Hz, whose time limit no evaluated policy meets"
        part = replace(part, statistic=f"{part.statistic}; {left}")
    return [part]


def _dates(runs: Sequence[Learning], own: bool) -> list[Point]:
    """Return (K, -frequency, -steps to convergence) per run, within its own time limit or the shortest of its K."""
    strata: dict[float, list[Learning]] = {}
    for run in runs:
        strata.setdefault(cell_of_run(run.run)[0], []).append(run)
    points: list[Point] = []
    for k, members in strata.items():
        # Equal budgets: what converged after the shortest training of the stratum ended counts as not converged.
        budget = min(run.steps for run in members)
        limit = min(run.limit for run in members)
        dates = [run.converged_at(run.limit if own else limit) for run in members]
        when = [date if date <= budget else np.inf for date in dates]
        if np.isfinite(when).any():
            points += [
                (f"{k:g}", -cell_of_run(run.run)[1], -at) for run, at in zip(members, when, strict=True)
            ]
    return points


def _other_times(runs: Sequence[Learning]) -> str:
    """Return what else changes with the frequency, where episodes differ in seconds; '' elsewhere."""
    times = by_frequency([run.run for run in runs], limit_s)
    if not differs(times):
        return ""
    shown = [f"{' or '.join(f'{s:g}' for s in found)} s at {f:g} Hz" for f, found in times.items() if found]
    return f"trained with {listed(shown)} per episode, which may be the cause"


def convergence_does_not_predict(e: Evidence) -> list[Part]:
    """5: some run that did not converge tests well, and a converged run is hardly more likely to test better.

    "Did not converge" counts after 1,000,000 steps, and where some control converges within the run's time limit.
    """
    tested = {
        run.id: (float(agent.success[i].mean()), agent.outcome.shape[1])
        for agent in e.of("sac")
        for i, run in enumerate(agent.runs)
    }
    runs = [run for run in e.learnings("sac") if run.run.id in tested]
    yes = [run for run in runs if run.converged]
    full = [run for run in runs if not run.converged and run.steps >= thesis.STEPS]
    no = [run for run in full if e.attainable(run.limit)]
    ids = tuple(run.run.id for run in runs)
    levels = Levels.of(e.confidence, 2)
    by_cell: dict[Cell, tuple[list[float], list[float]]] = {}
    for kind, members in enumerate((yes, no)):
        for run in members:
            by_cell.setdefault(cell_of_run(run.run), ([], []))[kind].append(tested[run.run.id][0])
    parts = [
        _some_generalises([tested[run.run.id] for run in no], levels, ids),
        _prediction(list(by_cell.values()), levels, ids),
    ]
    why = _unattainable(e, full)
    return [
        replace(part, missing="; ".join([part.missing, *why])) if part.verdict == OPEN else part
        for part in parts
    ]


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


def _prediction(
    by_cell: Sequence[tuple[Sequence[float], Sequence[float]]], levels: Levels, ids: tuple[str, ...]
) -> Part:
    """Judge how likely a converged run tests better than one of the same K and frequency that did not converge.

    Runs of one cell share what K and frequency do, so only runs of the same cell are compared. The variance of a
    cell's share is at most p (1 - p) over the smaller number of its runs, for any distributions (van Dantzig 1951;
    Birnbaum & Klose 1957, Ann. Math. Stat. 28:933). Weighted by these numbers, the mean has the limits of as many
    binomial trials as their sum.
    """
    both = [(np.array(yes), np.array(no)) for yes, no in by_cell if yes and no]
    fewer = np.array([min(len(yes), len(no)) for yes, no in both])
    n = int(fewer.sum())
    if n < FEW:
        return Part(
            OPEN,
            missing=f"{FEW} pairs of evaluated runs of the same K and frequency, one converged and one not (here {n})",
            run_ids=ids,
        )
    value = float(fewer @ [probability_of_improvement(yes, no) for yes, no in both]) / n

    def at(confidence: float) -> Estimate:
        low, high = limits(value * n, n, (1 - confidence) / 2)
        return Estimate(value, min(low, value), max(high, value), confidence)

    yes_at, no_at = at(levels.holds), at(levels.fails)
    verdict = FAILS if no_at.low > 0.5 else HOLDS if yes_at.high < PREDICTS else OPEN
    statistic = (
        "a converged run tests better than one of the same K and frequency that did not with "
        f"{amount(yes_at, measure('success_rate'))}, in {counted(len(both), 'cell')}"
    )
    return Part(verdict, statistic, "" if verdict != OPEN else "more runs of either kind", ids)
