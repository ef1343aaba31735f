"""Fill the computed blocks of a study's README between markers, without changing the author's text."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from auvbench.analysis.formatting import counted
from auvbench.analysis.records import RunRecord
from auvbench.errors import UserError
from auvbench.reporting.tables.text_formats import escape
from auvbench.reporting.write import facts
from auvbench.runs import history
from auvbench.runs.identity import DEFAULT_TASK, DEFAULT_VEHICLE
from auvbench.runs.progress import duration
from auvbench.untrusted import reading
from auvbench.untrusted.text import short

PARTS = {
    "table": "Result",
    "conditions": "Conditions",
    "findings": "What the numbers say",
    "figures": "Figures",
    "claims": "Claims of the study",
    "policies": "Policies",
    "provenance": "How the numbers came about",
}
"""headings of the blocks by name, in the order of a new README"""
FOLDED = ("findings", "provenance")
"""blocks that are folded; a click on the heading opens them"""
QUESTION = "*(The question that this study answers, in one sentence: written by its author.)*"
ANSWER = (
    "*(The answer in at most five sentences of at most 25 words, written by its author: who is best, by how much, how sure "
    "that is, where it does not hold, what to use.)*"
)
CAVEATS = "*(What a reader must know before using the answer, as a list: written by its author.)*"
COMMANDS = 5
"""largest number of training commands to show"""


def fill(path: Path, title: str, blocks: Mapping[str, str]) -> str:
    """Return the text of a README with new contents of its computed blocks.

    Args:
        path: path of the README; if it is missing, the text is a new README with placeholders for the author.
        title: title of a new README.
        blocks: text of each block, by a name in `PARTS`.

    Raises:
        UserError: see `check`.
    """
    blocks = {n: fold(PARTS[n], text) if n in FOLDED else text for n, text in blocks.items()}
    if not path.exists():
        parts = [f"# {title}", "## Question", QUESTION, "## Answer", ANSWER]
        for name, heading in PARTS.items():
            if name in blocks:
                parts += [*([] if name in FOLDED else [f"## {heading}"]), _block(name, blocks[name])]
        parts[-1:] = ["## Caveats", CAVEATS, *parts[-1:]]
        return "\n\n".join(parts) + "\n"
    text = check(path, blocks)
    for name, content in blocks.items():
        begin, end = _markers(name)
        text = text[: text.index(begin)] + _block(name, content) + text[text.index(end) + len(end) :]
    return text


def check(path: Path, names: Iterable[str]) -> str:
    """Return the text of a README after checking that it has a place for each block; '' if the file is
    missing.

    Raises:
        UserError: the file cannot be read, or a block's markers are missing or out of order.
    """
    try:
        text = reading.content(path).decode("utf-8")
    except FileNotFoundError:
        return ""
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: cannot be read: {short(error)}") from error
    for name in names:
        begin, end = _markers(name)
        if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
            raise UserError(
                f"{path}: the block {name} is missing: add the lines {begin} and {end} where it belongs"
            )
    return text


def has(path: Path, name: str) -> bool:
    """Return whether a README has a place for a block."""
    return _markers(name)[0] in check(path, ())


def fold(summary: str, text: str) -> str:
    """Return Markdown that shows a summary; a click on the summary opens the text."""
    return f"<details><summary>{summary}</summary>\n\n{text.strip()}\n\n</details>"


def _markers(name: str) -> tuple[str, str]:
    return f"<!-- begin: {name} -->", f"<!-- end: {name} -->"


def _block(name: str, text: str) -> str:
    begin, end = _markers(name)
    return f"{begin}\n{text.strip()}\n{end}"


def provenance(runs: Sequence[RunRecord], command: str, events: Sequence[history.Line] = ()) -> str:
    """Return the provenance of a study's numbers as Markdown: runs, time, machines, versions, commands and history."""
    manifests = [run.manifest for run in runs]
    days = sorted(str(m[key])[:10] for m in manifests for key in ("started", "ended") if m.get(key))
    steps = sum(int(m.get("steps") or 0) for m in manifests)
    tested = sum(len(e.episodes) for run in runs for e in run.evaluations.values())
    lines = [
        f"{counted(len(runs), 'run')}, {steps:,} environment steps of training, {tested:,} test episodes",
        f"{_time(manifests)}; how long the tests took is not recorded",
        *(f"{name.lower()}: {'; '.join(values)}" for name, values in facts(runs)),
    ]
    if events:
        lines.append(f"{history.FILE} has {history.summary(events, [run.id for run in runs])}")
    if days:
        lines.append(f"dates: {days[0]}" + (f" to {days[-1]}" if days[-1] != days[0] else ""))
    items = "\n".join(f"* {escape(line)}" for line in lines)
    source = f"The runs were copied, and all between markers computed from the copies, by\n\n    {short(command, LONGEST)}"
    return f"{items}\n\n{_trained_by(runs)}\n\n{source}"


LONGEST = 2000
"""largest number of shown characters of a command"""


def _trained_by(runs: Sequence[RunRecord]) -> str:
    """Return the commands that trained the runs as Markdown, sorted by the number of runs, the largest number first."""
    commands = Counter(str(run.manifest["command"]) for run in runs if run.manifest.get("command"))
    if not commands:
        return "The commands of the trainings are not recorded."
    lines = [f"    {short(command, LONGEST)}" for command, _ in commands.most_common(COMMANDS)]
    text = "The runs were trained by\n\n" + "\n".join(lines)
    if (more := len(commands) - COMMANDS) > 0:
        text += f"\n\nand {counted(more, 'more different command')}, each in its run's manifest"
    earlier = [run for run in runs if run.config.get("vehicle.name") == DEFAULT_VEHICLE]
    if any(not re.search(r"\b(vehicle|experiment)=", str(run.manifest.get("command"))) for run in earlier):
        text += (
            f"\n\nWhere a command names no vehicle, add vehicle={DEFAULT_VEHICLE}, and without a task task={DEFAULT_TASK}: they were "
            "the defaults."
        )
    return text


def _time(manifests: Sequence[Mapping[str, Any]]) -> str:
    """Return the wall time and processor time of the trainings as text."""
    wall, cpu = (sum(float(m.get(key) or 0.0) for m in manifests) for key in ("wall_time_s", "cpu_time_s"))
    unknown = sum(bool(m.get("wall_time_s")) and m.get("cpu_time_s") is None for m in manifests)
    but = f", without {counted(unknown, 'run')} that did not record them" if unknown else ""
    return f"trained in {duration(wall)} by the clock, one run after another; {duration(cpu)} of processor cores{but}"
