"""Every command line of README.md and docs/ is one that auvbench takes: flags are parsed, configurations composed."""

from __future__ import annotations

import importlib
import re
import shlex
from pathlib import Path

import pytest

from auvbench.config import grids
from auvbench.config.compose import compose, read
from auvbench.registry import COMMANDS
from tests.docs_blocks import MISTAKES, PAGES, steps

MADE_BY_THE_READER = re.compile(r"polyu|pursuit|my_agent|circling|mine\.onnx|train .*vehicle=mine|\.\.\.")
COMPOSED = ("train", "tune", "simulate")


def commands() -> list[str]:
    """Return the command lines without redirections and without those that need a file of the reader."""
    lines = {
        re.sub(r"\s+>.*", "", text) for page in PAGES for kind, text in steps(page) if kind == "auvbench"
    }
    known = {line for line in lines if line.split()[0] in COMMANDS}
    return sorted({line for line in known if not MADE_BY_THE_READER.search(line)} - set(MISTAKES))


LINES = commands()


def test_there_are_many() -> None:
    assert len(LINES) > 60


@pytest.mark.parametrize("line", [line for line in LINES if line.split()[0] not in COMPOSED])
def test_its_flags_are_those_of_the_command(line: str) -> None:
    name, *arguments = shlex.split(line)
    own = COMMANDS[name].code.partition(":")[0]
    module = "auvbench.commands.report_options" if name == "report" else own
    parser = importlib.import_module(module).parser()
    overrides = name in ("evaluate", "bound", "resume", "serve", "identify", "validate")
    words = parser.read(arguments, **({"overrides": True} if overrides else {}))
    if name == "evaluate":
        typed = [word for word in words.words if "=" in word and not word.endswith(".json")]
        compose("evaluate", typed)  # a sealed protocol is a file of its author


@pytest.mark.slow
@pytest.mark.parametrize("line", [line for line in LINES if line.split()[0] in COMPOSED])
def test_its_configuration_composes(line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    jobs = grids.jobs
    # Hundreds of runs compose alike.
    monkeypatch.setattr(grids, "jobs", lambda product: [(lines := jobs(product))[0], *lines[1:][-1:]])
    name, *arguments = shlex.split(line)
    if name == "train":
        request = read("train", arguments, grid=True, dry_run=True)
        assert request is not None
        assert request.jobs
    else:
        assert compose(name, [word for word in arguments if "=" in word and "(" not in word])
