"""Every path that a module makes of something it did not write itself comes from `path_safety.child`.

The modules are those that read files of other people. A new join there is either a `child`, or is added to `KNOWN` with
the reason why no file decides its text.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import auvbench

ROOT = Path(auvbench.__file__).parent

READERS = (
    "auvbench.untrusted.reading",
    "auvbench.untrusted.typed_json",
    "auvbench.untrusted.archives",
    "auvbench.runs.integrity",
    "auvbench.runs.integrity",
    "auvbench.training.checkpoint.store",
)
"""modules whose importers read files of other people"""

PATH = re.compile(
    r"(path|folder|directory|run|runs|root|target|there|here|parent|staged|staging|place|model|train|copy|study|former"
    r"|source|out|output|journal|Path|cwd|absolute|resolve|evaluation)$"
)
"""names of paths, which a division of numbers does not have"""

TYPED = "typed by the user, and checked by the schema of the configuration"
OWN = "written in the code, or a number"

KNOWN = {
    ("analysis/archive.py", "self.folder / name"): OWN,
    ("commands/tune.py", "Path(output) / 'tune' / name"): TYPED,
    ("config/restricted_yaml.py", "os.path.join(os.path.basename(self.path), name)"): TYPED,
    ("config/restricted_yaml.py", "folder / name"): TYPED,
    ("config/restricted_yaml.py", "os.path.join(self.path, name)"): TYPED,
    (
        "config/restricted_yaml.py",
        "os.path.join(os.path.basename(os.path.dirname(path)), os.path.basename(path))",
    ): TYPED,
    ("evaluation/parts.py", "self.folder / str(number)"): OWN,
    ("evaluation/bounds/files.py", "root / f'{protocol}-{vehicle}'"): TYPED,
    ("reporting/archive.py", "folder / name"): OWN,
    ("reporting/entries.py", "folder / name"): OWN,
    ("runs/directory.py", "Path(config['output']) / config['name']"): TYPED,
    ("runs/directory.py", "Path(config['output']) / config['name'] / identity.run_id(config)"): TYPED,
    ("runs/directory.py", "self.model / name"): OWN,
    ("runs/directory.py", "self.path / 'evaluations' / protocol"): TYPED,
    ("training/checkpoint/store.py", "folder / self.name"): OWN,
    ("training/checkpoint/saver.py", "self.folder / segment.name"): OWN,
    ("training/checkpoint/saver.py", "run / name"): OWN,
    ("training/checkpoint/extending.py", "target_store.folder / str(checkpoint.step)"): OWN,
    ("training/checkpoint/extending.py", "target_store.replay_folder / segment.name"): OWN,
    ("training/checkpoint/extending.py", "source_store.replay_folder / segment.name"): OWN,
    ("training/checkpoint/store.py", "self.folder / str(step)"): OWN,
    ("training/execute.py", "run.model / name"): OWN,
    ("training/learning.py", "run.path / name"): OWN,
}


def test_no_file_decides_a_path() -> None:
    found = {
        (str(file.relative_to(ROOT)), join)
        for file in sorted(ROOT.rglob("*.py"))
        for tree in [ast.parse(file.read_text(encoding="utf-8"))]
        if _imports(tree) & {*READERS}
        for join in _joins(tree)
    }
    assert found - KNOWN.keys() == set(), "make the path with auvbench.untrusted.path_safety.child"
    assert KNOWN.keys() - found == set(), "these are gone: remove them"


def test_the_rule_sees_a_join() -> None:
    """Of the kinds that emptied a user's file, and none that is fixed text."""
    code = """
from auvbench.untrusted import reading
def f(run, target, found, MANIFEST):
    for name, mark in found["logs"].items():
        (target / name).write_bytes((run.path / found[0]).read_bytes())
    target.joinpath(found); os.path.join(run, found); run.path / "train" / f"{found}.csv"
    return run.path / "train" / MANIFEST, found["a"] / 2.0, target / f"{MANIFEST}.csv", child(run, name)
"""
    assert len(set(_joins(ast.parse(code)))) == 5


def _imports(tree: ast.Module) -> set[str]:
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{name.name}" for name in node.names)}
    return found


def _joins(tree: ast.Module) -> Iterator[str]:
    """Yield the source of each join of a path with a text that is not fixed."""
    for node in ast.walk(tree):
        right: list[ast.expr] = []
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div) and _is_path(node.left):
            right = [node.right]
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith((".joinpath", "os.path.join")):
            right = node.args[1:] if "os.path" in ast.unparse(node.func) else node.args
        if not all(map(_is_fixed, right)):
            yield ast.unparse(node)


def _is_path(node: ast.expr) -> bool:
    if isinstance(node, ast.BinOp):
        return isinstance(node.op, ast.Div) and (_is_path(node.left) or _is_fixed(node.right))
    return bool(PATH.search(_name(node)))


def _is_fixed(node: ast.expr) -> bool:
    """Whether a text is written in the code: a literal, or a constant by its name."""
    if isinstance(node, ast.JoinedStr):
        return all(_is_fixed(part) for part in node.values)
    if isinstance(node, ast.FormattedValue):
        return _is_fixed(node.value)
    return (
        isinstance(getattr(node, "value", None), str)
        if isinstance(node, ast.Constant)
        else _name(node).isupper()
    )


def _name(node: ast.expr) -> str:
    """Return the last name in an expression: `path` of `run.path`, `absolute` of `run.absolute()`."""
    if isinstance(node, ast.Call):
        return _name(node.func)
    return str(getattr(node, "attr", getattr(node, "id", "")))
