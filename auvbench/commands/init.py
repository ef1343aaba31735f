"""`auvbench init NAME`: create a project with your own controller, learner, vehicle, task and experiment.

The project is a renamed copy of examples/auvbench-example.
"""

from __future__ import annotations

import keyword
import re
import sys
from collections.abc import Iterator, Sequence
from importlib import resources, util
from importlib.resources.abc import Traversable
from pathlib import Path

from auvbench.errors import UserError
from auvbench.grammar import Parser

OLD = "auvbench-example"
SUFFIXES = (".md", ".py", ".toml", ".yaml")
LEFT_OUT = ("build", "dist", "outputs")
"""folders that are not copied: they appear in a checkout when the example is built or run"""


def parser() -> Parser:
    parser = Parser(
        prog="auvbench init",
        description="Creates a project with your own controller, learner, task, reward, vehicle and experiment.",
    )
    parser.add_argument(
        "name", metavar="NAME", help="folder of the project; its last part is the name of the Python package"
    )
    return parser


def main(arguments: Sequence[str]) -> int:
    target = Path(parser().read(arguments).name)
    name = target.name
    if not re.fullmatch(r"[a-z][a-z0-9]*([-_][a-z0-9]+)*", name) or name == "auvbench":
        raise UserError(
            f"init {name}: must be words of lower-case letters and digits, joined by single hyphens, for example my-study"
        )
    module = name.replace("-", "_")
    if keyword.iskeyword(module) or module in sys.stdlib_module_names or util.find_spec(module) is not None:
        raise UserError(f"init {name}: Python already has a module {module}; choose another name")
    if target.exists():
        raise UserError(f"init {target}: already exists; choose another name")
    from auvbench.runs.atomic_io import storage

    with storage(f"cannot write into {target}"):
        for path, text in _files(template(), Path()):
            file = target / _renamed(str(path), name)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(_renamed(text, name), encoding="utf-8")
    print(f"wrote {target}: its README.md explains the files\nnext:")
    print(f"  cd {target} && pip install --no-deps -e .")
    print("  auvbench train -m experiment=first")
    return 0


def template() -> Traversable:
    """Return the folder of the example: in an installed wheel, or in the checkout if the installation is editable."""
    package = resources.files("auvbench")
    built = package / "template"
    return built if built.is_dir() else Path(str(package)).parent / "examples" / OLD


def _files(folder: Traversable, path: Path) -> Iterator[tuple[Path, str]]:
    """Yield the paths and texts of the template's files."""
    for entry in sorted(folder.iterdir(), key=lambda entry: entry.name):
        if entry.is_dir():
            left_out = entry.name.startswith((".", "_")) or entry.name.endswith(".egg-info")
            if not left_out and entry.name not in LEFT_OUT:
                yield from _files(entry, path / entry.name)
        elif entry.name.endswith(SUFFIXES):
            yield path / entry.name, entry.read_text(encoding="utf-8")


def _renamed(text: str, name: str) -> str:
    module = name.replace("-", "_")
    return text.replace(OLD, name).replace(OLD.replace("-", "_"), module)
