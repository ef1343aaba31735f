"""The report of a study: a page, its figures, all trials as CSV, and the findings in sentences."""

from __future__ import annotations

import os
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from optuna.trial import FrozenTrial

from auvbench.analysis.formatting import NOTHING, amount, counted, difference, fixed, listed, name
from auvbench.analysis.measures import Measure
from auvbench.reporting.figures import Figure
from auvbench.reporting.page import writer
from auvbench.reporting.page.parts import Links, embed
from auvbench.reporting.tables.table import Cell, Heading, Line, Table, estimate_cell
from auvbench.reporting.tuning import figures
from auvbench.reporting.write import text
from auvbench.statistics.intervals import Estimate
from auvbench.tuning import outcome, runs
from auvbench.tuning.controller import worth
from auvbench.tuning.outcome import Outcome, state_of
from auvbench.tuning.search import ERROR
from auvbench.untrusted import path_safety

SCRIPTS = ("tables.js",)


def report(found: Outcome) -> Path:
    """Write index.html, trials.csv and the figures into the study's report/; return the page.

    Raises:
        OSError: A file cannot be written.
    """
    folder = found.folder.report
    path_safety.check_output(folder, ("index.html", "trials.csv", "figures"))
    text(folder / "trials.csv", table(found).to_csv(index=False, lineterminator="\n"))
    drawn = figures.draw(found, folder)
    return text(folder / "index.html", page(found, drawn, folder / "index.html"))


def table(found: Outcome) -> pd.DataFrame:
    """Return a row per trial, best first."""
    keys = [dimension.key for dimension in found.plan.dimensions]
    names = (found.objective.measure.name, "low", "high", found.objective.then.name)
    rows = []
    for place, trial in enumerate(found.ordered, 1):
        row: dict[str, Any] = {"place": place, "trial": trial.number, "state": state_of(trial)}
        row["steps"] = (trial.last_step or 0) if found.plan.learns else 0
        if shown := found.results(trial):
            last = shown[-1]
            row |= zip(names, (last.objective, last.low, last.high, last.then), strict=True)
        rows.append(row | {key: trial.params.get(key, "") for key in keys} | {"error": _error(trial)})
    return pd.DataFrame(rows, columns=["place", "trial", "state", "steps", *names, *keys, "error"])


def _error(trial: FrozenTrial) -> str:
    return str(trial.user_attrs.get(ERROR, ""))


def page(found: Outcome, drawn: Sequence[Figure], path: Path) -> str:
    """Return the page as HTML; links are relative to its place."""
    plan = found.plan
    embedded, _ = embed(drawn, Links(path, []))
    return writer.filled(
        "study.html",
        SCRIPTS,
        title=f"auvbench tune: {plan.name}",
        algorithm=str(plan.base["algo"]["name"]),
        vehicle=str(plan.base["vehicle"]["name"]),
        protocol=plan.protocol.name,
        keys=len(plan.dimensions),
        sentences=summary(found),
        best=_best(found, found.best) if found.best else None,
        best_number=found.best.number if found.best else None,
        preset_href=os.path.relpath(found.folder.best, path.parent),
        usage=f"cp {shlex.quote(str(found.folder.best))} conf/algo/{outcome.name_of(plan)}.yaml\n"
        f"auvbench train algo={outcome.name_of(plan)} seed=0",
        figures=embedded,
        trials=_trials(found, path),
        failures=[(trial.number, error) for trial in found.ordered if (error := _error(trial))],
        facts=_facts(found),
        command=plan.command,
    )


def _best(found: Outcome, best: FrozenTrial) -> Table:
    """Return a row per key: the best value, the untuned one, the range, and the importance."""
    headings = [Heading(title, words=True) for title in ("key", "found", "untuned", "searched")]
    lines = []
    for dimension in found.plan.dimensions:
        values = best.params[dimension.key], _at(found.plan.base, dimension.key)
        cells = [Cell(dimension.key), *(Cell(_plain(value)) for value in values), Cell(dimension.text)]
        if found.importances:
            share = found.importances.get(dimension.key, 0.0)
            cells.append(Cell(f"{100 * share:.0f}", sort=share))
        lines.append(Line(tuple(cells)))
    if found.importances:
        headings.append(Heading("importance", "%"))
    return Table(tuple(headings), tuple(lines))


def _at(config: Mapping[str, Any], key: str) -> Any:
    node: Any = config
    for part in key.split("."):
        node = node[part]
    return node


def _plain(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    return f"[{','.join(map(str, value))}]" if isinstance(value, list) else str(value)


def _trials(found: Outcome, path: Path) -> Table:
    """Return a row per trial, best first, linked to its run."""
    learns = found.plan.learns
    measures = found.objective.measure, found.objective.then
    headings = [Heading("trial"), Heading("state", words=True), *([Heading("steps")] if learns else [])]
    headings += [Heading(measure.name, "%" if measure.rate else "") for measure in measures]
    headings += [Heading(dimension.key.partition(".")[2]) for dimension in found.plan.dimensions]
    lines = []
    for trial in found.ordered:
        shown = found.results(trial)
        cells = [Cell(str(trial.number), sort=trial.number), Cell(state_of(trial))]
        if learns:
            cells.append(Cell(str(trial.last_step or 0), sort=trial.last_step or 0))
        if shown:
            then = (100 if measures[1].rate else 1) * shown[-1].then
            cells.append(estimate_cell(shown[-1].estimate, 100.0 if measures[0].rate else 1.0))
            cells.append(Cell(fixed(then, 1), sort=then))
        else:
            cells += [Cell(NOTHING)] * 2
        for dimension in found.plan.dimensions:
            value = trial.params.get(dimension.key, "")
            cells.append(Cell(_plain(value), sort=value if isinstance(value, int | float) else None))
        lines.append(Line(tuple(cells), href=_run(found, trial, path) if shown else ""))
    return Table(tuple(headings), tuple(lines))


def _run(found: Outcome, trial: FrozenTrial, path: Path) -> str:
    """Return a relative link to the manifest of the trial's first run; '' where the run is gone."""
    rung = len(trial.intermediate_values) - 1
    run = runs.of_trial(found.plan, found.folder, found.algo(trial), rung)[0]
    return Path(os.path.relpath(run.manifest_path, path.parent)).as_posix() if run.exists() else ""


def _facts(found: Outcome) -> list[tuple[str, list[str]]]:
    plan, tune = found.plan, found.plan.tune
    budgets = " / ".join(f"{budget:,}" for budget in plan.budgets)
    facts = {
        "Sampler": f"{tune.sampler}, {tune.startup} trials at random first; seed {plan.seed}",
        "Chosen by": f"{found.objective.measure.name}, then {found.objective.then.name}",
        "Validation": f"protocol {plan.protocol.name}: {plan.protocol.episodes} episodes, scenario seed {plan.protocol.seed}; "
        "no test has these scenarios. The runs with fresh seeds have the next scenario seed",
        "Intervals": "95 %, over validation episodes, and over training seeds where a trial has several",
    }
    if plan.learns:
        facts["Training seeds"] = f"{', '.join(map(str, tune.seeds))} for every trial"
        facts["Budget"] = f"{budgets} steps, pruner {tune.pruner}, reduction {tune.reduction}"
    return [(name, [value]) for name, value in facts.items()]


def summary(found: Outcome) -> list[str]:
    """Return the findings, the most important first."""
    lines = [gain(found)] if found.gains else []
    if found.broken:
        lines.append(broken(found))
    if found.best is not None:
        lines.append(
            f"Best in the search: trial {found.best.number}, {worth(found.results(found.best)[-1], found.objective)}, on the "
            "validation scenarios that chose it. The best of many trials is partly lucky."
        )
    counts = Counter(state_of(trial) for trial in found.trials)
    states = [f"{count} {state}" for state, count in sorted(counts.items())]
    trained = f" Trained: {found.steps:,} environment steps." if found.steps else ""
    lines.append(f"{counted(len(found.trials), 'trial')}: {', '.join(states) or 'none'}.{trained}")
    if edges := at_the_edge(found):
        lines.append(edges)
    return lines


def at_the_edge(found: Outcome) -> str:
    """Name the best values at an end of their range; return '' for none."""
    if found.best is None:
        return ""
    params = found.best.params
    near = [f"{d.key} ({d.text})" for d in found.plan.dimensions if d.at_end(params[d.key])]
    if not near:
        return ""
    return f"At an end of the range: {listed(near, 4)}. A wider range may hold better settings."


def gain(found: Outcome) -> str:
    """Compare the best and the untuned settings on what the search has not seen."""
    seeds = len(found.plan.tune.fresh_seeds)
    on = f"{seeds} fresh training seeds and " if found.plan.learns and seeds > 1 else ""
    parts = [
        f"{name(of.measure)}: {amount(of.tuned, of.measure)} tuned, {amount(of.untuned, of.measure)} untuned, "
        f"difference {difference(of.difference, of.measure)}, {verdict(of.difference, of.measure)}"
        for of in found.gains
    ]
    return f"On {on}fresh validation scenarios: {'; '.join(parts)}."


def verdict(of: Estimate, measure: Measure) -> str:
    """Return better, worse or not resolved: whether the interval of tuned less untuned excludes zero."""
    if of.low > 0 or of.high < 0:
        return "better" if of.value * measure.sign > 0 else "worse"
    return "not resolved"


def broken(found: Outcome) -> str:
    """Name the trainings with fresh seeds that failed."""
    return f"With fresh seeds {counted(len(found.broken), 'training')} failed, so no gain is shown: {listed(found.broken, 3)}."


def evidence(found: Outcome) -> str:
    """Return the sentence for the header of the preset."""
    if found.broken:
        return broken(found)
    return (
        gain(found)
        if found.gains
        else "Not compared with fresh seeds: its result in the search is partly lucky."
    )
