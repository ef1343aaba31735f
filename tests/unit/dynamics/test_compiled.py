"""The cache of compiled code follows every source that the code came from."""

import ast
import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import pytest
from numba import njit

import auvbench
from auvbench.dynamics.compiled import fingerprint, inline

PACKAGE = Path(auvbench.__file__).parent

# A house like auvbench's: the cached function reaches into its own room, and two others.
SOURCES = {
    "house/__init__.py": "",
    "house/water/__init__.py": "",
    "house/water/draws.py": "from numba import njit\n@njit\ndef draw(x): return x + 1\n",
    "house/tasks/__init__.py": "",
    "house/tasks/columns.py": "COLUMN = 10\n",
    "house/tasks/wind/__init__.py": "",
    "house/tasks/wind/limits.py": "LIMIT = 100\n",
    "house/tasks/wind/kernels.py": (
        "from auvbench.dynamics.compiled import compiled\n"
        "from house.tasks.columns import COLUMN\n"
        "from house.tasks.wind.limits import LIMIT\n"
        "from house.water.draws import draw\n"
        "@compiled('water', 'tasks')\ndef step(x): return draw(x) + COLUMN + LIMIT\n"
        "@compiled('water', 'tasks')\ndef again(x): return step(x)\n"
    ),
}
RUN = (
    "import sys; from pathlib import Path; from auvbench.dynamics import compiled\n"
    "compiled.PACKAGE = Path('house').absolute()\n"
    "sys.path.insert(0, '.')\n"
    "from house.tasks.wind.kernels import again, step\n"
    "print(step(1), sum(step.stats.cache_hits.values()), again(1))"
)


def run(folder: Path) -> list[int]:
    """Return what the function gives, and how often it came from the cache; compiling is announced once."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / "cache")}
    # Without bytecode: Python itself takes a file of the same second and length for unchanged.
    done = subprocess.run(
        [sys.executable, "-B", "-c", RUN],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    value, hits, again = map(int, done.stdout.split())
    assert value == again
    assert done.stderr.count("auvbench: compiling") == (not hits)
    return [value, hits]


@pytest.mark.slow
def test_a_change_anywhere_that_the_code_came_from_compiles_it_anew(tmp_path):
    for name, text in SOURCES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    assert run(tmp_path) == [112, 0]
    assert run(tmp_path) == [112, 1]
    expected = 112
    for name, old, new, more in (
        ("water/draws.py", "x + 1", "x + 2", 1),
        ("tasks/columns.py", "10", "20", 10),
        ("tasks/wind/limits.py", "100", "300", 200),
    ):
        file = tmp_path / "house" / name
        file.write_text(file.read_text().replace(old, new))
        expected += more
        assert run(tmp_path) == [expected, 0], name
    assert run(tmp_path) == [expected, 1]


COLUMNS = (
    "from auvbench.dynamics.compiled import compiled\n"
    "@compiled()\ndef total(table, counts):\n"
    "    x = 0.0\n"
    "    for i in range(len(counts)):\n        x += table[i].size * counts[i]\n    return x\n"
)
PARALLEL = (
    "import sys; sys.path.insert(0, '.')\n"
    "import numpy as np; from columns import total\n"
    "both = np.ones(3, [('size', 'f8'), ('count', 'i8'), ('own', 'f8')])\n"
    "table, counts = both[['size', 'count']], both['count']\n"
    "found = [total(table[:n], counts[:n]) for n in (1, 3, 1)]\n"
    "print(*found, len(total.overloads), sum(total.stats.cache_hits.values()))"
)


@pytest.mark.slow
def test_processes_compile_a_function_once_for_tables_of_one_row_and_of_several(tmp_path: Path) -> None:
    (tmp_path / "columns.py").write_text(COLUMNS)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    command = [sys.executable, "-B", "-c", PARALLEL]
    processes = [
        subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, text=True)
        for _ in range(3)
    ]
    lines = sorted(process.communicate(timeout=300)[0].strip() for process in processes)
    assert lines == ["1.0 3.0 1.0 1 0", *["1.0 3.0 1.0 1 1"] * 2]


def decorations(function: ast.FunctionDef, name: str) -> list[ast.expr]:
    return [d for d in function.decorator_list if ast.unparse(d).split("(")[0] == name]


def rooms_used(source: ast.Module, functions: Iterable[ast.FunctionDef]) -> set[Path]:
    """The folders of the package that names in the bodies of a module's `functions` come from."""
    origin = {}
    for node in ast.walk(source):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("auvbench."):
            file = PACKAGE.joinpath(*str(node.module).split(".")[1:])
            origin |= {alias.name: file if file.is_dir() else file.parent for alias in node.names}
    nodes = [n for function in functions for line in function.body for n in ast.walk(line)]
    return {origin[n.id] for n in nodes if isinstance(n, ast.Name) and n.id in origin}


@pytest.mark.slow
def test_the_cache_looks_wherever_the_code_came_from():
    checked = []
    plain = {}  # by room: what functions that are compiled into others use
    sources = {path: ast.parse(path.read_text()) for path in PACKAGE.rglob("*.py")}
    defined = {
        p: [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)] for p, tree in sources.items()
    }
    for path, functions in defined.items():
        inner = [f for f in functions if any(decorations(f, name) for name in ("njit", "inline", "compiled"))]
        plain[path.parent] = plain.get(path.parent, set()) | rooms_used(sources[path], inner)
    for path, functions in defined.items():
        inner = [f for f in functions if decorations(f, "njit") or decorations(f, "inline")]
        for function in functions:
            for decoration in decorations(function, "compiled"):
                assert isinstance(decoration, ast.Call)
                looked = {path.parent} | {PACKAGE / ast.literal_eval(room) for room in decoration.args}
                used = rooms_used(sources[path], [function, *inner])
                used |= {further for room in used for further in plain.get(room, ())}
                assert used <= looked, f"{path}: {function.name}"
                checked.append(function.name)
    assert {"add_command_noise", "advance"} <= set(checked)


def test_nothing_is_cached_in_another_way():
    found = [path.name for path in PACKAGE.rglob("*.py") if "cache=True" in path.read_text()]
    assert found == ["compiled.py"]


def test_fingerprint_follows_content_and_names(tmp_path):
    def taken() -> str:
        fingerprint.cache_clear()
        return fingerprint(tmp_path)

    (tmp_path / "a.py").write_text("x = 1\n")
    first = taken()
    assert first == taken()
    (tmp_path / "a.py").write_text("x = 2\n")
    assert taken() != first
    (tmp_path / "a.py").write_text("x = 1\n")
    assert taken() == first
    (tmp_path / "a.py").rename(tmp_path / "b.py")
    assert taken() != first


@inline
def doubled(x: float) -> float:
    return 2.0 * x


@njit
def doubled_and_one(x: float) -> float:
    return doubled(x) + 1.0


def test_python_runs_the_source_of_an_inlined_function() -> None:
    """Nothing is compiled for Python's sake."""
    assert doubled(3.0) == 6.0
    assert doubled.signatures == []
    assert doubled_and_one(3.0) == 7.0
    assert len(doubled.signatures) == 1
