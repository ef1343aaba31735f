"""What `auvbench plan` says: a table of seeds, or the rules of a sequential design, and what they are for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from auvbench.analysis.measures import Measure
    from auvbench.analysis.planning import Basis, Need
    from auvbench.commands.plan import Options

TARGETS = (0.8, 0.95)
"""power"""
FAILURES = (0.1, 0.05)
"""failure rates of trainings that a plan says how to bound"""


def plain(found: Sequence[tuple[str, Need]], basis: Basis, confidence: float) -> dict[str, Any]:
    """Return the plan for programs."""
    from auvbench.statistics.binomial import trials_that_bound

    return {
        "seeds_that_bound_failures": {f"{rate:g}": trials_that_bound(rate, confidence) for rate in FAILURES},
        "values": list(basis.values),
        "sd": basis.spread.sd,
        "sd_df": None if basis.agents == 0 else basis.spread.df,
        "sd_upper_90": None if basis.agents == 0 else basis.spread.upper(),
        "needs": [{"trainings": name or "as seen", **asdict(need)} for name, need in found],
    }


def table(found: Sequence[tuple[str, Need]], basis: Basis, agents: int, m: Measure, options: Options) -> str:
    """Return seeds by test episodes and power, and how to read them."""
    from auvbench.statistics.power import MOST_SEEDS

    def cell(seeds: int | None) -> str:
        return f"> {MOST_SEEDS}" if seeds is None else str(seeds)

    titles = ["episodes", *(f"{100 * t:g} % power" for t in TARGETS)]
    if agents > 2:
        titles += [f"{100 * t:g} %, table of {agents}" for t in TARGETS]
    lines = []
    for name, need in found:
        cells = [f"{need.episodes}{' *' if name else ''}", *(cell(need.alone[t]) for t in TARGETS)]
        if agents > 2:
            cells += [cell(need.among[t]) for t in TARGETS]
        lines.append(cells)
    widths = [max(len(row[i]) for row in [titles, *lines]) for i in range(len(titles))]
    table = [
        "  ".join(text.rjust(w) for text, w in zip(row, widths, strict=True)) for row in [titles, *lines]
    ]
    starred = (
        [f"* if trainings differ by {basis.spread.upper():.3g}, the most that the data allow (90 %)"]
        if any(name for name, _ in found)
        else []
    )
    of = f"Training seeds of each agent that resolve {_what(basis, m)}"
    corrected = (
        f" In a table of {agents}, each of {agents - 1} agents is compared with the baseline, at a confidence of "
        f"{100 * (1 - (1 - options.confidence) / (agents - 1)):.4g} %."
        if agents > 2
        else ""
    )
    notes = [
        f"Simulated with the report's test at {100 * options.confidence:g} % confidence, {options.replications} "
        f"experiments for each number of seeds (± 1 seed or a tenth).{corrected}",
        "Fix the number before you look: who looks after each of 3 to 15 seeds and stops when a difference is resolved "
        "finds one where there is none in 14 % of the cases instead of 5 %. auvbench plan --looks 5,10,15 makes a design "
        "that may stop early and keeps its promise.",
        _failures(options.confidence),
    ]
    return "\n".join([f"{of}.", _differ(basis, m), "", *table, *starred, "", *notes])


def _failures(confidence: float) -> str:
    """Return how many trainings without a failure bound the share that fails."""
    from auvbench.statistics.binomial import trials_that_bound

    bounds = ", ".join(f"below {100 * rate:g} %: {trials_that_bound(rate, confidence)}" for rate in FAILURES)
    return (
        "Trainings that fail now and then are not in this model. Seeds without a failure that bound the failure rate with "
        f"{100 * confidence:g} % confidence, {bounds}."
    )


def design(found: dict[str, Any], options: Options, basis: Basis, m: Measure) -> str:
    """The rules of a sequential design, and what a simulation of it gave."""
    percent = f"{100 * (1 - options.confidence):g}"
    rows = [
        f"  after {look['seeds']:>3} seeds of each: stop if p < {look['p_below']:.4f}   "
        f"(auvbench report --confidence {1 - look['p_below']:.4f})"
        for look in found["looks"]
    ]
    return "\n".join(
        [
            f"A group-sequential design ({options.bounds}) for {_what(basis, m)}, {found['episodes']} episodes.",
            _differ(basis, m),
            "",
            *rows,
            "",
            f"All looks together err with {percent} %: {100 * found['false_alarms']:.1f} % of {found['experiments']} "
            f"simulated experiments without a difference (with p < {percent} % at each look "
            f"{100 * found['false_alarms_without_a_plan']:.1f} %).",
            f"Of experiments with the difference {100 * found['power']:.0f} % resolve it, after {found['mean_seeds']:.1f} "
            "seeds on average. It is a design for one comparison: name the two agents, the looks and this rule before "
            "the first training.",
        ]
    )


def _what(basis: Basis, m: Measure) -> str:
    """What is to be told apart, in words."""
    from auvbench.analysis.formatting import name, unit

    low, high = basis.values
    if m.rate:
        return f"{name(m)}: {100 * low:.3g} % against {100 * high:.3g} %"
    return f"{name(m)}: {low:.4g} against {high:.4g}{unit(m)}"


def _differ(basis: Basis, m: Measure) -> str:
    from auvbench.analysis.formatting import counted, unit

    of = " logits" if m.rate else unit(m)
    if basis.agents == 0:
        return f"Trainings differ by {basis.spread.sd:.3g}{of} (standard deviation; as typed)."
    seeds = counted(int(basis.spread.df) + basis.agents, "training")
    return (
        f"Trainings of one configuration differ by {basis.spread.sd:.3g}{of} (standard deviation; {seeds} of "
        f"{counted(basis.agents, 'agent')}; with 90 % confidence not more than {basis.spread.upper():.3g})."
    )
