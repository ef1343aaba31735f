"""Sentences that the data generate: what the table says, quantified, and no more than it says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from auvbench.analysis.compute_cost import solves
from auvbench.analysis.effects import Effect, effects, learns
from auvbench.analysis.failures import failures
from auvbench.analysis.formatting import (
    amount,
    counted,
    difference,
    listed,
    name,
    p_value,
    probability,
    turned,
    unit,
)
from auvbench.analysis.labels import factor_name
from auvbench.analysis.measures import Measure, measure
from auvbench.analysis.model import Agent, Finding, Ranking, Row
from auvbench.analysis.pairwise import BETTER, EQUIVALENT, WORSE
from auvbench.analysis.planning import advice
from auvbench.analysis.robustness import robustness
from auvbench.analysis.timing import confounded, separated
from auvbench.analysis.train_test_gap import training_and_test
from auvbench.statistics import EPISODES_ONLY, holm
from auvbench.statistics.estimate import Estimate

MOST_TIES = 4
"""pairs named of those that the second measure resolves"""
MOST_EFFECTS = 8
"""that are not resolved and yet listed, the sharpest first"""


def sentences(ranking: Ranking, agents: Sequence[Agent]) -> list[Finding]:
    """What there is to say of a ranking and the agents behind it, most important first."""
    m = measure(ranking.rank_by)
    by_label = {agent.label: agent for agent in agents}
    ordered = [by_label[row.label] for row in ranking.rows]
    found = [
        _best(ranking, m),
        _resolved(ranking),
        _against_baseline(ranking, m),
        _ties(ranking),
        advice(ranking, ordered, m),
        *_effects(ranking, ordered, m),
        *robustness(ranking, ordered),
        *failures(ordered, ranking.confidence),
        solves(ordered, ranking.protocol, ranking.condition),
        *training_and_test(ranking, ordered),
        confounded(ordered),
        separated(ordered, m, ranking.confidence),
        _seeds(ordered, m),
        _single_seeds(ranking, ordered),
    ]
    return [finding for finding in found if finding is not None]


def _best(ranking: Ranking, m: Measure) -> Finding:
    row = ranking.rows[0]
    value = f"{name(m)} {amount(row.estimates[m.name], m)}"
    basis = counted(row.episodes, "test episode")
    if row.trained:
        runs = f"{len(row.seeds)} pooled runs" if row.pooled else counted(len(row.seeds), "training seed")
        basis = f"{runs} x {basis}"
    if len(ranking.rows) == 1:
        return Finding(f"{row.label} is the only agent: {value}.", statistic=basis, run_ids=row.run_ids)
    others = [r for r in ranking.rows[1:] if r.rank > row.rank]
    near = [r.label for r in others if r.compared and not ranking.resolved(row, r)]
    alone = [r.label for r in ranking.rows[1:] if not r.compared]
    together = [r.label for r in ranking.rows if r.rank == row.rank]
    verb = "is" if len(together) == 1 else "are"
    text = f"{row.label} is first, with {value}"
    if len(together) > 1 and row.compared:
        text = f"{listed(together)} share the first place, with {value}"
    if not row.compared:
        text += (
            ": one training, which says nothing of what another would give. The data do not say who is best."
        )
        return Finding(text, statistic=f"{basis}.", run_ids=row.run_ids)
    if alone:
        text += f", and {verb} not resolved from {listed(near)}" if near else ""
        have = "has one training seed and is" if len(alone) == 1 else "have one training seed each and are"
        text += f". {listed(alone)} {have} not compared with it: the data do not say who is best."
    elif not near:
        rest = "the only other agent" if len(others) == 1 else f"all {len(others)} others"
        text += f", and {verb} resolved from {rest}." if others else "."
    elif len(near) == len(others):
        text += f", but {verb} not resolved from any other agent: the data do not say who is best."
    else:
        text += f", but {verb} not resolved from {listed(near)}: the data leave open which of these is best."
    statistic = f"Rank {_range(row)}; {basis}."
    return Finding(text, statistic=statistic, run_ids=row.run_ids)


def _range(row: Row) -> str:
    first, last = row.rank_interval
    return f"{first}" if first == last else f"{first} to {last}"


def _resolved(ranking: Ranking) -> Finding | None:
    n = len(ranking.rows)
    if n < 3:
        return None
    tested = sum(row.compared for row in ranking.rows)
    if tested < 2:  # the first sentence says that nobody is compared
        return None
    neighbours = sum(ranking.resolved(a, b) for a, b in pairwise(ranking.rows))
    text = f"Of the {n - 1} steps from one place of the table to the next, {neighbours or 'none'} "
    text += f"{'is' if neighbours == 1 else 'are'} resolved: "
    if neighbours == n - 1:
        text += "the order is that of the table."
    elif neighbours:
        text += "across the others the order may be another."
    else:
        text += "any two neighbours may stand in the other order."
    percent = f"{100 * ranking.confidence:g} %"
    of = "agents" if tested == n else "agents with several training seeds or nothing to train"
    n_pairs = tested * (tested - 1) // 2
    pairs = f"all {n_pairs} pairs of {of}" if n_pairs != 1 else f"the one pair of {of}"
    return Finding(text, statistic=f"Tests of {pairs}, Holm-corrected, {percent} together.")


def _against_baseline(ranking: Ranking, m: Measure) -> Finding | None:
    if ranking.baseline is None or len(ranking.rows) < 2:
        return None
    better, worse, small, open_ = [], [], [], []
    for c in ranking.comparisons:
        if ranking.baseline not in (c.first, c.second):
            continue
        other = c.second if c.first == ranking.baseline else c.first
        of_other = turned(c.difference) if c.first == ranking.baseline else c.difference
        entry = (other, of_other)
        if c.verdict == EQUIVALENT:
            small.append(entry)
        elif not c.p_adjusted < 1 - ranking.confidence:
            open_.append(entry)
        elif of_other.value * m.sign > 0:
            better.append(entry)
        else:
            worse.append(entry)
    if not (better or worse or small or open_):
        return None
    parts = []
    for verb, entries in (("better", better), ("worse", worse)):
        if entries:
            label, most = max(entries, key=lambda entry: abs(entry[1].value))
            far = (
                f"; the furthest is {label} with {difference(most, m)}"
                if len(entries) > 1
                else f", {difference(most, m)}"
            )
            parts.append(
                f"{counted(len(entries), 'agent')} {verb} ({listed([e[0] for e in entries], 3)}{far})"
            )
    if small:
        parts.append(f"{len(small)} equivalent ({listed([e[0] for e in small], 3)})")
    if open_:
        parts.append(f"{len(open_)} not resolved ({listed([e[0] for e in open_], 3)})")
    text = f"Against the baseline {ranking.baseline}, in {name(m)}: {'; '.join(parts)}."
    n = len(better) + len(worse) + len(small) + len(open_)
    statistic = f"Holm over {counted(n, 'comparison')} with the baseline."
    return Finding(
        text,
        statistic=statistic,
        run_ids=next(r.run_ids for r in ranking.rows if r.label == ranking.baseline),
    )


def _ties(ranking: Ranking) -> Finding | None:
    """What the second measure says of the pairs that the first does not resolve."""
    if not ranking.ties:
        return None
    m = measure(ranking.then)
    apart = [c for c in ranking.ties if c.verdict in (BETTER, WORSE)]
    first = name(measure(ranking.rank_by))
    n = len(ranking.ties)
    pairs = "the one pair" if n == 1 else f"the {n} pairs"
    if not apart:
        text = f"{name(m)} does not resolve {pairs} that {first} leaves open."
        return Finding(f"{text[0].upper()}{text[1:]}", statistic="Holm over all pairs.")
    shown = []
    for c in apart[:MOST_TIES]:
        change, one, other = c.difference, c.first, c.second
        if c.verdict == WORSE:
            change, one, other = turned(c.difference), c.second, c.first
        shown.append(f"{one} is better than {other} ({difference(change, m)}, {p_value(c.p_adjusted)})")
    more = f"; and {len(apart) - MOST_TIES} more" if len(apart) > MOST_TIES else ""
    if n == 1:
        text = f"The one pair that {first} does not resolve is resolved by {name(m)}: {shown[0]}."
    else:
        text = f"Of {pairs} that {first} does not resolve, {name(m)} resolves {len(apart)}: {'; '.join(shown)}{more}."
    return Finding(text, statistic="Holm over all pairs, a family of its own.")


def _effects(ranking: Ranking, agents: Sequence[Agent], m: Measure) -> list[Finding]:
    """A sentence for each effect that is resolved, and one for all that are not."""
    confidence = ranking.confidence
    found = [_as_in_the_table(effect, ranking) for effect in effects(agents, m, confidence)]
    adjusted = holm([effect.p_value for effect in found])
    family = f"Holm over {counted(len(found), 'effect')}"
    resolved = [(e, float(p)) for e, p in zip(found, adjusted, strict=True) if p < 1 - confidence]
    open_ = [e for e, p in zip(found, adjusted, strict=True) if not p < 1 - confidence]
    result = []
    for effect, p in resolved:
        n = len(effect.pairs)
        cells = f"averaged over {n} matched cells" if n > 1 else "in the one matched cell"
        word = "better" if effect.difference.value * m.sign > 0 else "worse"
        change = difference(effect.difference, m)
        text = f"{effect.first} is {word} than {effect.second} in {name(m)}: {change}, {cells}."
        statistic = f"{p_value(p)}, {family}; {_covered(effect.difference)}."
        result.append(Finding(text, statistic=statistic, run_ids=_runs([effect])))
    if open_:
        factors = list(dict.fromkeys(factor_name(effect.factor) for effect in open_))
        other = "other " if resolved else ""
        text = f"No {other}effect of {listed(factors, word='or')} on {name(m)} is resolved."
        open_.sort(key=lambda effect: effect.difference.high - effect.difference.low)
        items = [_open(effect, m, confidence) for effect in open_[:MOST_EFFECTS]]
        if len(open_) > MOST_EFFECTS:
            items.append(f"{len(open_) - MOST_EFFECTS} more with wider intervals")
        cells = (
            "averaged over matched cells"
            if any(len(e.pairs) > 1 for e in open_)
            else "each in one matched cell"
        )
        statistic = f"{'; '.join(items)}. {family}, {cells}."
        result.append(Finding(text, statistic=statistic, run_ids=_runs(open_)))
    return result


def _as_in_the_table(effect: Effect, ranking: Ranking) -> Effect:
    """The effect with the interval and the p-value of the two agents' comparison, where it is of one pair alone.

    A difference has one interval on a page. (Pairs are tested with what all agents' seeds tell of how much seeds
    differ; an average over several pairs stands nowhere else.)
    """
    if len(effect.pairs) != 1:
        return effect
    first, second = (agent.label for agent in effect.pairs[0])
    for c in ranking.comparisons:
        if c.metric == ranking.rank_by and {c.first, c.second} == {first, second}:
            seen = c.difference if c.first == first else turned(c.difference)
            return replace(effect, difference=seen, p_value=c.p_value)
    return effect


def _open(effect: Effect, m: Measure, confidence: float) -> str:
    """An effect that is not resolved, in a list: what the data leave possible is in its interval."""
    text = f"{effect.first} against {effect.second} {difference(effect.difference, m)}"
    return f"{text}, resolved if it were the only one" if effect.p_value < 1 - confidence else text


def _runs(found: Sequence[Effect]) -> tuple[str, ...]:
    return tuple(
        dict.fromkeys(run.id for e in found for pair in e.pairs for agent in pair for run in agent.runs)
    )


def _covered(estimate: Estimate) -> str:
    return f"the interval covers {estimate.covers}" + (" only" if estimate.covers == EPISODES_ONLY else "")


def _seeds(agents: Sequence[Agent], m: Measure) -> Finding | None:
    several = [agent for agent in agents if len(agent.outcome) > 1 and np.isfinite(m.values(agent)).all()]
    if not several:
        return None
    means = [m.values(agent).mean(axis=1) for agent in several]
    ranges = np.array([x.max() - x.min() for x in means])
    widest = int(ranges.argmax())
    table = m.table(several, paired=False)
    if not (table.variance > 0).any():
        return None
    agent, n = several[widest], len(several)
    low, high = means[widest].min(), means[widest].max()
    text = f"Training seeds of {agent.label} differ {'most ' * (n > 1)}in {name(m)}: {_plain(low, m)} to {_plain(high, m)}{unit(m)}"
    if n == 2:
        other = 1 - widest
        text += f"; those of {several[other].label} by {_apart(ranges[other], m)}"
    elif n > 2:
        text += f"; half of the {n} agents by {_apart(float(np.median(ranges)), m)} or less"
    statistic = ""
    if table.variance[widest] > 0:
        share = max(float(table.between_seeds[widest] - table.residual[widest]), 0.0) / float(
            table.variance[widest]
        )
        statistic = (
            f"{probability(share)} of the variance of {agent.label}'s {name(m)} is between training seeds"
        )
        statistic += ": more seeds would tell more than more episodes." if share > 0.5 else "."
    return Finding(f"{text}.", statistic=statistic, run_ids=tuple(run.id for run in agent.runs))


def _plain(value: float, m: Measure) -> str:
    return f"{100 * value:.1f}" if m.rate else f"{value:.4g}"


def _apart(value: float, m: Measure) -> str:
    """A range: '94.0 points'."""
    return f"{_plain(value, m)}{' points' if m.rate else unit(m)}"


def _single_seeds(ranking: Ranking, agents: Sequence[Agent]) -> Finding | None:
    single = [agent.label for agent in agents if len(agent.outcome) == 1 and learns(agent)]
    if ranking.compare == "policies":
        return Finding("Rows are single policies: nothing here speaks of the algorithms that trained them.")
    if not single:
        return None
    who = (
        "Every trained agent has"
        if len(single) == sum(learns(a) for a in agents)
        else f"{listed(single)} have"
    )
    if len(single) == 1:
        who = f"{single[0]} has"
    text = (
        f"{who} one training seed: a row of one seed describes that policy, and is not compared with others."
    )
    more = f"More seeds: {ranking.more_seeds}" if ranking.more_seeds else ""
    return Finding(text, statistic=more)
