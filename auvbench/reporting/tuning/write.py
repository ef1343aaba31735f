"""The report of a study: one page that needs nothing but a browser, its figures, and all trials as CSV."""

from __future__ import annotations

import csv
import io
import os
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from auvbench.analysis import rounding
from auvbench.analysis.measures import Measure
from auvbench.reporting.figures import Figure
from auvbench.reporting.page import figures as figures_
from auvbench.reporting.page import numbers, writer
from auvbench.reporting.page.links import Links
from auvbench.reporting.tuning import figures, sentences
from auvbench.reporting.write import text
from auvbench.statistics.estimate import Estimate
from auvbench.tuning import preset, runs
from auvbench.tuning.outcome import Outcome, Trial
from auvbench.tuning.space import Dimension, with_values
from auvbench.untrusted import path_safety

SCRIPTS = ("tables.js", "lightbox.js")


@dataclass(frozen=True, slots=True)
class Cell:
    """One cell of the table of trials."""

    text: str
    kind: str = "number"
    sort: float | str | None = None
    range: str = ""
    href: str = ""


@dataclass(frozen=True, slots=True)
class Head:
    """One heading of it."""

    title: str
    kind: str = "number"
    unit: str = ""


def report(found: Outcome) -> Path:
    """Writes `report/` of a study: index.html, trials.csv, figures; returns the page.

    Raises:
        OSError: it cannot be written.
    """
    folder = found.folder.report
    path_safety.check_output(folder, ("index.html", "trials.csv", "figures"))
    text(folder / "trials.csv", table(found))
    drawn = figures.draw(found, folder)
    return text(folder / "index.html", page(found, drawn, folder / "index.html"))


def table(found: Outcome) -> str:
    """All trials as CSV, best first."""
    keys = [dimension.key for dimension in found.plan.dimensions]
    rows = io.StringIO()
    out = csv.writer(rows, lineterminator="\n")
    objective, then = found.objective.measure.name, found.objective.then.name
    out.writerow(["place", "trial", "state", "steps", objective, "low", "high", then, *keys, "runs", "error"])
    for place, trial in enumerate(found.trials, 1):
        result: Mapping[str, Any] = trial.result if trial.rung >= 0 else {}
        out.writerow(
            [
                place if result else "",
                trial.number,
                trial.state,
                _steps(found, trial) if result else "",
                *(result.get(name, "") for name in ("objective", "low", "high", "then")),
                *(trial.params[key] for key in keys),
                " ".join(result.get("runs", ())),
                trial.error,
            ]
        )
    return rows.getvalue()


def _steps(found: Outcome, trial: Trial) -> int:
    return found.budgets[trial.rung] if found.learns and trial.rung >= 0 else 0


def page(found: Outcome, drawn: Sequence[Figure], path: Path) -> str:
    """The page as HTML; links are relative to where it will lie."""
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
        objective=found.objective.measure.name,
        then=found.objective.then.name,
        heads=_heads(found),
        trials=[_line(found, place, trial, path) for place, trial in enumerate(found.trials, 1)],
        failures=[(trial.number, trial.error) for trial in found.trials if trial.error],
        facts=_facts(found),
        command=plan.command,
    )


def _best(found: Outcome) -> list[dict[str, str]]:
    if found.best is None:
        return []
    untuned = found.plan.base["algo"]
    return [
        {
            "key": dimension.key,
            "found": value(dimension, found.best.params[dimension.key]),
            "untuned": _plain(_at(untuned, dimension.key)),
            "range": dimension.text,
            "importance": f"{100 * found.importances[dimension.key]:.0f}"
            if dimension.key in found.importances
            else rounding.NOTHING,
        }
        for dimension in found.plan.dimensions
    ]


def _at(algo: Mapping[str, Any], key: str) -> Any:
    node: Any = algo
    for part in key.split(".")[1:]:
        node = node[part]
    return node


def value(dimension: Dimension, at: float | int | str) -> str:
    """A parameter as a reader wants it."""
    return str(at) if dimension.kind == "choice" else _plain(at)


def _plain(at: Any) -> str:
    if isinstance(at, float):
        return numbers.typeset(f"{at:.4g}")
    if isinstance(at, list):
        return f"[{','.join(map(str, at))}]"
    return str(at)


def _heads(found: Outcome) -> list[Head]:
    measure, then = found.objective.measure, found.objective.then
    heads = [Head("#"), Head("Trial"), Head("State", "text")]
    if found.learns:
        heads.append(Head("Steps"))
    heads += [
        Head(measure.name, unit="%" if measure.rate else ""),
        Head(then.name, unit="%" if then.rate else ""),
    ]
    return heads + [Head(dimension.key.partition(".")[2]) for dimension in found.plan.dimensions]


def _line(found: Outcome, place: int, trial: Trial, path: Path) -> list[Cell]:
    shown = trial.rung >= 0
    result: Mapping[str, Any] = trial.result if shown else {}
    cells = [
        Cell(str(place) if shown else rounding.NOTHING, sort=place),
        Cell(str(trial.number), sort=trial.number, href=_run(found, trial, path) if shown else ""),
        Cell(trial.state, "text"),
    ]
    if found.learns:
        steps = _steps(found, trial)
        cells.append(Cell(numbers.typeset(str(steps)) if shown else rounding.NOTHING, sort=steps))
    cells.append(_measured(result, found.objective.measure))
    then = found.objective.then
    scale, places = (100, 1) if then.rate else (1, 1)
    cells.append(
        Cell(numbers.fixed(scale * result["then"], places), sort=result["then"])
        if shown
        else Cell(rounding.NOTHING)
    )
    for dimension in found.plan.dimensions:
        at = trial.params[dimension.key]
        order: float = dimension.choices.index(str(at)) if dimension.kind == "choice" else float(at)
        cells.append(Cell(value(dimension, at), sort=order))
    return cells


def _measured(result: Mapping[str, Any], measure: Measure) -> Cell:
    if not result:
        return Cell(rounding.NOTHING)
    estimate = Estimate(result["objective"], result["low"], result["high"])
    shown, between = numbers.estimate(estimate, 100.0 if measure.rate else 1.0)
    return Cell(shown, sort=result["objective"], range=between)


def _run(found: Outcome, trial: Trial, path: Path) -> str:
    """A relative link to the manifest of the trial's first run; '' where it is gone."""
    algo = with_values(found.plan.base["algo"], found.plan.dimensions, trial.params)
    run = runs.of_trial(found.plan, found.folder, algo, found.budgets[trial.rung])[0]
    if not run.exists():
        return ""
    return Path(os.path.relpath(run.manifest_path, path.parent)).as_posix()


def _facts(found: Outcome) -> list[tuple[str, str]]:
    plan, tune = found.plan, found.plan.tune
    facts = [
        ("Sampler", f"{tune.sampler}, {tune.startup} trials at random first; seed {plan.seed}"),
        ("Chosen by", f"{found.objective.measure.name}, then {found.objective.then.name}"),
        (
            "Validation",
            f"protocol {plan.protocol.name}: {plan.protocol.episodes} episodes, scenario seed {plan.protocol.seed}, of the "
            "stream that no test shares; with fresh seeds the next scenario seed",
        ),
    ]
    if found.learns:
        facts += [
            ("Training seeds", f"{', '.join(map(str, tune.seeds))} for every trial"),
            (
                "Budget",
                f"{' / '.join(f'{budget:,}' for budget in found.budgets)} steps, pruner {tune.pruner}"
                + (f", one in {tune.reduction} goes on" if tune.pruner in ("halving", "hyperband") else ""),
            ),
        ]
    facts.append(
        (
            "Intervals",
            "95 %. Those of single trials are over validation episodes"
            + (" (and training seeds, where a trial has several)" if found.learns else "")
            + "; the best of many is lucky, which only the fresh seeds and scenarios show",
        )
    )
    return facts
