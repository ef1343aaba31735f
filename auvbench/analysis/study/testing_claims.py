"""The claims of the original study that test evaluations decide: 3, 4 and 7 (`straightness` has 6). Each function returns the claim's parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from auvbench.analysis.formatting import amount, counted, difference, listed
from auvbench.analysis.measures import measure
from auvbench.analysis.pairwise import all_pairs, rank_intervals
from auvbench.analysis.records import Agent
from auvbench.analysis.study import thesis
from auvbench.analysis.study.evidence import Evidence, cell, cell_of_run
from auvbench.analysis.study.trend import Point, Trend, trend
from auvbench.analysis.study.verdict import (
    FAILS,
    HOLDS,
    OPEN,
    Levels,
    Part,
    averaged,
    budget,
    by_interval,
    by_trend,
    extremes,
    informative,
    learned,
    more_seeds,
    runs_of,
)
from auvbench.statistics import contrast, crossed, means
from auvbench.statistics.intervals import Estimate

SUCCESS_MARGIN = 0.05
"""claim 3: a gain in the success rate below this does not count as one"""
DIFFER_IN_K = "evaluated SAC agents that differ in K at equal frequency"


def larger_k_raises_reward_not_success(e: Evidence) -> list[Part]:
    """3: largest against smallest K at equal frequency: more reward at equal K, no more success, top episodes fail."""
    levels = Levels.of(e.confidence, 3)
    pairs, low, high = extremes(e.of("sac"))
    name = f"K={high:g} against K={low:g}:" if pairs else ""
    bound = f"success (margin {100 * SUCCESS_MARGIN:g} points)"
    reward = _more_reward(e, pairs, high, name, levels)
    success = averaged(
        pairs, "success_rate", f"{name} {bound}", levels, DIFFER_IN_K, SUCCESS_MARGIN, less=True
    )
    if success.verdict == HOLDS and reward.verdict != HOLDS:
        # A policy that learns nothing gains no success from a larger K either.
        success = replace(success, verdict=OPEN, missing="a reward that K raises (a)")
    return [reward, success, _top_fails(e, levels)]


def _more_reward(
    e: Evidence, pairs: Sequence[tuple[Agent, Agent]], k: float, name: str, levels: Levels
) -> Part:
    """What the agents of the larger K collect more than those of the smaller, both paid with the larger."""
    if not pairs:
        return Part(OPEN, missing=DIFFER_IN_K)
    kept, left = informative(pairs)
    paid = {id(agent): e.collected(agent, k) for group in kept for agent in group}
    several = [group for group in kept if all(paid[id(agent)] is not None for agent in group)]
    if len(several) < len(kept):
        left.append(
            f"{counted(len(kept) - len(several), 'cell')} left out: no kept paths of all its test runs"
        )
    data = [paid[id(agent)] for group in several for agent in group]
    shapes = {x.shape[1] for x in data if x is not None}
    if not several or len(shapes) != 1 or min(shapes) < 2:
        absent = f"{DIFFER_IN_K} that are evidence, with the paths of the same test episodes"
        return Part(OPEN, missing="; ".join([absent, *left]), run_ids=runs_of(pairs))
    weights = np.tile([1.0, -1.0], len(several)) / len(several)
    table = crossed([x for x in data if x is not None])

    def at(confidence: float) -> Estimate:
        return contrast(table, weights, confidence).estimate

    verdict = by_interval(at, levels, 0.0)
    m = measure("mean_return")
    statistic = "; ".join(
        [
            f"{name} reward collected in {shapes.pop()} test episodes, both paid with K={k:g}, "
            f"{difference(at(levels.holds), m)} over {counted(len(several), 'matched cell')}",
            *left,
        ]
    )
    missing = more_seeds([agent for group in several for agent in group]) if verdict == OPEN else ""
    return Part(verdict, statistic, missing, runs_of(several))


def _top_fails(e: Evidence, levels: Levels) -> Part:
    """Of the best-rewarded training episodes more fail at a larger K, among frequencies at which some run succeeds."""
    absent = "training records of SAC that differ in K at equal frequency"
    runs = e.learnings("sac")
    succeeding = {cell_of_run(run.run)[1] for run in runs if run.failing_top < 1}
    used = [run for run in runs if cell_of_run(run.run)[1] in succeeding]
    points: list[Point] = [
        (f"{cell_of_run(run.run)[1]:g}", cell_of_run(run.run)[0], run.failing_top) for run in used
    ]
    found = trend(points, e.confidence, e.seed)
    if found is None:
        why = " in which some training episodes succeed" if runs and not used else ""
        return Part(OPEN, missing=f"{absent}{why}")
    what = "of the tenth of training episodes with the highest return more fail at the larger K in"
    part = by_trend(found, what, levels, tuple(run.run.id for run in used))
    if part.verdict != HOLDS:
        return part
    frozen = _frozen_top_fails(e, sorted({cell_of_run(run.run)[0] for run in used}))
    if frozen is None:
        return replace(part, verdict=OPEN, missing="kept test paths, for the control with frozen policies")
    control = by_trend(frozen, "frozen policies, paid with each K in turn, show it in", levels, ())
    if control.verdict != HOLDS:
        return part
    missing = "an effect beyond that of the reward alone, which frozen policies show"
    return replace(part, verdict=OPEN, statistic=f"{part.statistic}; {control.statistic}", missing=missing)


def _frozen_top_fails(e: Evidence, ks: Sequence[float]) -> Trend | None:
    """Return the trend with K of the failing share of frozen agents' best-paid test episodes; None without paths.

    An agent of which all test episodes, or none, succeed is left out: K cannot change its share.
    """
    mixed = [agent for agent in e.of("sac") if 0 < agent.success.mean() < 1]
    shares = [(agent.label, e.failing_top_by_k(agent, ks)) for agent in mixed]
    points = [(label, k, share) for label, found in shares if found is not None for k, share in found.items()]
    return trend(points, e.confidence, e.seed)


def sac4_is_best(e: Evidence) -> list[Part]:
    """4: SAC with K = 1 at 25 Hz is first of the SAC agents, resolved; and K = 1 succeeds more than the largest K."""
    levels = Levels.of(e.confidence, 2)
    agents = e.of("sac")
    pairs, low, high = extremes(agents)
    turned = [(small, large) for large, small in pairs]
    what = f"success with K={low:g} less that with K={high:g}:" if pairs else ""
    return [
        _first_of_its_kind(e, agents, levels),
        averaged(turned, "success_rate", what, levels, DIFFER_IN_K),
    ]


def _first_of_its_kind(e: Evidence, agents: Sequence[Agent], levels: Levels) -> Part:
    mine = [agent for agent in agents if cell(agent) == thesis.CELLS["4"]]
    several = [agent for agent in agents if len(agent.outcome) > 1]
    if len(mine) != 1 or len(agents) < 2:
        return Part(OPEN, missing="evaluated SAC agents with K=1 at 25 Hz and in other cells")
    if mine[0] not in several or len(several) < 2:
        missing = "several training seeds of SAC with K=1 at 25 Hz and in other cells"
        return Part(OPEN, missing=missing, run_ids=runs_of([(mine[0],)]))
    if len({budget(agent) for agent in several}) > 1:
        missing = "equal training budgets of the SAC agents"
        return Part(OPEN, missing=missing, run_ids=runs_of([tuple(several)]))
    tests = all_pairs(several, measure("success_rate"), np.ones(len(several), dtype=bool), levels.holds)
    place, value = several.index(mine[0]), tests.table.mean
    (first, last), (ahead, _) = (
        rank_intervals(value, tests.adjusted < 1 - confidence)[place]
        for confidence in (levels.holds, levels.fails)
    )
    label, ids, behind = mine[0].label, runs_of([(mine[0],)]), ahead > 1
    rank = 1 + int((value > value[place]).sum())
    statistic = f"{label} has rank {rank} of {len(several)}, interval {first} to {last}"
    shown = {thesis.CELLS[i] for i in "01234567"}
    absent = sorted(shown - {cell(agent) for agent in several})
    cells = listed([f"K={k:g} {f:g} Hz" for k, f in absent], 8)
    missing = f"several seeds in the original study's cells {cells}" if absent else ""
    if behind:
        return Part(FAILS, statistic, run_ids=ids)
    if last == 1 and not absent:
        return Part(HOLDS, statistic, run_ids=ids)
    return Part(OPEN, statistic, missing or "a resolved first place", ids)


def sac_is_more_robust_to_frequency(e: Evidence) -> list[Part]:
    """7: SAC loses less from the lowest to the highest frequency; PPO beats SAC at 10 Hz; PPO fails at 25 Hz."""
    levels = Levels.of(e.confidence, 3)
    sac, ppo = ({cell(agent): agent for agent in e.of(family)} for family in ("sac", "ppo"))
    both = sorted(set(sac) & set(ppo))
    at_10 = [(ppo[c], sac[c]) for c in both if c[1] == 10.0]
    absent = "evaluated SAC and PPO agents at 10 Hz with equal K"
    return [
        _interaction(sac, ppo, both, levels),
        averaged(at_10, "success_rate", "PPO less SAC at 10 Hz: success", levels, absent),
        _ppo_fails(ppo.get(thesis.CELLS["4"]), levels),
    ]


def _ppo_fails(agent: Agent | None, levels: Levels) -> Part:
    """PPO with K = 1 at 25 Hz succeeds in less than half; with less than the original study's budget that is no failure."""
    if agent is None:
        return Part(OPEN, missing="an evaluated PPO agent with K=1 at 25 Hz")
    runs = runs_of([(agent,)])
    if len(agent.outcome) < 2:
        return Part(OPEN, missing="several training seeds of PPO with K=1 at 25 Hz", run_ids=runs)
    m = measure("success_rate")
    table = m.table([agent])
    verdict = by_interval(lambda c: means(table, c)[0], levels, 0.5, less=True)
    steps = min(int(run.manifest.get("steps") or 0) for run in agent.runs)
    statistic = f"PPO with K=1 at 25 Hz succeeds in {amount(means(table, levels.holds)[0], m)}, failing means below half"
    if verdict == HOLDS and steps < thesis.STEPS:
        return Part(OPEN, statistic, f"{thesis.STEPS:,} training steps (here {steps:,})", runs)
    return Part(verdict, statistic, more_seeds([agent]) if verdict == OPEN else "", runs)


def _interaction(
    sac: dict[tuple[float, float], Agent],
    ppo: dict[tuple[float, float], Agent],
    both: Sequence[tuple[float, float]],
    levels: Levels,
) -> Part:
    """(SAC high - SAC low) - (PPO high - PPO low) in success, averaged over K.

    Of a K at which one of the two learned nothing at the low frequency nothing is said: it has nothing to lose.
    """
    frequencies = sorted({f for _, f in both})
    ends = [
        (k, frequencies[0], frequencies[-1])
        for k in sorted({k for k, _ in both})
        if {(k, frequencies[0]), (k, frequencies[-1])} <= set(both)
    ]
    if len(frequencies) < 2 or not ends:
        return Part(OPEN, missing="evaluated SAC and PPO agents at two frequencies with equal K")
    used: list[Agent] = []
    kept, left = 0, 0
    for k, low, high in ends:
        four = [sac[k, high], sac[k, low], ppo[k, high], ppo[k, low]]
        alike = informative([(four[0], four[1]), (four[2], four[3])])[0]
        if len(alike) == 2 and learned(four[1]) and learned(four[3]):
            used += four
            kept += 1
        else:
            left += 1
    note = f"{counted(left, 'value')} of K left out: one seed, unequal budgets or nothing learned at {ends[0][1]:g} Hz"
    if not used:
        return Part(OPEN, missing=f"SAC and PPO agents at two frequencies that are evidence; {note}")
    m = measure("success_rate")
    table, weights = m.table(used), np.tile([1.0, -1.0, -1.0, 1.0], kept) / kept
    verdict = by_interval(lambda c: contrast(table, weights, c).estimate, levels, 0.0)
    shown = difference(contrast(table, weights, levels.holds).estimate, m)
    low, high = ends[0][1:]
    statistic = (
        f"from {low:g} to {high:g} Hz SAC's success changes by {shown} more than PPO's, over "
        f"{counted(kept, 'value')} of K{f'; {note}' if left else ''}"
    )
    return Part(verdict, statistic, more_seeds(used) if verdict == OPEN else "", runs_of([tuple(used)]))
