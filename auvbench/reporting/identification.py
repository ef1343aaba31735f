"""Write the pages of `auvbench identify` and `auvbench validate`, and the same tables for the terminal."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console

from auvbench.analysis.formatting import NOTHING
from auvbench.identification.advise import Advice
from auvbench.identification.fit import CONTRADICTED, IDENTIFIED, Estimate, Fit
from auvbench.identification.gate import Verdict, warning
from auvbench.identification.log import CHANNELS, UNITS
from auvbench.identification.validation import (
    BAND,
    HOLD,
    HORIZONS,
    Prediction,
    Validation,
    share_of_holding,
)
from auvbench.reporting.figures import Figure, style
from auvbench.reporting.figures import identification as figures
from auvbench.reporting.figures.scene import Drawing
from auvbench.reporting.page import parts as page_parts
from auvbench.reporting.page.writer import document
from auvbench.reporting.tables.table import Cell, Heading, Line, Table
from auvbench.reporting.tables.terminal import TableView
from auvbench.reporting.write import text
from auvbench.vehicles.inspect import AXES

WIDTH = 150
"""Number of characters in a line of the tables for the terminal"""


@dataclass(frozen=True, slots=True)
class Part:
    """A section of a page."""

    id: str
    heading: str
    texts: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[page_parts.Embedded, ...] = ()


def number(value: float, digits: int = 3) -> str:
    """Return a number with `digits` significant digits; a dash for NaN or infinity."""
    if not math.isfinite(value):
        return NOTHING
    return f"{value:.{digits}g}"


def parameters_table(fit: Fit) -> Table:
    """Return a table of the parameters before and after the fit; notes say why a parameter keeps the sheet's value."""
    lines = []
    for estimate in fit.estimates:
        parameter = estimate.parameter
        unidentified = bool(estimate.kept)
        interval = f"[{number(estimate.low)}, {number(estimate.high)}]"
        lines.append(
            Line(
                (
                    Cell(parameter.name),
                    Cell(parameter.unit if parameter.unit != "1" else ""),
                    Cell(number(parameter.prior), sort=parameter.prior),
                    Cell(
                        NOTHING if unidentified else number(estimate.value),
                        "" if unidentified else interval,
                        sort=estimate.value,
                    ),
                    Cell(f"{100 * estimate.ratio:.0f}", sort=estimate.ratio),
                    Cell(_state(estimate)),
                )
            )
        )
    headings = (
        Heading("number", words=True),
        Heading("unit", words=True),
        Heading("sheet"),
        Heading("logs"),
        Heading(
            "uncertainty left",
            "%",
            hint="standard deviation after the fit, as a share of the prior's standard deviation",
        ),
        Heading("", words=True),
    )
    notes = (
        f"95 % intervals from a bootstrap of {fit.blocks} blocks of the logs"
        + ("; so few blocks make them rough" if fit.blocks < 10 else ""),
        "the uncertainty left includes the effect of numbers that stay at the sheet's values; the sheet has the joint covariance",
        *(f"{e.parameter.name} stays: {e.kept}" for e in fit.estimates if e.kept),
    )
    return Table(headings, tuple(lines), "numbers of the sheet before and after", notes)


def _state(estimate: Estimate) -> str:
    if estimate.kept:
        return "not identified"
    if estimate.ratio <= IDENTIFIED:
        return "identified"
    if abs(estimate.x) > CONTRADICTED:
        return "far from the sheet's number, but not precisely known"
    return "identified, if the numbers that stay are right"


def excitation_table(fit: Fit, verdicts: Sequence[Verdict]) -> Table:
    """Return a table with each axis's excitation by the commands, and the velocity error of the fitted vehicle.

    The velocity errors are measured on the logs that were used for the fit.
    """
    shares = share_of_holding(fit.logs, fit.vehicle, {e.parameter.name: e.value for e in fit.estimates})
    missed = {axis: shares.get(CHANNELS[6 + k], math.nan) for k, axis in enumerate(AXES)}
    lines = tuple(
        Line(
            (
                Cell(verdict.axis),
                Cell(f"{100 * verdict.command:.1f}", sort=verdict.command),
                Cell(number(verdict.moved), sort=_or_none(verdict.moved)),
                Cell(number(1e3 * verdict.lag), sort=_or_none(verdict.lag)),
                Cell(number(verdict.correlation, 2), sort=_or_none(verdict.correlation)),
                Cell(number(100 * missed[verdict.axis]), sort=_or_none(missed[verdict.axis])),
                Cell(verdict.state),
            )
        )
        for verdict in verdicts
    )
    headings = (
        Heading("axis", words=True),
        Heading("command", "% of the largest"),
        Heading("speed", "m/s, rad/s", hint="95 % quantile"),
        Heading("motion follows by", "ms"),
        Heading("correlation"),
        Heading(
            "error after 1 s",
            "% of holding",
            hint="on these logs; near 100: the sheet does not model what moves the vehicle",
        ),
        Heading("", words=True),
    )
    return Table(headings, lines, "excitation of each axis")


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else value


def terminal(fit: Fit, excitation: Table, advice: Sequence[Advice]) -> str:
    """Return the text for the terminal: the tables of an identification, and the next manoeuvre."""
    parts = [_printed(parameters_table(fit)), _printed(excitation)]
    if advice:
        parts.append(f"Next: {advice[0].text}")
    return "\n".join(parts)


def _printed(table: Table) -> str:
    """Return a table with all its notes, for the terminal."""
    stream = io.StringIO()
    Console(file=stream, width=WIDTH, highlight=False).print(TableView(replace(table, notes=())))
    lines = [line.rstrip() for line in stream.getvalue().splitlines()]
    return "\n".join([*lines, *(f"  {note}" for note in table.notes)]) + "\n"


def write_identification(
    folder: Path,
    fit: Fit,
    verdicts: Sequence[Verdict],
    excitation: Table,
    advice: Sequence[Advice],
    *,
    name: str,
    command: str,
) -> Path:
    """Write figures and the page of an identification; return the page's path.

    Raises:
        OSError: a file cannot be written.
    """
    drawn = {
        "prediction": figures.prediction(fit),
        "residuals": figures.residuals(fit),
        "parameters": figures.parameters(fit),
    }
    embedded = _embedded(folder, drawn)
    identified = sum(not estimate.kept for estimate in fit.estimates)
    seconds = sum(log.duration for log in fit.logs)
    texts = (
        (advice[0].text,)
        if advice
        else ("No manoeuvre was simulated, because this needs a vehicle with only thrusters as actuators.",)
    )
    body = (
        Part("answer", "Numbers", _warned(verdicts), (parameters_table(fit),), _some(embedded, "parameters")),
        Part("fit", "Measured and predicted", (), (), _some(embedded, "prediction", "residuals")),
        Part("excitation", "Excitation", (), (excitation,)),
        Part("next", "Next manoeuvre", texts, (_advice_table(advice),) if advice else ()),
    )
    windows = fit.windows
    methods = (
        f"{windows.n} windows of {windows.length:g} s were predicted with the compiled model, each from its measured first"
        " state, whose error is estimated together with the parameters. The loss is soft L1. The prior allows each number a factor"
        " of two around the sheet's number (5 % for the mass, 2 % of the weight for the net buoyancy).",
        f"A number is identified if its posterior standard deviation is at most half the prior's. The condition number of the"
        f" information of the identified numbers is {number(fit.condition)}.",
        *(remark for log in fit.logs for remark in log.remarks),
    )
    html = document(
        "identification.html",
        ("tables.js",),
        title=f"auvbench identify: {name}",
        headline=f"{identified} of {len(fit.estimates)} numbers of {fit.vehicle.name} identified from {seconds:.0f} s of logs",
        lead=f"Logs: {', '.join(dict.fromkeys(log.name for log in fit.logs))}.",
        parts=body,
        methods=methods,
        command=command,
    )
    return text(folder / "index.html", html)


def _warned(verdicts: Sequence[Verdict]) -> tuple[str, ...]:
    sentence = warning(verdicts)
    return (f"Warning: {sentence}.",) if sentence else ()


def _advice_table(advice: Sequence[Advice]) -> Table:
    lines = tuple(
        Line(
            (
                Cell(f"telegraph signal in {manoeuvre.axis}"),
                Cell(f"{100 * manoeuvre.amplitude:.0f}", sort=manoeuvre.amplitude),
                Cell(f"{100 * (1 - math.exp(-manoeuvre.gain)):.0f}", sort=manoeuvre.gain),
            )
        )
        for manoeuvre in advice
    )
    headings = (
        Heading("manoeuvre of a minute", words=True),
        Heading("force", "% of the largest"),
        Heading("standard deviations fall by", "%", hint="expected value, geometric mean over the numbers"),
    )
    return Table(headings, lines, "manoeuvres, the most informative first")


def _embedded(folder: Path, drawn: dict[str, Drawing]) -> dict[str, page_parts.Embedded]:
    """Write drawings into the folder `figures`, and return them for the page."""
    written = []
    for name, drawing in drawn.items():
        with style.styled():
            png, svg = style.save(drawing.canvas, folder / "figures" / name)
        written.append(Figure(name, drawing.title, drawing.caption, png, svg))
    embedded, _ = page_parts.embed(written, page_parts.Links(folder / "index.html", ()))
    return {figure.name: figure for figure in embedded}


def _some(embedded: dict[str, page_parts.Embedded], *names: str) -> tuple[page_parts.Embedded, ...]:
    return tuple(embedded[name] for name in names if name in embedded)


def validation_table(result: Validation) -> Table:
    """Return the errors of all predictors by channel and horizon; a star marks the smallest error of a channel and horizon."""
    rms = [prediction.rms() for prediction in result.predictions]
    lines = []
    for channel in result.channels:
        index = CHANNELS.index(channel)
        columns = np.array([table[:, index] for table in rms])
        if not np.isfinite(columns).any():
            continue
        for prediction, row in zip(result.predictions, columns, strict=True):
            cells = [
                Cell(
                    number(value) + _mark(value, columns[:, h]),
                    sort=None if math.isnan(value) else float(value),
                )
                for h, value in enumerate(row.tolist())
            ]
            lines.append(Line((Cell(f"{channel} ({UNITS[index]})"), Cell(prediction.name), *cells)))
    headings = (
        Heading("quantity", words=True),
        Heading("predicted by", words=True),
        *(Heading(f"{horizon:g} s") for horizon in HORIZONS),
    )
    notes = (
        f"Root mean square errors over {result.windows} windows; * marks the smallest error of a quantity at a time. A dash: too"
        " few windows have a measurement at this time.",
    )
    return Table(headings, tuple(lines), "errors after each time", notes, lead=2)


def _mark(value: float, column: np.ndarray) -> str:
    return "*" if math.isfinite(value) and value == np.nanmin(column) else ""


def summary_table(result: Validation) -> Table:
    """Return a table of the predictors: error relative to the error of holding the initial state, and coverage of the bands."""
    lines = []
    for prediction in sorted(result.predictions, key=result.skill):
        coverage, skill = prediction.coverage(), result.skill(prediction)
        lines.append(
            Line(
                (
                    Cell(prediction.name),
                    Cell(number(skill), sort=skill),
                    Cell(NOTHING if coverage is None else f"{100 * coverage:.0f}", sort=coverage),
                )
            )
        )
    headings = (
        Heading("predicted by", words=True),
        Heading(
            "error relative to holding the value",
            hint="geometric mean over quantities and times; below 1 is better than holding the value",
        ),
        Heading("coverage", "%", hint=f"share of measurements within the {100 * BAND:.0f} % bands"),
    )
    notes = (
        f"Only sheets from auvbench identify have {100 * BAND:.0f} % bands; on logs like the logs of the identification, the bands"
        f" should contain 85 to 95 % of the measurements.",
    )
    return Table(headings, tuple(lines), "sheets, the best first", notes)


def validation_text(result: Validation) -> str:
    """Return the tables of a validation for the terminal."""
    return "\n".join([_printed(validation_table(result)), _printed(summary_table(result))])


def write_validation(folder: Path, result: Validation, *, command: str) -> Path:
    """Write figures and the page of a validation; return the page's path.

    Raises:
        OSError: a file cannot be written.
    """
    embedded = _embedded(folder, {"errors": figures.errors(result)})
    best: Prediction = min(result.predictions, key=result.skill)
    headline = (
        "No sheet predicts the logs better than holding the value"
        if best.name == HOLD
        else f"{best.name} predicts the logs best"
    )
    seconds = sum(log.duration for log in result.logs)
    html = document(
        "identification.html",
        ("tables.js",),
        title="auvbench validate",
        headline=headline,
        lead=f"{len(result.logs)} log{'s' if len(result.logs) > 1 else ''}, {seconds:.0f} s:"
        f" {', '.join(dict.fromkeys(log.name for log in result.logs))}.",
        parts=(
            Part("answer", "Sheets", (), (summary_table(result),), _some(embedded, "errors")),
            Part("errors", "Errors", (), (validation_table(result),)),
        ),
        methods=(
            "Each window starts from the state that was measured, or derived from positions and angles around its first row, and"
            " gets the commands of the log. Holding keeps each value constant; constant velocity keeps velocity and rates constant.",
            *result.remarks,
        ),
        command=command,
    )
    return text(folder / "index.html", html)
