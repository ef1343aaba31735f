"""Count how plain the texts are: `python -m benchmarks.words`, or `make words`.

Four groups: pages (README, docs, studies), docstrings, messages (errors, help, progress), and comments (code and conf/). For each it prints sentences, their
length, and how often patterns occur that make a reader read a sentence twice. `--show N` lists the N longest sentences of each
group, `--sample N` draws N docstrings, messages and comments to read aloud.
"""

from __future__ import annotations

import argparse
import ast
import random
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
LONG = 25
"""most words of a sentence; longer sentences are counted"""
NUMBERS = 2
"""most numbers of a sentence; sentences with more are counted"""
AVOIDED = {
    "roundabout": r"\b(?:beside|whoever|nobody|anybody|somebody|whatever|wherever|of which|is told|says so|there is none)\b",
    "points back": r"\b(?:those of|that of|the other|such|both)\b",
    "is no": r"\b(?:is|are|was|were) no (?!longer|more|less|fewer)\w+",
    "vague verb": r"\b(?:holds?|lies|stands?)\b",
}
"""patterns of the table, by title"""
NAMES = frozenset(("found", "held", "told", "kept", "made", "there", "who", "one"))
"""names of local variables that do not say what they are"""
MESSAGES = frozenset(("print", "say", "_say", "note", "warn", "add_argument", "add"))
"""functions whose texts a user reads; errors that are raised count as well"""

_GENERATED = re.compile(
    r"<!-- (?:begin|measured): .*?<!-- end[^>]*>|<!-- (\S+): begin -->.*?<!-- \1: end -->|^```.*?^```|^    [^\n]*|^\|[^\n]*"
    r"|<!--.*?-->|^---\n.*?^---\n",
    re.DOTALL | re.MULTILINE,
)
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d[\d,]*(?:\.\d+)?")


@dataclass(frozen=True, slots=True)
class Text:
    """One text that a person reads, with its place."""

    place: str
    content: str

    def sentences(self) -> list[str]:
        """Return the text's sentences, without code and targets of links."""
        plain = re.sub(r"`[^`]*`", "code", re.sub(r"\]\([^)]*\)", "]", self.content))
        parts = re.split(
            r"\n\s*\n(?!\s*[*-]\s)|\n\s*(?:(?:[*-]|\d+\.)\s|(?=\w+:\s))|(?<=[.!?:;])\s+(?=[\[*A-Z{])", plain
        )
        return [" ".join(part.split()) for part in parts if len(part.split()) > 1]


def pages() -> Iterator[Text]:
    """Yield each paragraph of a page, without tables, code and generated blocks."""
    files = [
        ROOT / "README.md",
        *sorted((ROOT / "docs").glob("*.md")),
        *sorted((ROOT / "results").glob("*/README.md")),
    ]
    for path in files:
        if path.name not in ("configuration.md", "verification.md"):  # pages that a program writes
            yield Text(str(path.relative_to(ROOT)), _GENERATED.sub("\n", path.read_text(encoding="utf-8")))


def docstrings() -> Iterator[Text]:
    """Yield each docstring of the package, also of fields."""
    for path, tree in _modules():
        for node in ast.walk(tree):
            if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                continue
            for statement in node.body:
                value = statement.value if isinstance(statement, ast.Expr) else None
                if isinstance(value, ast.Constant) and isinstance(value.value, str):
                    yield Text(f"{path}:{statement.lineno}", value.value)


def messages() -> Iterator[Text]:
    """Yield each text of an error, of help and of progress; `{}` stands for a value."""
    for path, tree in _modules():
        for node in ast.walk(tree):
            call = node.exc if isinstance(node, ast.Raise) else node
            if not isinstance(call, ast.Call):
                continue
            name = getattr(call.func, "id", getattr(call.func, "attr", ""))
            if not (isinstance(node, ast.Raise) or name in MESSAGES):
                continue
            for argument in [*call.args, *(k.value for k in call.keywords)]:
                text = _literal(argument)
                if len(text.split()) > 2:
                    yield Text(f"{path}:{call.lineno}", text)


def comments() -> Iterator[Text]:
    """Yield each comment of the package and of conf/; comments on consecutive lines are one."""
    for path in [*sorted((ROOT / "auvbench").rglob("*.py")), *sorted((ROOT / "conf").rglob("*.yaml"))]:
        text = path.read_text(encoding="utf-8")
        for match in re.finditer(r"(?m)(?<![\"'\w])# (?!type:|noqa|fmt:|---)(.*(?:\n[ ]*# .*)*)", text):
            place = f"{path.relative_to(ROOT)}:{text.count(chr(10), 0, match.start()) + 1}"
            yield Text(place, re.sub(r"\n *# ", " ", match[1]))


def _modules() -> Iterator[tuple[str, ast.Module]]:
    for path in sorted((ROOT / "auvbench").rglob("*.py")):
        yield str(path.relative_to(ROOT)), ast.parse(path.read_text(encoding="utf-8"))


def _literal(node: ast.expr) -> str:
    """Return the text of a string, or of parts joined by `+` or an f-string."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else ""
    if isinstance(node, ast.JoinedStr):
        return "".join(_literal(v) if isinstance(v, ast.Constant) else "{}" for v in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return _literal(node.left) + _literal(node.right)
    return ""


def vague_names() -> int:
    """Return how many local variables of the package have a name in `NAMES`."""
    return sum(
        isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id in NAMES
        for _, tree in _modules()
        for node in ast.walk(tree)
    )


def row(texts: Sequence[Text]) -> list[str]:
    """Return the cells of one group: sentences, mean words, share of long ones, share with many numbers, patterns."""
    sentences = [sentence for text in texts for sentence in text.sentences()]
    count = max(len(sentences), 1)
    lengths = [len(sentence.split()) for sentence in sentences]
    long = sum(length > LONG for length in lengths)
    numerous = sum(len(_NUMBER.findall(sentence)) > NUMBERS for sentence in sentences)
    patterns = [
        sum(len(re.findall(pattern, sentence, re.IGNORECASE)) for sentence in sentences)
        for pattern in AVOIDED.values()
    ]
    return [
        f"{len(sentences):,}",
        f"{sum(lengths) / count:.1f}",
        f"{100 * long / count:.1f} %",
        f"{100 * numerous / count:.1f} %",
        *map(str, patterns),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--show", type=int, default=0, metavar="N", help="list the N longest sentences of each group"
    )
    parser.add_argument(
        "--sample", type=int, default=0, metavar="N", help="draw N docstrings, messages and comments to read"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the sample (default: 0)")
    given = parser.parse_args()
    groups = {name.__name__: list(name()) for name in (pages, docstrings, messages, comments)}
    table = [["", "sentences", "words each", f"over {LONG} words", f"over {NUMBERS} numbers", *AVOIDED]]
    table += [[name, *row(texts)] for name, texts in groups.items()]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    for cells in table:
        print(
            "  ".join(
                cell.rjust(width) if i else cell.ljust(width)
                for i, (cell, width) in enumerate(zip(cells, widths, strict=True))
            )
        )
    print(f"\nlocal variables named {', '.join(sorted(NAMES))}: {vague_names()}")
    for name, texts in groups.items() if given.show else ():
        longest = sorted(
            ((s, t.place) for t in texts for s in t.sentences()), key=lambda x: -len(x[0].split())
        )
        print(f"\n{name}:")
        for sentence, place in longest[: given.show]:
            print(f"* {place} ({len(sentence.split())} words): {sentence}")
    pool = [text for name, texts in groups.items() if name != "pages" for text in texts]
    for text in random.Random(given.seed).sample(pool, min(given.sample, len(pool))):
        print(f"\n{text.place}\n  {' '.join(text.content.split())}")


if __name__ == "__main__":
    main()
