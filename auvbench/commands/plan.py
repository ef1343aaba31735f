"""`auvbench plan`: compute how many training seeds and test episodes resolve a difference."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from auvbench.errors import UserError
from auvbench.grammar import Parser, number, whole
from auvbench.record import PRIMARY
from auvbench.runs.identity import DEFAULT_TASK

if TYPE_CHECKING:
    from auvbench.analysis.measures import Measure
    from auvbench.analysis.planning import Basis, Need
    from auvbench.analysis.records import Agent

EPILOG = """\
examples:
  auvbench plan --resolve 5 --metric success_rate outputs/thesis   resolve 5 percentage points, with the spread of these runs
  auvbench plan --sd 0.5 --rates 90,95 --agents 12     without runs: 90 % against 95 %, spread of 0.5 logits between seeds
"""
TARGETS = (0.8, 0.95)
"""Statistical powers that the plan shows: probabilities of resolving the difference"""
REPLICATIONS = 200
"""number of simulated experiments for each number of seeds"""
FAILURES = (0.1, 0.05)
"""failure rates of trainings for which the plan gives the number of seeds"""

_Needs = Sequence[tuple[str, "Need"]]
"""Pairs of the assumed seed spread and the needed seeds; the spread is "" for the measured spread, or "cautious" for the upper
90 % confidence limit of the measured spread
"""


def main(argv: Sequence[str]) -> int:
    options = parser().read(argv)
    _check(options)
    basis, agents, episodes, m = _basis(options)
    needs = _needs(options, basis, agents, episodes)
    print(_text(needs, basis, agents, m, options))
    return 0


def parser() -> Parser:
    parser = Parser(
        prog="auvbench plan",
        where=True,
        description="Computes how many training seeds and test episodes resolve a difference between a "
        "learner and a controller, or between "
        "two learners, with 80 and 95 % power. It simulates experiments with the interval that the report uses.",
        epilog=EPILOG,
    )
    add = parser.add_argument
    add(
        "paths",
        nargs="*",
        type=Path,
        metavar="PATH",
        help="tested runs, from which the spread between trainings is estimated",
    )
    add(
        "--resolve",
        type=number(0.001, 1e6),
        metavar="D",
        help="difference to resolve, in percentage points for a rate, else in the measure's unit",
    )
    add(
        "--metric",
        metavar="METRIC",
        default=PRIMARY,
        help="measure (default: the measure that ranks the task's agents)",
    )
    add(
        "--sd",
        type=number(0, 10),
        metavar="S",
        help="instead of PATH: standard deviation between seeds, in logits of the rate",
    )
    add(
        "--rates",
        type=_several(number(0.5, 99.5)),
        metavar="A,B",
        help="the two rates to compare, in percent, instead of a difference (--resolve) around the median rate",
    )
    add(
        "--against",
        choices=("controller", "learner"),
        help="kind of the baseline (default: a controller, unless PATH has no controller)",
    )
    add(
        "--agents",
        type=whole(2, 1000),
        metavar="N",
        help="number of agents in the table (default: the agents of PATH, else 2)",
    )
    add(
        "--episodes",
        type=_several(whole(2, 1_000_000)),
        metavar="N,...",
        help="test episodes (default: as many as PATH has, and four times as many)",
    )
    add(
        "--confidence",
        type=number(0.5, 0.9999),
        metavar="P",
        default=0.95,
        help="confidence of all comparisons in the table together (default: as in the report)",
    )
    add("--protocol", metavar="NAME", default="test", help="protocol whose test rows of PATH are used")
    return parser


def _several(parse: Callable[[str], Any]) -> Callable[[str], tuple[Any, ...]]:
    return lambda text: tuple(map(parse, text.split(",")))


def _check(options: argparse.Namespace) -> None:
    sd, rates = options.sd, options.rates
    if rates is not None and (len(rates) != 2 or rates[0] == rates[1]):
        raise UserError("--rates takes two different rates in percent, e.g. --rates 90,95")
    if sd is not None and rates is None:
        raise UserError("--sd needs --rates: the two rates to tell apart, e.g. --rates 90,95")
    if sd is None and not options.paths:
        raise UserError("plan: name evaluated runs, or type --sd 0.5 --rates 90,95 (auvbench plan --help)")
    if sd is not None and options.paths:
        raise UserError(f"--sd replaces the runs; leave out {options.paths[0]}")
    if (rates is None) == (options.resolve is None):
        raise UserError("plan: type the difference as --resolve D (e.g. --resolve 5) or as --rates A,B")


def _basis(options: argparse.Namespace) -> tuple[Basis, int, tuple[int, ...], Measure]:
    """Return the basis of the plan, the number of agents, the numbers of episodes, and the measure."""
    from auvbench.analysis import planning
    from auvbench.analysis.measures import measure
    from auvbench.config.tasks import primary_of
    from auvbench.statistics import power

    # With --rates, the default measure is the success rate, since --rates gives two rates.
    usual = "success_rate" if options.rates is not None else primary_of(DEFAULT_TASK)
    m = measure(usual if options.metric == PRIMARY else options.metric, "--metric")
    rates = None if options.rates is None else (options.rates[0] / 100, options.rates[1] / 100)
    if options.sd is not None and rates is not None:
        _check_rate(m)
        spread = power.SeedSpread(options.sd, float("inf"))
        basis = planning.Basis(power.Rates(options.sd), None, rates, spread, 0, options.against != "learner")
        return basis, options.agents or 2, options.episodes or (200, 500, 2000), m
    from auvbench.analysis.conditions import default
    from auvbench.analysis.grouping import sections
    from auvbench.analysis.load import agents, load, require
    from auvbench.analysis.records import task_of

    runs, problems = load(options.paths, options.protocol, options.where)
    require(runs, problems, options.protocol)
    part = sections(runs, options.protocol)[0]
    names = sorted({task_of(run) for run in runs})
    if len(names) > 1:
        raise UserError(
            f"plan: the runs are of several tasks ({', '.join(names)}); name one: --where task={names[0]}"
        )
    if options.metric == PRIMARY and rates is None:
        m = measure(primary_of(names[0]), "--metric")
    if rates is not None:
        _check_rate(m)
    grouped, _ = agents(part.runs, protocol=options.protocol, condition=default(runs, options.protocol))
    resolve = abs(rates[1] - rates[0]) if rates else (0.01 if m.rate else 1.0) * options.resolve
    basis = planning.from_agents(grouped, m, resolve)
    if rates:
        basis = replace(basis, values=rates)
    basis = replace(basis, against_controller=_controller(grouped, options.against))
    tested = grouped[0].outcome.shape[1]
    return basis, options.agents or max(2, len(grouped)), options.episodes or (tested, 4 * tested), m


def _controller(agents: Sequence[Agent], against: str | None) -> bool:
    """Return whether the baseline is a controller. Without `--against`, take the default baseline of a report of these agents."""
    import numpy as np

    from auvbench.analysis.primary import default_baseline
    from auvbench.analysis.records import learns

    if against is not None:
        return against == "controller"
    chosen = default_baseline(agents, np.array([not learns(a) or len(a.outcome) > 1 for a in agents]))
    return chosen is not None and not learns(chosen)


def _check_rate(m: Measure) -> None:
    if not m.rate:
        raise UserError(f"--rates needs a rate, and {m.name} is not one; use --resolve D in its unit")


def _needs(options: argparse.Namespace, basis: Basis, agents: int, episodes: Sequence[int]) -> _Needs:
    """Return the needed seeds for each number of episodes and each assumed spread; on a terminal, show a spinner meanwhile."""
    from rich.console import Console

    from auvbench.analysis import planning

    rows = [("", basis.model, E) for E in episodes]
    if basis.cautious is not None:
        rows.append(("cautious", basis.cautious, episodes[0]))
    with Console(stderr=True).status("simulating") as status:
        return [
            (
                name,
                planning.needs(
                    model,
                    basis.values,
                    E,
                    agents=agents,
                    targets=TARGETS,
                    alpha=1 - options.confidence,
                    replications=REPLICATIONS,
                    against_controller=basis.against_controller,
                    note=lambda E, S: status.update(f"simulating {E} episodes, {S} seeds"),
                ),
            )
            for name, model, E in rows
        ]


def _text(needs: _Needs, basis: Basis, agents: int, m: Measure, options: argparse.Namespace) -> str:
    """Return a table of needed seeds by test episodes and power, with notes that explain the table."""
    from auvbench.analysis.formatting import counted, name, unit
    from auvbench.statistics.intervals import trials_that_bound
    from auvbench.statistics.power import MOST_SEEDS

    titles = ["episodes", *(f"{100 * t:g} % power" for t in TARGETS)]
    titles += [f"{100 * t:g} %, table of {agents}" for t in TARGETS if agents > 2]
    rows = [titles]
    for kind, need in needs:
        seeds = [need.alone[t] for t in TARGETS] + [need.among[t] for t in TARGETS if agents > 2]
        cells = [f"> {MOST_SEEDS}" if n is None else str(n) for n in seeds]
        rows.append([f"{need.episodes}{' *' if kind else ''}", *cells])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    table = ["  ".join(text.rjust(w) for text, w in zip(row, widths, strict=True)) for row in rows]

    low, high = basis.values
    against = "a learner against a controller" if basis.against_controller else "two learners"
    values = (
        f"{100 * low:.3g} % against {100 * high:.3g} %"
        if m.rate
        else f"{low:.4g} against {high:.4g}{unit(m)}"
    )
    of = " logits" if m.rate else unit(m)
    if basis.agents:
        trainings = counted(int(basis.spread.df) + basis.agents, "training")
        most = basis.spread.upper()
        differ = (
            f"Trainings of one configuration differ by {basis.spread.sd:.3g}{of} (standard deviation; {trainings} of "
            f"{counted(basis.agents, 'agent')}; with 90 % confidence not more than {most:.3g})."
        )
        table.append(f"* if trainings differ by {most:.3g}, the upper 90 % confidence limit")
    else:
        differ = f"Trainings differ by {basis.spread.sd:.3g}{of} (standard deviation; as typed)."
    percent = 100 * options.confidence
    corrected = (
        f" In a table of {agents}, each of {agents - 1} agents is compared with the baseline, at a confidence of "
        f"{100 * (1 - (1 - options.confidence) / (agents - 1)):.4g} %."
        if agents > 2
        else ""
    )
    bounds = ", ".join(
        f"below {100 * rate:g} %: {trials_that_bound(rate, options.confidence)}" for rate in FAILURES
    )
    notes = [
        f"Simulated with the report's interval of the typical training at {percent:g} % confidence, {REPLICATIONS} experiments for "
        f"each number of seeds (accuracy: ± 1 seed or ± 10 %).{corrected}",
        "Fix the number of seeds in advance: testing after each of 5 to 20 seeds, until a difference is resolved, finds false "
        "differences in more than 5 % of cases (docs/planning.md).",
        f"The simulation has no occasional failures of trainings. Number of seeds, all without failure, that shows with {percent:g} % "
        f"confidence a failure rate {bounds}.",
    ]
    return "\n".join(
        [f"Training seeds that resolve {name(m)} of {against}: {values}.", differ, "", *table, "", *notes]
    )
