"""Measure how the code is built: `python -m benchmarks.house`, or `make house`.

It prints each measure and its goal. `--show` lists the files and reads that each number counts. New processes that make an
environment, evaluate a run, or write a report measure the imports.
"""

from __future__ import annotations

import argparse
import ast
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "auvbench"

INTEGRATION = re.compile(r"(?i:ros ?2|rclpy|gazebo|ardusub|mavlink|slurm|wandb|mlflow)|\bRay\b")
"""Foreign systems that integrations talk to."""
INTEGRATIONS = "integrations/"
"""Folder of the package's integrations."""

KINDS = {
    "agent": ("lqr", "conf/algo"),
    "task": ("docking", "conf/task"),
    "reward": ("gym_dockauv", "conf/reward"),
    "block": ("goal_error", ""),
    "range sensor": ("ping360", ""),
    "navigation sensor": ("usbl", ""),
    "disturbance": ("tether", "conf/disturbance"),
    "simulator": ("gazebo", "conf/simulator"),
    "launcher": ("slurm", "conf/launcher"),
    "tracker": ("wandb", ""),
    "command": ("bound", ""),
    "metric": ("settling_time_s", ""),
    "actuator": ("drop_weight", ""),
}
"""An example of auvbench's own for each kind, and the folder of its YAML file."""

TASKS = (
    "waypoint",
    "station_keeping",
    "trajectory_tracking",
    "path_following",
    "docking",
    "transit",
    "terrain",
    "formation",
    "rendezvous",
    "tracking",
)
"""auvbench's own tasks."""

COMPILED = re.compile(r"compiled|njit|jit|cfunc|row")
ARRAY = re.compile(r"Floats|Integers|FloatArray|IntArray|NDArray|FloatTable")

_LOADED = """
import pathlib, sys
def loaded():
    for name, module in sorted(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if name.split(".")[0] == "auvbench" and file and file.endswith(".py"):
            print("FILE", pathlib.Path(file).resolve())
"""
ENVIRONMENT = f"""{_LOADED}
import gymnasium, auvbench
environment = gymnasium.make("auvbench/Waypoint-v0", noise="none")
environment.reset(seed=0)
environment.step(environment.action_space.sample())
loaded()
"""


@dataclass(frozen=True, slots=True)
class Measure:
    """A line of the table."""

    name: str
    now: str
    goal: str
    details: Sequence[str] = ()


@cache
def sources(folder: Path = PACKAGE) -> list[tuple[Path, ast.Module]]:
    """Return the Python files of a folder with their syntax trees."""
    return [(path, ast.parse(path.read_text(encoding="utf-8"))) for path in sorted(folder.rglob("*.py"))]


@cache
def words(tree: ast.AST) -> list[tuple[str, str]]:
    """Return the names, imports and texts of a syntax tree, each after its kind, without docstrings."""
    return list(_words(tree))


def _words(tree: ast.AST) -> Iterator[tuple[str, str]]:
    alone = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Name):
            yield "name", node.id
        elif isinstance(node, ast.Attribute):
            yield "name", node.attr
        elif isinstance(node, ast.alias):
            yield "import", node.name
        elif isinstance(node, ast.ImportFrom):
            yield "import", node.module or ""
        elif isinstance(node, ast.arg):
            yield "name", node.arg
        elif isinstance(node, ast.keyword):
            yield "name", node.arg or ""
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield "name", node.name
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in alone:
            yield "text", node.value


def naming_an_integration() -> list[str]:
    """Return the core's files whose code names a foreign system."""
    found = []
    for path, tree in sources():
        place = path.relative_to(PACKAGE).as_posix()
        if not place.startswith(INTEGRATIONS) and any(INTEGRATION.search(word) for _, word in words(tree)):
            found.append(place)
    return found


def naming(kind: str) -> list[str]:
    """Return what the author of a part writes or changes, for the example of a kind: the files that name it (`names`), with its
    YAML file. An integration is a folder, and counts once.
    """
    name, folder = KINDS[kind]
    found = []
    for path, tree in sources():
        if any(names(name, tree, typed=kind == "command")):
            place = path.relative_to(PACKAGE)
            integration = place.as_posix().startswith(INTEGRATIONS) and len(place.parts) > 2
            found.append((path.parent if integration else path).relative_to(ROOT).as_posix())
    file = ROOT / folder / f"{name}.yaml"
    if folder and file.is_file():
        found.append(file.relative_to(ROOT).as_posix())
    return list(dict.fromkeys(found))


def names(name: str, tree: ast.AST, *, typed: bool = False) -> Iterator[str]:
    """Yield the names, imports and texts of a syntax tree that name a part.

    A text names it if it is the part's name, or contains it after `KEY=`, `KEY.` or `module:`, or as the word after
    `auvbench`; a word in a sentence does not. A name or an import names it if it is the part's name, in any case, or begins with it in
    CamelCase; local variables do not count, since they may be ordinary words. With `typed`, for a command, which only a
    command line names, names do not count, and imports by the very name.
    """
    text = re.compile(rf"^{name}$|[=.:]{name}(?!\w)|\bauvbench {name}\b")
    identifier = re.compile(name if typed else rf"(?i:{name})|{name.title().replace('_', '')}(?:[A-Z]\w*)?")
    variables = () if typed else local_variables(tree)
    for kind, word in words(tree):
        if kind == "text":
            found = text.search(word) is not None
        elif kind == "import":
            found = identifier.fullmatch(word.rpartition(".")[2]) is not None
        else:
            found = not typed and word not in variables and identifier.fullmatch(word) is not None
        if found:
            yield word


@cache
def local_variables(tree: ast.AST) -> set[str]:
    """Return the names of functions' arguments and variables."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    nodes = [node for function in functions for node in ast.walk(function)]
    stored = {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
    return stored | {node.arg for node in nodes if isinstance(node, ast.arg)}


def task_tests(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the line and text of each comparison with a task's name and each `isinstance` with a task's class or schema."""
    # A comparison with the name of a reward is none with a task.
    names = "|".join(name for name in TASKS if not (ROOT / "conf" / "reward" / f"{name}.yaml").is_file())
    classes = "|".join(name.title().replace("_", "") for name in TASKS)
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            pattern = rf"['\"](?:{names})['\"]"
        elif isinstance(node, ast.Call) and ast.unparse(node.func) in ("isinstance", "issubclass"):
            pattern = rf"\b(?:{classes})(?:Task)?\b"
        else:
            continue
        if re.search(pattern, ast.unparse(node)):
            yield node.lineno, ast.unparse(node)


def naming_a_task() -> list[str]:
    """Return the lines outside `tasks/` that test a task's name or class."""
    return [
        f"{path.relative_to(ROOT)}:{line}: {text}"
        for path, tree in sources()
        if path.relative_to(PACKAGE).parts[0] != "tasks"
        for line, text in task_tests(tree)
    ]


def reads(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Yield the line and text of each read of an array by a number or a numeric constant, in compiled functions.

    An array is an argument whose annotation is an array type. A constant is a name in capitals.
    """
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef):
            continue
        if not any(COMPILED.search(ast.unparse(decorator)) for decorator in function.decorator_list):
            continue
        arrays = {
            argument.arg
            for argument in function.args.args
            if argument.annotation is not None and ARRAY.search(ast.unparse(argument.annotation))
        }
        for node in ast.walk(function):
            if (
                isinstance(node, ast.Subscript)
                and isinstance(node.ctx, ast.Load)
                and isinstance(node.value, ast.Name)
                and node.value.id in arrays
                and _by_number(node.slice)
            ):
                yield node.lineno, ast.unparse(node)


def _by_number(index: ast.expr) -> bool:
    parts = index.elts if isinstance(index, ast.Tuple) else [index]
    return any(_is_number(part) for part in parts)


def _is_number(node: ast.expr) -> bool:
    if isinstance(node, ast.BinOp):
        return _is_number(node.left) or _is_number(node.right)
    if isinstance(node, ast.Slice):
        return any(part is not None and _is_number(part) for part in (node.lower, node.upper))
    name = node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""
    return isinstance(node, ast.Constant) or (len(name) > 1 and name.isupper())


def closure(code: str, folder: str) -> list[Path]:
    """Return the package's files that a program has imported when it calls `loaded()`."""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"benchmarks.house: {done.stderr.strip().splitlines()[-1]}")
    return [Path(line.split(" ", 1)[1]) for line in done.stdout.splitlines() if line.startswith("FILE ")]


def _command(*arguments: str) -> str:
    return f"{_LOADED}\nfrom auvbench.cli import main\nassert main({list(arguments)!r}) == 0\nloaded()\n"


def _closure(name: str, code: str, folder: str, goal: str) -> Measure:
    files = closure(code, folder)
    lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in files)
    shown = [path.relative_to(ROOT).as_posix() for path in files if path.is_relative_to(ROOT)]
    return Measure(f"files and lines that {name} imports", f"{len(files)}, {lines / 1000:.1f}k", goal, shown)


def measures(*, run: bool = True) -> Iterator[Measure]:
    """Yield the measures; without `run`, leave out those of imports."""
    core = naming_an_integration()
    yield Measure("files of the core that name an integration", str(len(core)), "0", core)
    tests = naming_a_task()
    yield Measure("lines outside tasks/ that ask for a task's name or class", str(len(tests)), "0", tests)
    if run:
        with tempfile.TemporaryDirectory() as folder:
            yield _closure("an environment", ENVIRONMENT, folder, "35, 6k")
            closure(_command("train", "algo=pid", "train.progress=false"), folder)
            evaluate = _command("evaluate", "outputs", "protocol.episodes=2")
            yield _closure("evaluate", evaluate, folder, "55, 10k")
            yield _closure("report", _command("report", "outputs", "--no-figures"), folder, "60, 10k")
    found = [
        f"{path.relative_to(ROOT)}:{line}: {text}" for path, tree in sources() for line, text in reads(tree)
    ]
    yield Measure("reads of an array by a number in compiled functions", str(len(found)), "0", found)
    for kind, (name, _) in KINDS.items():
        files = naming(kind)
        yield Measure(f"files that name the {kind} {name}", str(len(files)), "3", files)


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.house", description=__doc__.splitlines()[0])
    parser.add_argument("--show", action="store_true", help="list the files and reads behind each number")
    parser.add_argument(
        "--no-imports", action="store_true", help="leave out what needs a training and a test"
    )
    options = parser.parse_args(argv)
    print(f"{'measure':<62} {'now':>12} {'goal':>8}")
    for measure in measures(run=not options.no_imports):
        print(f"{measure.name:<62} {measure.now:>12} {measure.goal:>8}", flush=True)
        if options.show:
            print(*(f"    {detail}" for detail in measure.details), sep="\n")


if __name__ == "__main__":
    main()
