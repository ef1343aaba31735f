"""`auvbench plan`: how many training seeds and test episodes resolve a difference."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from auvbench.commands import plan_text
from auvbench.commands.grammar import Parser
from auvbench.errors import UserError

if TYPE_CHECKING:
    from auvbench.analysis.measures import Measure
    from auvbench.analysis.planning import Basis, Need

EPILOG = """\
examples:
  auvbench plan --resolve 5 outputs/thesis             5 points of success, as those trainings differ
  auvbench plan --sd 0.5 --rates 90,95 --agents 12     without any run: 90 against 95 %, seeds differ by 0.5 logits
  auvbench plan --resolve 5 --looks 5,10,15 outputs    look after 5, 10 and 15 seeds, and stop when it is resolved
"""


def main(argv: Sequence[str]) -> int:
    given = parser().read(argv)
    options = _options(given)
    basis, agents, episodes, m = _basis(options)
    if options.looks:
        design = _looks(options, basis, episodes)
        print(json.dumps(design) if options.json else plan_text.design(design, options, basis, m))
        return 0
    found = list(_needs(options, basis, agents, episodes))
    if options.json:
        print(json.dumps(plan_text.plain(found, basis, options.confidence)))
    else:
        print(plan_text.table(found, basis, agents, m, options))
    return 0


@dataclass(frozen=True, slots=True)
class Options:
    """What was asked."""

    paths: tuple[Path, ...]
    where: tuple[str, ...]
    metric: str
    resolve: float | None
    """in the measure's unit; a rate in points"""
    sd: float | None
    rates: tuple[float, float] | None
    agents: int | None
    episodes: tuple[int, ...]
    looks: tuple[int, ...]
    bounds: str
    confidence: float
    protocol: str
    replications: int
    json: bool


def parser() -> Parser:
    """The flags."""
    import argparse

    parser = Parser(
        prog="auvbench plan",
        where=True,
        description="Says how many training seeds and test episodes resolve a difference with 80 and 95 % power, by "
        "simulation with the report's own test.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("paths", nargs="*", type=Path, metavar="PATH", help="evaluated runs, for how much trainings differ")
    add("--resolve", metavar="D", help="the difference: points of a rate, else in the measure's unit")
    add(
        "--metric", metavar="METRIC", default="success_rate", help="success_rate (default) or another measure"
    )
    add("--sd", metavar="S", help="instead of PATH: standard deviation of the seeds, in logits of the rate")
    add("--rates", metavar="A,B", help="the two rates in percent, instead of --resolve around the median")
    add("--agents", metavar="N", help="in the table (default: those of PATH, else 2)")
    add("--episodes", metavar="N,...", help="test episodes (default: those of PATH and four times as many)")
    add("--looks", metavar="N,...", help="a sequential design: the numbers of seeds at which one looks")
    add("--bounds", metavar="SHAPE", default="pocock", help="of --looks: pocock (default) or obrien-fleming")
    add("--confidence", metavar="P", default="0.95", help="of the table, as of the report")
    add("--protocol", metavar="NAME", default="test", help="the evaluation of PATH that is looked at")
    add("--replications", metavar="N", default="200", help="simulated experiments for each number of seeds")
    add("--json", action="store_true", help="for programs")
    return parser


def _options(given: Any) -> Options:
    from auvbench.statistics.sequential import SHAPES

    sd = None if given.sd is None else _number("--sd", given.sd, 0.0, 10.0)
    rates = None if given.rates is None else _numbers("--rates", given.rates, 0.5, 99.5)
    if rates is not None and (len(rates) != 2 or rates[0] == rates[1]):
        raise UserError(f"--rates {given.rates}: two different rates in percent, e.g. --rates 90,95")
    if sd is not None and rates is None:
        raise UserError("--sd needs --rates: the two rates that are to be told apart, e.g. --rates 90,95")
    if sd is None and not given.paths:
        raise UserError("plan: name evaluated runs, or type --sd 0.5 --rates 90,95 (auvbench plan --help)")
    if sd is not None and given.paths:
        raise UserError(f"--sd {given.sd}: takes the place of the runs; leave out {given.paths[0]}")
    if rates is None and given.resolve is None:
        raise UserError(
            "plan: --resolve D is missing: the difference that is to be resolved, e.g. --resolve 5"
        )
    if rates is not None and given.resolve is not None:
        raise UserError("--resolve and --rates name the same thing; give one of them")
    if given.bounds not in SHAPES:
        raise UserError(f"--bounds {given.bounds}: valid: {', '.join(SHAPES)}")
    looks = () if given.looks is None else _wholes("--looks", given.looks, 2, 1000)
    if looks and (len(looks) < 2 or list(looks) != sorted(set(looks))):
        raise UserError(f"--looks {given.looks}: at least two rising numbers of seeds, e.g. --looks 5,10,15")
    return Options(
        paths=tuple(given.paths),
        where=tuple(given.where),
        metric=given.metric,
        resolve=None
        if given.resolve is None
        else _number("--resolve", given.resolve, 0.0, 1e9, open_low=True),
        sd=sd,
        rates=None if rates is None else (rates[0] / 100, rates[1] / 100),
        agents=None if given.agents is None else _wholes("--agents", given.agents, 2, 1000)[0],
        episodes=() if given.episodes is None else _wholes("--episodes", given.episodes, 2, 1_000_000),
        looks=looks,
        bounds=given.bounds,
        confidence=_number("--confidence", given.confidence, 0.5, 0.9999),
        protocol=given.protocol,
        replications=_wholes("--replications", given.replications, 50, 100_000)[0],
        json=given.json,
    )


def _number(flag: str, text: str, low: float, high: float, *, open_low: bool = False) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not low <= value <= high or (open_low and value == low):
        least = f"more than {low:g}" if open_low else f"at least {low:g}"
        raise UserError(f"{flag} {text}: must be a number, {least} and at most {high:g}")
    return value


def _numbers(flag: str, text: str, low: float, high: float) -> tuple[float, ...]:
    return tuple(_number(flag, part, low, high) for part in text.split(","))


def _wholes(flag: str, text: str, low: int, high: int) -> tuple[int, ...]:
    found = _numbers(flag, text, low, high)
    if any(value != int(value) for value in found):
        raise UserError(f"{flag} {text}: must be whole numbers from {low} to {high}")
    return tuple(int(value) for value in found)


def _basis(options: Options) -> tuple[Basis, int, tuple[int, ...], Measure]:
    """What is planned for, the agents of the table, the numbers of episodes, and the measure."""
    from auvbench.analysis import planning
    from auvbench.analysis.measures import measure
    from auvbench.statistics import power

    m = measure(options.metric, "--metric")
    if options.rates is not None and not m.rate:
        raise UserError(f"--rates are rates: give --resolve D in the unit of {m.name}")
    if options.sd is not None:
        assert options.rates is not None
        spread = power.SeedSpread(options.sd, float("inf"))
        basis = planning.Basis(power.Rates(options.sd), None, options.rates, spread, 0)
        return basis, options.agents or 2, options.episodes or (200, 500, 2000), m
    from auvbench.analysis.conditions import default
    from auvbench.analysis.load import agents, load, require
    from auvbench.analysis.sections import sections

    runs, problems = load(options.paths, options.protocol, options.where)
    require(runs, problems, options.protocol)
    part = sections(runs, options.protocol)[0]
    grouped, _ = agents(part.runs, protocol=options.protocol, condition=default(runs, options.protocol))
    scale = 0.01 if m.rate else 1.0
    if options.rates is not None:
        found = planning.from_agents(grouped, m, abs(options.rates[1] - options.rates[0]))
        basis = planning.Basis(found.model, found.cautious, options.rates, found.spread, found.agents)
    else:
        assert options.resolve is not None
        basis = planning.from_agents(grouped, m, scale * options.resolve)
    tested = grouped[0].outcome.shape[1]
    return basis, options.agents or max(2, len(grouped)), options.episodes or (tested, 4 * tested), m


def _needs(
    options: Options, basis: Basis, agents: int, episodes: Sequence[int]
) -> Iterator[tuple[str, Need]]:
    """By a name, the seeds that are needed; progress on the terminal."""
    from auvbench.analysis import planning

    rows = [("", basis.model, E) for E in episodes]
    if basis.cautious is not None:
        rows.append(("cautious", basis.cautious, episodes[0]))
    with _progress(len(rows)) as note:
        for i, (name, model, E) in enumerate(rows):
            yield (
                name,
                planning.needs(
                    model,
                    basis.values,
                    E,
                    agents=agents,
                    targets=plan_text.TARGETS,
                    alpha=1 - options.confidence,
                    replications=options.replications,
                    note=lambda E, S, i=i: note(i, f"{E} episodes: {S} seeds"),  # type: ignore[misc]
                ),
            )


@contextmanager
def _progress(total: int) -> Iterator[Callable[[int, str], None]]:
    """A line on the terminal that says what is simulated; nothing elsewhere."""
    if not sys.stderr.isatty():
        yield lambda done, text: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    with Progress(
        TextColumn("simulating"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[now]}"),
        console=Console(stderr=True),
        transient=True,
    ) as bar:
        task = bar.add_task("", total=total, now="")
        yield lambda done, text: bar.update(task, completed=done, now=text)


def _looks(options: Options, basis: Basis, episodes: Sequence[int]) -> dict[str, Any]:
    """A sequential design, its thresholds and what a simulation of it gives."""
    from auvbench.statistics import power
    from auvbench.statistics.sequential import levels

    looks, alpha = options.looks, 1 - options.confidence
    thresholds = [float(p) for p in levels([S / looks[-1] for S in looks], alpha, options.bounds)]
    R = max(2 * options.replications, 1000)
    E, same = episodes[0], (basis.values[0], basis.values[0])
    with _progress(3) as note:
        note(0, "no difference, planned")
        false, _ = power.stopping(basis.model, same, looks, E, thresholds, replications=R)
        note(1, "no difference, naive")
        naive, _ = power.stopping(basis.model, same, looks, E, [alpha] * len(looks), replications=R)
        note(2, "the difference")
        found, used = power.stopping(basis.model, basis.values, looks, E, thresholds, replications=R)
    return {
        "bounds": options.bounds,
        "episodes": E,
        "looks": [{"seeds": S, "p_below": p} for S, p in zip(looks, thresholds, strict=True)],
        "values": list(basis.values),
        "power": found,
        "mean_seeds": used,
        "false_alarms": false,
        "false_alarms_without_a_plan": naive,
        "experiments": R,
    }
