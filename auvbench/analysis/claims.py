"""Judge the seven claims of the original study from the available runs: `auvbench report --study thesis`.

docs/claims.md states each claim's test. A claim holds if all of its parts hold (Berger 1982, Technometrics
24:295), and fails if one part fails. Each part is tested for "holds" at the report's confidence. For "does not
hold", the error rate is divided among the parts (Bonferroni).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from auvbench.analysis import thesis
from auvbench.analysis.evidence import (
    FAILS,
    HOLDS,
    OPEN,
    Evidence,
    Learning,
    Part,
    Point,
    by_interval,
    by_trend,
    independent,
    partial_rank_correlation,
    together,
    trend,
)
from auvbench.analysis.findings import matched, mean_difference
from auvbench.analysis.formatting import amount, counted, difference, listed
from auvbench.analysis.measures import measure
from auvbench.analysis.pairwise import all_pairs, rank_intervals
from auvbench.analysis.records import Agent, ClaimVerdict, RunRecord, budget_of, learns, run_ids
from auvbench.analysis.thesis import cell
from auvbench.analysis.typical import Typical
from auvbench.statistics import limits, p_more_than_half
from auvbench.statistics.intervals import Estimate
from auvbench.statistics.typical import trainings_needed

KS = (1.0, 40.0, 100.0)
"""the original study's values of K"""
LEARNED = 0.15
"""test success above which a run has learned; ten runs of only 3000 and 5000 steps reached 0.2 to 8.4 %"""
SUCCESS_MARGIN = 0.05
"""claim 3: smallest increase of the success rate from the smallest to the largest K that contradicts the claim"""
GENERALISES = 0.8
"""claim 5: success rate above which a training generalises; the claim holds if the best training's lower limit exceeds it"""
WEAK = 0.5
"""claim 6: absolute rank correlation below which two measures count as uncorrelated"""
FEWEST_AGENTS = 5
"""claim 6: smallest number of agents for a correlation"""
DIFFER_IN_K = "evaluated SAC agents that differ in K at equal frequency"


def averaged(
    pairs: Sequence[tuple[Agent, Agent]],
    what: str,
    levels: tuple[float, float],
    absent: str,
    above: float = 0.0,
    *,
    less: bool = False,
) -> Part:
    """Return one part of a claim: the comparison of the first and second agent's success, over pairs of agents.

    The part holds if the difference between typical trainings (first - second), averaged over the pairs, is above
    the bound `above`. With `less`, the part holds if the difference is below this bound.

    Args:
        pairs: pairs of agents in matched cells.
        what: beginning of the sentence with the result.
        levels: confidences of the intervals for "holds" and "does not hold".
        absent: text that names the missing agents if there is no pair.
        above: bound of the difference.
        less: whether the difference must be below the bound.
    """
    if not pairs:
        return Part(OPEN, missing=absent)
    pairs_used = [pair for pair in pairs if informative(pair)]
    omitted = _left_out(len(pairs) - len(pairs_used), "cell")
    if not pairs_used:
        return Part(OPEN, missing=f"{absent} that are evidence{omitted}", run_ids=run_ids(*pairs))
    m = measure("success_rate")
    verdict = by_interval(lambda c: mean_difference(pairs_used, m, c)[0], levels, above, less=less)
    shown = difference(mean_difference(pairs_used, m, levels[0])[0], m)
    few = few_trainings([agent for pair in pairs_used for agent in pair], levels)
    statistic = f"{what} {shown} over {counted(len(pairs_used), 'matched cell')}{omitted}{few}"
    missing = _more_seeds([agent for pair in pairs_used for agent in pair]) if verdict == OPEN else ""
    return Part(verdict, statistic, missing, run_ids(*pairs_used))


def few_trainings(agents: Sequence[Agent], levels: tuple[float, float]) -> str:
    """Return a remark on the assumption that an interval from few trainings makes; '' if the trainings are enough."""
    fewest, needed = min(len(agent.outcome) for agent in agents), trainings_needed(1, 1 - levels[0])
    return (
        f" (fewer than {needed} trainings: assumes that they cluster around the typical one)"
        if fewest < needed
        else ""
    )


def informative(agents: Sequence[Agent]) -> bool:
    """Return whether a comparison of agents is evidence: several seeds, equal budgets, and at least one agent
    that learned.
    """
    trained = [agent for agent in agents if learns(agent)]
    budgets = {budget_of(run) for agent in trained for run in agent.runs}
    several = all(len(agent.outcome) > 1 for agent in trained)
    return several and len(budgets) <= 1 and any(map(learned, agents))


def learned(agent: Agent) -> bool:
    """Return whether the best run of an agent succeeds more often than is plausible without training."""
    return bool(agent.success.mean(axis=1).max() > LEARNED)


def _left_out(n: int, noun: str) -> str:
    why = "one training seed, unequal budgets, or nothing learned"
    return f"; {counted(n, noun)} left out: {why}" if n else ""


def _more_seeds(agents: Sequence[Agent]) -> str:
    fewest = min(len(agent.outcome) for agent in agents)
    return f"an interval that excludes the bound; the fewest seeds of a cell are {fewest}"


def no_convergence_at_55_hz(e: Evidence) -> list[Part]:
    """Claim 1: for every K, fewer than half of the SAC trainings at 55 Hz converge within 1,000,000 steps.

    The claim holds if for each K the upper limit of the probability of convergence is below one half. It fails
    if the lower limit is above one half for some K, or for the runs of all K together. All limits are exact
    binomial limits. The limits for "fails" have Bonferroni's correction.
    """
    alpha = 1 - e.confidence
    runs = [run for run in e.sac if run.frequency == thesis.HIGH_FREQUENCY]
    if not runs:
        return [Part(OPEN, missing="training records of SAC at 55 Hz")]
    ids = tuple(run.run.id for run in runs)
    full = [run for run in runs if run.steps >= thesis.STEPS]
    missing = e.unattainable(runs)
    if short := len(runs) - len(full):
        missing.append(f"{thesis.STEPS:,} training steps in {counted(short, 'run')} of fewer")
    if not full:
        return [Part(OPEN, missing="; ".join(missing), run_ids=ids)]
    converged = {k: [run.converged for run in full if run.k == k] for k in sorted({run.k for run in full})}
    counts = {k: (sum(flags), len(flags)) for k, flags in converged.items()}
    if absent := sorted(set(KS) - counts.keys()):
        missing.append(f"runs of that length with K={listed([f'{k:g}' for k in absent])}")
    upper = {k: limits(x, n, alpha)[1] for k, (x, n) in counts.items()}
    shown = ", ".join(f"K={k:g}: {x} of {n} (at most {100 * upper[k]:.0f} %)" for k, (x, n) in counts.items())
    statistic = f"converged: {shown}, with {100 * e.confidence:g} % confidence each"
    tests = [*counts.values(), (sum(x for x, _ in counts.values()), len(full))]
    if any(p_more_than_half(x, n) < alpha / len(tests) for x, n in tests):
        return [Part(FAILS, statistic, run_ids=ids)]
    if few := [f"{k:g}" for k, limit in upper.items() if limit >= 0.5]:
        missing.append(f"more training seeds with K={listed(few)} (five that do not converge are enough)")
    return [Part(OPEN if missing else HOLDS, statistic, "; ".join(missing), ids)]


def lower_frequency_converges_sooner(e: Evidence) -> list[Part]:
    """Claim 2: of two SAC runs with equal K, the run at the lower frequency converges in fewer steps.

    A permutation test judges the claim (`evidence.trend`).

    Two tests must agree. The first judges each run within its own time limit, which favours the run with the
    longer limit. The second judges all runs of a K within the shortest of their limits, which favours the run
    that was trained with this limit.
    """
    judged = [run for run in e.sac if e.attainable(run.limit)]
    ids = tuple(run.run.id for run in judged)
    tests = []
    for own, what in (
        (False, "converges sooner within one time limit in"),
        (True, "converges sooner within its own limit in"),
    ):
        result = trend(_dates(judged, own), e.seed)
        if result is not None:
            tests.append(by_trend(result, f"the lower frequency {what}", e.levels(1), ids))
    if len(tests) < 2:
        missing = ["SAC runs that differ in frequency at equal K and converge", *e.unattainable(e.sac)]
        return [Part(OPEN, missing="; ".join(missing), run_ids=ids)]
    part = replace(tests[0], statistic="; ".join(test.statistic for test in tests))
    if tests[0].verdict != tests[1].verdict:
        part = replace(part, verdict=OPEN, missing="time limits with which both tests agree")
    if omitted := len(e.sac) - len(judged):
        note = f"left out: {counted(omitted, 'run')} whose time limit no policy meets"
        part = replace(part, statistic=f"{part.statistic}; {note}")
    return [part]


def _dates(runs: Sequence[Learning], own: bool) -> list[Point]:
    """Return (K, -frequency, -steps to convergence) per run.

    If `own` is true, each run must converge within its own time limit. If `own` is false, each run must converge
    within the shortest time limit of all runs with the same K. A K without a converged run is left out.
    """
    points: list[Point] = []
    for k in sorted({run.k for run in runs}):
        members = [run for run in runs if run.k == k]
        # Equal budgets: a run counts as not converged if it needed more steps than the shortest training with this K.
        budget = min(run.steps for run in members)
        limit = min(run.limit for run in members)
        dates = [run.converged_at(run.limit if own else limit) for run in members]
        when = [date if date <= budget else np.inf for date in dates]
        if np.isfinite(when).any():
            points += [(f"{k:g}", -run.frequency, -at) for run, at in zip(members, when, strict=True)]
    return points


def larger_k_raises_reward_not_success(e: Evidence) -> list[Part]:
    """Claim 3: at equal frequency, agents with the largest K do not succeed more often than agents with the smallest K.

    The verdict is never "holds", because rewards of different K are not comparable: K scales the reward.
    """
    pairs, low, high = _extremes(e.of("sac"))
    what = f"K={high:g} against K={low:g}: success (margin {100 * SUCCESS_MARGIN:g} points)"
    part = averaged(pairs, what, e.levels(1), DIFFER_IN_K, SUCCESS_MARGIN, less=True)
    if part.verdict == HOLDS:
        part = replace(part, verdict=OPEN, missing="a reward that compares: K scales that of equal motion")
    return [part]


def sac4_is_best(e: Evidence) -> list[Part]:
    """Claim 4: SAC with K = 1 at 25 Hz is the best SAC agent (rank interval 1 to 1), and SAC agents with the smallest
    K succeed more often than SAC agents with the largest K.
    """
    levels = e.levels(2)
    pairs, low, high = _extremes(e.of("sac"))
    turned = [(small, large) for large, small in pairs]
    what = f"success with K={low:g} less that with K={high:g}:"
    return [_first_of_its_kind(e.of("sac"), levels), averaged(turned, what, levels, DIFFER_IN_K)]


def _first_of_its_kind(agents: Sequence[Agent], levels: tuple[float, float]) -> Part:
    of_cell = [agent for agent in agents if cell(agent) == thesis.CELLS["4"]]
    replicated = [agent for agent in agents if len(agent.outcome) > 1]
    ids = run_ids(of_cell)
    if len(of_cell) != 1 or of_cell[0] not in replicated or len(replicated) < 2:
        needed = "several training seeds of SAC with K=1 at 25 Hz and in other cells"
        return Part(OPEN, missing=needed, run_ids=ids)
    if len({budget_of(run) for agent in replicated for run in agent.runs}) > 1:
        return Part(OPEN, missing="equal training budgets of the SAC agents", run_ids=run_ids(replicated))
    tests = all_pairs(replicated, measure("success_rate"), np.ones(len(replicated), dtype=bool), levels[0])
    place, value = replicated.index(of_cell[0]), tests.typical.value
    first, last = rank_intervals(value, tests.resolved)[place]
    ahead = rank_intervals(value, tests.adjusted < 1 - levels[1])[place][0]
    rank = 1 + int((value > value[place]).sum())
    statistic = f"{of_cell[0].label} has rank {rank} of {len(replicated)}, interval {first} to {last}"
    if ahead > 1:
        return Part(FAILS, statistic, run_ids=ids)
    absent = sorted({thesis.CELLS[i] for i in "01234567"} - {cell(agent) for agent in replicated})
    if last == 1 and not absent:
        return Part(HOLDS, statistic, run_ids=ids)
    cells = listed([f"K={k:g} {f:g} Hz" for k, f in absent], 8)
    missing = f"several seeds in the original study's cells {cells}" if absent else "a resolved first place"
    return Part(OPEN, statistic, missing, ids)


def _extremes(agents: Sequence[Agent]) -> tuple[list[tuple[Agent, Agent]], float, float]:
    """Return pairs of agents (largest K, smallest K) that differ only in K, then the smallest and the largest K.

    If K does not vary, the list of pairs is empty, and both values of K are NaN.
    """
    ks = sorted({cell(agent)[0] for agent in agents if np.isfinite(cell(agent)[0])})
    if len(ks) < 2:
        return [], np.nan, np.nan
    return matched(agents, "reward.k", ks[-1], ks[0]), ks[0], ks[-1]


def agents_that_did_not_converge_generalise(e: Evidence) -> list[Part]:
    """Claim 5: some SAC run that did not converge succeeds in more than 80 % of the test episodes.

    The claim fails if no such run succeeds so often, and if the upper limit of the share of trainings that do is
    below one half. A run is used only if it has at least 1,000,000 steps, and if some tested policy meets the
    criterion of convergence within the run's time limit (`Evidence.attainable`).
    """
    tested = {
        run.id: (float(agent.success[i].mean()), agent.outcome.shape[1])
        for agent in e.of("sac")
        for i, run in enumerate(agent.runs)
    }
    full = [run for run in e.sac if not run.converged and run.steps >= thesis.STEPS]
    judged = [run for run in full if run.run.id in tested and e.attainable(run.limit)]
    missing = f"evaluated SAC runs that did not converge in {thesis.STEPS:,} steps"
    if not judged:
        return [Part(OPEN, missing="; ".join([missing, *e.unattainable(full)]))]
    yes, no = e.levels(1)
    rates = [tested[run.run.id] for run in judged]
    best, n = max(rates)
    # The best of several runs is a biased choice, so Bonferroni's correction covers all these runs.
    low, high = limits(best * n, n, (1 - yes) / 2 / len(rates))
    reach = sum(x > GENERALISES for x, _ in rates)
    share = limits(reach, len(rates), (1 - no) / 2)[1]
    verdict = HOLDS if low > GENERALISES else FAILS if reach == 0 and share < 0.5 else OPEN
    text = amount(Estimate(best, low, high), measure("success_rate"))
    statistic = (
        f"the best of {counted(len(rates), 'run')} that did not converge succeeds in {text}; {reach} of the {len(rates)} "
        f"succeed in more than {100 * GENERALISES:g} % of the episodes (upper limit for all trainings that do not converge: "
        f"{100 * share:.0f} %)"
    )
    ids = tuple(run.run.id for run in judged)
    return [Part(verdict, statistic, f"more {missing}" if verdict == OPEN else "", ids)]


def straightness_and_steps(e: Evidence) -> list[Part]:
    """Claim 6: over the agents that learned, straightness and steps do not correlate at equal failure rates.

    A failed episode is long and crooked, so both measures correlate with the failure rate. The test uses the
    partial rank correlation of mean deviation and mean steps given the failure rate. The claim holds if the
    whole interval of the correlation is within ±0.5; otherwise it fails if the interval excludes 0.
    """
    needed = ("deviation_mean_m", "steps")
    agents = [a for a in e.agents if learns(a) and learned(a) and all(name in a.metrics for name in needed)]
    if len(agents) < FEWEST_AGENTS:
        missing = f"{FEWEST_AGENTS} agents that learned something, with both measures (here {len(agents)})"
        return [Part(OPEN, missing=missing)]
    deviation, steps = (np.array([np.nanmean(agent.metrics[name]) for agent in agents]) for name in needed)
    failing = np.array([1 - float(agent.success.mean()) for agent in agents])
    n = independent(agents)
    rho = partial_rank_correlation(deviation, steps, failing, n, e.confidence)
    inside = rho.low > -WEAK and rho.high < WEAK
    verdict = HOLDS if inside else FAILS if rho.low > 0 or rho.high < 0 else OPEN
    shared = f", of which {n} are independent (they share settings)" if n < len(agents) else ""
    statistic = (
        f"Spearman's rho given the failure rate {rho.value:.2f} [{rho.low:.2f}, {rho.high:.2f}] over {len(agents)} "
        f"agents{shared}; no correlation means within ±{WEAK:g}"
    )
    missing = f"more agents: the interval is wider than ±{WEAK:g}" if verdict == OPEN else ""
    return [Part(verdict, statistic, missing, run_ids(agents))]


def sac_is_more_robust_to_frequency(e: Evidence) -> list[Part]:
    """Claim 7: from the lowest to the highest frequency SAC loses less success than PPO, PPO beats SAC at 10 Hz,
    and PPO fails at 25 Hz.
    """
    levels = e.levels(3)
    sac, ppo = ({cell(agent): agent for agent in e.of(family)} for family in ("sac", "ppo"))
    cells = sorted(set(sac) & set(ppo))
    at_10 = [(ppo[settings], sac[settings]) for settings in cells if settings[1] == 10.0]
    absent = "evaluated SAC and PPO agents at 10 Hz with equal K"
    return [
        _interaction(sac, ppo, cells, levels),
        averaged(at_10, "PPO less SAC at 10 Hz: success", levels, absent),
        _ppo_fails(ppo.get(thesis.CELLS["4"]), levels),
    ]


def _interaction(
    sac: dict[tuple[float, float], Agent],
    ppo: dict[tuple[float, float], Agent],
    cells: Sequence[tuple[float, float]],
    levels: tuple[float, float],
) -> Part:
    """Judge this part of claim 7: from the lowest to the highest frequency, SAC loses less success than PPO.

    The tested number is (SAC high - SAC low) - (PPO high - PPO low), averaged over K. A K is left out if its agents are
    not evidence (`informative`), or if SAC or PPO learned nothing at the low frequency: an agent without success
    cannot lose any.
    """
    frequencies = sorted({f for _, f in cells})
    if len(frequencies) < 2:
        return Part(OPEN, missing="evaluated SAC and PPO agents at two frequencies with equal K")
    low, high = frequencies[0], frequencies[-1]
    ks = [k for k in sorted({k for k, _ in cells}) if {(k, low), (k, high)} <= set(cells)]
    fours = [(sac[k, high], sac[k, low], ppo[k, high], ppo[k, low]) for k in ks]
    informative_fours = [
        four
        for four in fours
        if informative(four[:2]) and informative(four[2:]) and learned(four[1]) and learned(four[3])
    ]
    omitted = _left_out(len(fours) - len(informative_fours), "value") + (
        f" at {low:g} Hz" if len(informative_fours) < len(fours) else ""
    )
    if not informative_fours:
        return Part(OPEN, missing=f"SAC and PPO agents at two frequencies that are evidence{omitted}")
    m, used = measure("success_rate"), [agent for four in informative_fours for agent in four]
    typical = Typical(used, m)
    weights = dict(
        enumerate(np.tile([1.0, -1.0, -1.0, 1.0], len(informative_fours)) / len(informative_fours))
    )
    verdict = by_interval(lambda c: typical.contrast(weights, 1 - c), levels, 0.0)
    shown = difference(typical.contrast(weights, 1 - levels[0]), m)
    statistic = (
        f"from {low:g} to {high:g} Hz the success of SAC's typical training changes by {shown} more than PPO's, over "
        f"{counted(len(informative_fours), 'value')} of K{omitted}{few_trainings(used, levels)}"
    )
    return Part(verdict, statistic, _more_seeds(used) if verdict == OPEN else "", run_ids(used))


def _ppo_fails(agent: Agent | None, levels: tuple[float, float]) -> Part:
    """Judge this part of claim 7: PPO with K = 1 at 25 Hz succeeds in less than half of the test episodes.

    If trainings with fewer steps than in the original study fail, this is not evidence for the claim.
    """
    if agent is None or len(agent.outcome) < 2:
        return Part(OPEN, missing="several training seeds of PPO with K=1 at 25 Hz")
    m = measure("success_rate")
    typical = Typical([agent], m)
    verdict = by_interval(lambda c: typical.contrast({0: 1.0}, 1 - c), levels, 0.5, less=True)
    steps = min(int(run.manifest.get("steps") or 0) for run in agent.runs)
    statistic = (
        f"the typical training of PPO with K=1 at 25 Hz succeeds in {amount(typical.contrast({0: 1.0}, 1 - levels[0]), m)}, "
        f"failing means below half{few_trainings([agent], levels)}"
    )
    missing = _more_seeds([agent]) if verdict == OPEN else ""
    if verdict == HOLDS and steps < thesis.STEPS:
        verdict, missing = OPEN, f"{thesis.STEPS:,} training steps (here {steps:,})"
    return Part(verdict, statistic, missing, run_ids([agent]))


CLAIMS: tuple[tuple[str, Callable[[Evidence], list[Part]]], ...] = (
    ("In training at 55 Hz the agent (SAC) does not converge for any K.", no_convergence_at_55_hz),
    (
        "At equal K, a lower training frequency converges in fewer training steps (SAC).",
        lower_frequency_converges_sooner,
    ),
    (
        "A larger K raises the episode reward and not the success: of the best-rewarded episodes more are failures.",
        larger_k_raises_reward_not_success,
    ),
    (
        "SAC with K=1 at 25 Hz (SAC4) is the best SAC agent in testing, and a lower K goes with higher success.",
        sac4_is_best,
    ),
    (
        "Agents that did not converge in training can generalise: convergence does not predict test success (SAC).",
        agents_that_did_not_converge_generalise,
    ),
    ("Path straightness and step count do not correlate.", straightness_and_steps),
    (
        "SAC is more robust than PPO to a high frequency; PPO at 10 Hz beats SAC at 10 Hz, PPO at 25 Hz fails.",
        sac_is_more_robust_to_frequency,
    ),
)
"""Claims of the original study: the text of each, and the function that judges it"""


def judge(
    runs: Sequence[RunRecord], agents: Sequence[Agent], *, confidence: float = 0.95, seed: int = 0
) -> list[ClaimVerdict]:
    """Return each claim with its verdict: holds, does not hold, or cannot be said (with the missing evidence).

    Args:
        runs: all runs, for their training records; unfinished runs are left out.
        agents: evaluated agents of one condition, grouped only by algorithm, K and frequency.
        confidence: confidence of every interval.
        seed: seed of the permutations.
    """
    evidence = Evidence(runs, agents, confidence, seed)
    return [together(text, parts(evidence)) for text, parts in CLAIMS]
