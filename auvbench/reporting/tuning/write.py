"""The report of a study: a page, its figures, and all trials as CSV."""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from optuna.trial import FrozenTrial

from auvbench.analysis import rounding
from auvbench.reporting.figures import Figure
from auvbench.reporting.page import figures as figures_
from auvbench.reporting.page import numbers, writer
from auvbench.reporting.page.links import Links
from auvbench.reporting.tuning import figures, sentences
from auvbench.reporting.write import text
from auvbench.tuning import preset, runs
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
    embedded, _ = figures_.embed(drawn, Links(path, [], [], plan.protocol.name))
    name = preset.name_of(plan)
    return writer.filled(
        "study.html",
        SCRIPTS,
        title=f"auvbench tune: {plan.name}",
        algorithm=str(plan.base["algo"]["name"]),
        vehicle=str(plan.base["vehicle"]["name"]),
        protocol=plan.protocol.name,
        dimensions=plan.dimensions,
        sentences=[numbers.minus(sentence) for sentence in sentences.summary(found)],
        best=_best(found),
        important=bool(found.importances),
        best_number=found.best.number if found.best else None,
        preset_href=os.path.relpath(found.folder.best, path.parent),
        usage=f"cp {shlex.quote(str(found.folder.best))} conf/algo/{name}.yaml\n"
        f"auvbench train algo={name} seed=0",
        figures=embedded,
        measures=[(m.name, "%" if m.rate else "") for m in (found.objective.measure, found.objective.then)],
        learns=plan.learns,
        trials=[_line(found, trial, path) for trial in found.ordered],
        failures=[(trial.number, error) for trial in found.ordered if (error := _error(trial))],
        facts=_facts(found),
        command=plan.command,
    )


def _best(found: Outcome) -> list[dict[str, str]]:
    if found.best is None:
        return []
    return [
        {
            "key": dimension.key,
            "found": _plain(found.best.params[dimension.key]),
            "untuned": _plain(_at(found.plan.base, dimension.key)),
            "range": dimension.text,
            "importance": f"{100 * found.importances.get(dimension.key, 0.0):.0f}",
        }
        for dimension in found.plan.dimensions
    ]


def _at(config: Mapping[str, Any], key: str) -> Any:
    node: Any = config
    for part in key.split("."):
        node = node[part]
    return node


def _plain(value: Any) -> str:
    if isinstance(value, float):
        return numbers.typeset(f"{value:.4g}")
    return f"[{','.join(map(str, value))}]" if isinstance(value, list) else str(value)


def _line(found: Outcome, trial: FrozenTrial, path: Path) -> dict[str, Any]:
    """Return a trial as the template shows it; a `sort` value goes with each number."""
    shown = found.results(trial)
    cells: list[tuple[str, str, Any]] = [(rounding.NOTHING, "", "")] * 2
    if shown:
        last, measure, then = shown[-1], found.objective.measure, found.objective.then
        value, between = numbers.estimate(last.estimate, 100.0 if measure.rate else 1.0)
        second = numbers.fixed((100 if then.rate else 1) * last.then, 1)
        cells = [(value, between, last.objective), (second, "", last.then)]
    params = [trial.params.get(dimension.key, "") for dimension in found.plan.dimensions]
    return {
        "number": trial.number,
        "state": state_of(trial),
        "steps": trial.last_step or 0,
        "measures": cells,
        "params": [(_plain(value), value) for value in params],
        "href": _run(found, trial, path) if shown else "",
    }


def _run(found: Outcome, trial: FrozenTrial, path: Path) -> str:
    """Return a relative link to the manifest of the trial's first run; '' where the run is gone."""
    rung = len(trial.intermediate_values) - 1
    run = runs.of_trial(found.plan, found.folder, found.algo(trial), rung)[0]
    return Path(os.path.relpath(run.manifest_path, path.parent)).as_posix() if run.exists() else ""


def _facts(found: Outcome) -> list[tuple[str, str]]:
    plan, tune = found.plan, found.plan.tune
    budgets = " / ".join(f"{budget:,}" for budget in plan.budgets)
    training = [
        ("Training seeds", f"{', '.join(map(str, tune.seeds))} for every trial"),
        ("Budget", f"{budgets} steps, pruner {tune.pruner}, reduction {tune.reduction}"),
    ]
    return [
        ("Sampler", f"{tune.sampler}, {tune.startup} trials at random first; seed {plan.seed}"),
        ("Chosen by", f"{found.objective.measure.name}, then {found.objective.then.name}"),
        (
            "Validation",
            f"protocol {plan.protocol.name}: {plan.protocol.episodes} episodes, scenario seed {plan.protocol.seed}; "
            "no test has these scenarios. The runs with fresh seeds have the next scenario seed",
        ),
        *(training if plan.learns else []),
        ("Intervals", "95 %, over validation episodes, and over training seeds where a trial has several"),
    ]
