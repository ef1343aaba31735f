"""What an installation must hold, and what `--help` must not import."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from importlib import resources
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_the_list_of_packages_is_complete():
    listed = set(
        tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["packages"]
    )
    found = {
        ".".join(path.parent.relative_to(ROOT).parts)
        for top in ("auvbench", "hydra_plugins")
        for path in (ROOT / top).rglob("__init__.py")
    }
    assert listed == found | folders_of_data()


def folders_of_data() -> set[str]:
    """Folders without code whose files are installed, as setuptools names them.

    It looks at those whose names could be a package's: `test-bluerov2` is none, and is data of the package above it.
    """
    git = subprocess.run(
        ["git", "ls-files", "conf", "auvbench"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    folders = {Path(line).parent for line in git.stdout.splitlines()}
    folders = {folder for folder in folders if not (ROOT / folder / "__init__.py").is_file()} | {Path("conf")}
    names = (f.parts if f.parts[0] == "auvbench" else ("auvbench", *f.parts) for f in folders)
    return {".".join(parts) for parts in names if all(part.isidentifier() for part in parts)}


def test_the_configuration_is_installed():
    conf = resources.files("auvbench.conf")
    assert (conf / "train.yaml").is_file()
    assert (conf / "vehicle" / "bluerov2.yaml").is_file()


def imported(*arguments: str) -> set[str]:
    code = (
        "import sys; sys.argv = ['auvbench', *sys.argv[1:]]\n"
        "from auvbench.cli import main\n"
        "import contextlib, io\n"
        "with contextlib.redirect_stdout(io.StringIO()):\n"
        "    try: main(sys.argv[1:])\n"
        "    except SystemExit: pass\n"
        "print(' '.join(sorted({name.split('.')[0] for name in sys.modules})))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True
    )
    return set(done.stdout.split())


HEAVY = {"torch", "stable_baselines3", "numba", "pandas", "matplotlib", "scipy", "optuna"}


def test_help_imports_nothing_heavy():
    assert not imported("--help") & (HEAVY | {"hydra", "omegaconf", "gymnasium", "numpy", "rich"})


def test_composing_imports_no_learner():
    assert not imported("train", "--cfg", "job") & HEAVY


def test_loading_runs_for_a_report_loads_no_compiler():
    code = "import sys, auvbench.analysis.load; print(sorted({'numba', 'torch'} & sys.modules.keys()))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
