"""What an installation must hold, and what `--help` must not import."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from importlib import resources
from itertools import takewhile
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
PLACES = {"conf": "auvbench/conf", "examples/auvbench-example": "auvbench/template"}
"""folders of the repository that an installation has elsewhere"""


def test_the_list_of_packages_is_complete():
    listed = set(
        tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["packages"]
    )
    found = {
        ".".join(path.parent.relative_to(ROOT).parts) for path in (ROOT / "auvbench").rglob("__init__.py")
    }
    assert listed == found | folders_of_data()


def kept() -> list[Path]:
    """Files of the package that git keeps, by their place in an installation."""
    git = subprocess.run(
        ["git", "ls-files", "conf", "auvbench", *PLACES], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return [placed(Path(line)) for line in git.stdout.splitlines()]


def placed(path: Path) -> Path:
    for folder, place in PLACES.items():
        if path.is_relative_to(folder):
            return Path(place) / path.relative_to(folder)
    return path


def folders_of_data() -> set[str]:
    """Folders without code whose files are installed, as setuptools names them.

    A folder whose name no package could have, such as `test-bluerov2`, is data of the one above it.
    """
    found = set()
    for folder in {path.parent for path in kept()}:
        named = list(takewhile(str.isidentifier, folder.parts))
        if not ROOT.joinpath(*named, "__init__.py").is_file():
            found.add(".".join(named))
    return found


def test_a_build_takes_every_file_and_warns_of_none(tmp_path):
    code = (
        "import sys; from setuptools import Distribution\n"
        "built = Distribution({'script_name': 'setup.py'})\n"
        "built.parse_config_files()\n"
        "built.get_command_obj('egg_info').egg_base = sys.argv[1]\n"  # leaves nothing here
        "step = built.get_command_obj('build_py')\n"
        "step.build_lib = 'lib'; step.ensure_finalized()\n"
        "print('\\n'.join(step.get_outputs(include_bytecode=False)))"
    )
    done = subprocess.run(
        [sys.executable, "-W", "always", "-c", code, tmp_path],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert "absent from" not in done.stderr
    taken = {Path(line).relative_to("lib") for line in done.stdout.splitlines() if line.startswith("lib")}
    assert not set(kept()) - taken


def test_the_citation_has_the_version_of_the_package():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert (citation["version"], citation["license"]) == (project["version"], project["license"])
    zenodo = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
    assert (zenodo["version"], zenodo["license"]) == (project["version"], project["license"].lower())
    assert (zenodo["title"], zenodo["keywords"]) == (citation["title"], citation["keywords"])
    assert zenodo["publication_date"] == str(citation["date-released"])
    assert [one["name"] for one in zenodo["creators"]] == [one["name"] for one in citation["authors"]]


def test_the_configuration_is_installed():
    conf = resources.files("auvbench.conf")
    assert (conf / "train.yaml").is_file()
    assert (conf / "vehicle" / "bluerov2.yaml").is_file()


NOT_ON_WINDOWS = """
import os, signal, sys
for name in ("fcntl", "grp", "pty", "pwd", "resource", "termios", "tty"):
    sys.modules[name] = None
for module, names in (os, ("fork", "forkpty", "killpg", "register_at_fork")), (signal, ("SIGHUP", "SIGKILL", "SIGUSR1")):
    for name in names:
        delattr(module, name)
"""


@pytest.mark.parametrize(
    "arguments",
    [
        ("--help",),
        ("--version",),
        pytest.param(("train", "--help"), marks=pytest.mark.slow),
        pytest.param(("vehicles", "rexrov"), marks=pytest.mark.slow),
    ],
)
def test_nothing_is_imported_at_start_that_windows_lacks(arguments):
    code = f"{NOT_ON_WINDOWS}\nfrom auvbench.cli import main\nsys.exit(main(sys.argv[1:]))"
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.slow
def test_environments_run_without_what_windows_lacks():
    code = f"{NOT_ON_WINDOWS}\nimport auvbench, gymnasium\ne = gymnasium.make('auvbench/Waypoint-v1')\ne.reset()\ne.step(e.action_space.sample())"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.slow
def test_a_run_without_file_locks_is_refused_in_one_line():
    code = f"{NOT_ON_WINDOWS}\nfrom auvbench.cli import main\nsys.exit(main(['runs', '.']))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "fcntl" in done.stderr


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


@pytest.mark.slow
def test_composing_imports_no_learner():
    assert not imported("train", "--cfg", "job") & HEAVY


@pytest.mark.slow
def test_a_report_loads_no_compiler():
    modules = ", ".join(
        f"auvbench.{name}"
        for name in ("analysis.load", "analysis.optional_columns", "reporting.write", "reporting.page")
    )
    code = f"import sys, {modules}; print(sorted({{'hydra', 'numba', 'torch'}} & sys.modules.keys()))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.slow
def test_the_folder_that_contains_the_clone_does_not_hide_the_package(tmp_path):
    (tmp_path / "auvbench" / "auvbench").mkdir(parents=True)  # as a clone looks from there
    sites = tmp_path / "sites"
    sites.mkdir()
    subprocess.run(["make", "-s", "-C", ROOT, "clone-path", f"SITE={sites}"], check=True)
    code = f"import site; site.addsitedir({str(sites)!r}); import auvbench; print(auvbench.__version__)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip()
