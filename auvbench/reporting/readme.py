"""The parts of a study's README that are computed: between markers, so that what a person wrote around them stays."""

from __future__ import annotations

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
from auvbench.runs.progress import duration
from auvbench.untrusted import reading
from auvbench.untrusted.text import short

PARTS = {
    "table": "Result",
    "findings": "What the numbers say",
    "figures": "Figures",
    "claims": "Claims of the study",
    "policies": "Policies",
    "provenance": "How the numbers came about",
}
"""blocks in the order of a new README, with their headings"""
FOLDED = ("findings", "provenance")
"""blocks that a reader opens with a click, their heading"""
QUESTION = "*(The question that this study answers, in one sentence: written by its author.)*"
ANSWER = (
    "*(The answer in at most five sentences of at most 25 words, written by its author: who is best, by how much, how sure "
    "that is, where it does not hold, what to use.)*"
)
CAVEATS = "*(What a reader must know before using the answer, as a list: written by its author.)*"
COMMANDS = 5
"""of training, that are shown"""


def fill(path: Path, title: str, blocks: Mapping[str, str]) -> str:
    """The text of a README with its computed blocks renewed.

    Args:
        path: the README; where it is missing, a new one is begun, with places for its author.
        title: of a new one.
        blocks: text by the name of the block; names are those of `PARTS`.

    Raises:
        UserError: as `check`.
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
    """The text of a README that has a place for each block; empty where there is none yet.

    Raises:
        UserError: it cannot be read, or a block's markers are not there, or not in their order.
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
                f"{path}: the block {name} has no place: put the lines {begin} and {end} where it belongs"
            )
    return text


def fold(summary: str, text: str) -> str:
    """Return Markdown that shows its summary, and the text on a click."""
    return f"<details><summary>{summary}</summary>\n\n{text.strip()}\n\n</details>"


def _markers(name: str) -> tuple[str, str]:
    return f"<!-- begin: {name} -->", f"<!-- end: {name} -->"


def _block(name: str, text: str) -> str:
    begin, end = _markers(name)
    return f"{begin}\n{text.strip()}\n{end}"


def provenance(runs: Sequence[RunRecord], command: str, events: Sequence[history.Line] = ()) -> str:
    """Return how the numbers came about as Markdown: runs, time, machines, versions, commands and history."""
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
    made = f"The runs were copied, and all between markers computed from the copies, by\n\n    {short(command, LONGEST)}"
    return f"{items}\n\n{_trained_by(manifests)}\n\n{made}"


LONGEST = 2000
"""characters of a command"""


def _trained_by(manifests: Sequence[Mapping[str, Any]]) -> str:
    """Return the commands that made the runs, those of the most runs first."""
    found = Counter(str(m["command"]) for m in manifests if m.get("command"))
    if not found:
        return "The commands of the trainings are not recorded."
    lines = [f"    {short(command, LONGEST)}" for command, _ in found.most_common(COMMANDS)]
    text = "The runs were trained by\n\n" + "\n".join(lines)
    if (more := len(found) - COMMANDS) > 0:
        text += f"\n\nand {counted(more, 'more different command')}, each in its run's manifest"
    return text


def _time(manifests: Sequence[Mapping[str, Any]]) -> str:
    """Return what training took by the clock and of processor cores."""
    wall, cpu = (sum(float(m.get(key) or 0.0) for m in manifests) for key in ("wall_time_s", "cpu_time_s"))
    unknown = sum(bool(m.get("wall_time_s")) and m.get("cpu_time_s") is None for m in manifests)
    but = f", without {counted(unknown, 'run')} that did not record them" if unknown else ""
    return f"trained in {duration(wall)} by the clock, one run after another; {duration(cpu)} of processor cores{but}"
