"""`auvbench init NAME`: a project of your own, with a controller, a learner, a vehicle, a task and an experiment.

The project is a copy of examples/auvbench-example under another name.
"""

from __future__ import annotations

import keyword
import re
import sys
from collections.abc import Iterator, Sequence
from importlib import resources, util
from importlib.resources.abc import Traversable
from pathlib import Path

from auvbench.commands.grammar import Parser
from auvbench.errors import UserError

OLD = "auvbench-example"
SUFFIXES = (".md", ".py", ".toml", ".yaml")
LEFT_OUT = ("build", "dist", "outputs")
"""folders that building and running the example leave in a checkout"""
README = """\
# {name}

A package with a controller (`algo=pursuit`), a learner (`algo=search`), a task (`task=circling`), a reward (`reward=view`), a vehicle
and an experiment for auvbench. Change them, or add files next to them.

    pip install --no-deps -e .
    auvbench train -m experiment=first
    auvbench evaluate outputs/first protocol=own
    auvbench report outputs/first --protocol own

| file | holds |
|---|---|
| `{module}/pursuit.py`, `{module}/conf/algo/pursuit.yaml` | a controller and its values |
| `{module}/search.py`, `{module}/conf/algo/search.yaml` | a learner and its values |
| `{module}/circling.py`, `{module}/conf/task/circling.yaml` | a task with code of its own and its values |
| `{module}/view.py`, `{module}/conf/reward/view.yaml` | a reward and its values |
| `conf/vehicle/my_vehicle.yaml` | a vehicle: `vehicle=my_vehicle` |
| `conf/task/my_task.yaml` | a task with other values than auvbench's: `task=my_task` |
| `conf/experiment/first.yaml` | a study: `experiment=first` |
| `tests/` | `pytest`: the rules that each controller and each task must keep |

auvbench reads `./conf` of the folder in which it runs, so type its commands here.
"""


def parser() -> Parser:
    parser = Parser(
        prog="auvbench init",
        description="Makes a project with a controller, a learner, a task, a reward, a vehicle and an experiment of your own.",
    )
    parser.add_argument(
        "name", metavar="NAME", help="the folder; its last part is the name of the Python package"
    )
    return parser


def main(arguments: Sequence[str]) -> int:
    target = Path(parser().read(arguments).name)
    name = target.name
    if not re.fullmatch(r"[a-z][a-z0-9]*([-_][a-z0-9]+)*", name) or name == "auvbench":
        raise UserError(
            f"init {name}: must be a name of small letters, digits and single hyphens, for example my-study"
        )
    module = name.replace("-", "_")
    if keyword.iskeyword(module) or module in sys.stdlib_module_names or util.find_spec(module) is not None:
        raise UserError(f"init {name}: Python has something named {module} already; choose another name")
    if target.exists():
        raise UserError(f"init {target}: exists already; choose another name")
    from auvbench.runs.atomic_io import storage

    with storage(f"cannot write into {target}"):
        for path, text in _files(template(), Path()):
            _write(target / _renamed(str(path), name), _renamed(text, name))
        _write(target / "README.md", README.format(name=name, module=module))
    print(f"wrote {target}: its README.md names the files\nnext:")
    print(f"  cd {target} && pip install --no-deps -e .")
    print("  auvbench train -m experiment=first")
    return 0


def template() -> Traversable:
    """Return the folder of the example: a part of the wheel, or of the checkout that is installed with `pip -e`."""
    package = resources.files("auvbench")
    built = package / "template"
    return built if built.is_dir() else Path(str(package)).parent / "examples" / OLD


def _files(folder: Traversable, path: Path) -> Iterator[tuple[Path, str]]:
    """Yield the template's text files with their paths."""
    for entry in sorted(folder.iterdir(), key=lambda entry: entry.name):
        if entry.is_dir():
            left_out = entry.name.startswith((".", "_")) or entry.name.endswith(".egg-info")
            if not left_out and entry.name not in LEFT_OUT:
                yield from _files(entry, path / entry.name)
        elif entry.name.endswith(SUFFIXES) and entry.name != "README.md":
            yield path / entry.name, entry.read_text(encoding="utf-8")


def _renamed(text: str, name: str) -> str:
    module = name.replace("-", "_")
    return text.replace(OLD, name).replace(OLD.replace("-", "_"), module)


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
