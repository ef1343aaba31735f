"""What a manifest says about the machine and the source."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from auvbench.config.compose import compose
from auvbench.runs import provenance
from auvbench.runs.directory import freeze
from auvbench.training.execute import execute


@pytest.mark.slow
def test_threads_are_those_of_the_run(tmp_path: Path) -> None:
    config = compose("train", [f"output={tmp_path}", "algo=random", "simulator.threads=2"])
    run = freeze(OmegaConf.to_container(config, resolve=True))
    assert execute(run)["host"]["threads"] == 2


@pytest.mark.parametrize(("added", "dirty"), [("conf/algo/mine.yaml", True), ("notes.txt", False)])
def test_a_new_file_counts_where_it_is_read(
    added: str, dirty: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    git = ["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@b"]
    subprocess.run([*git, "init", "-q"], check=True)
    subprocess.run([*git, "commit", "-q", "--allow-empty", "-m", "x"], check=True)
    monkeypatch.setattr(provenance, "__file__", str(tmp_path / "auvbench" / "runs" / "provenance.py"))
    file = tmp_path / added
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("a: 1\n")
    assert provenance.git.__wrapped__()["dirty"] is dirty


@pytest.mark.parametrize(
    ("lines", "name"),
    [
        (
            "cpu family\t: 26\nmodel\t\t: 2\nmodel name\t: AMD EPYC\n\ncpu family\t: 25",
            "AMD EPYC (family 26, model 2)",
        ),
        (
            "cpu family\t: 6\nmodel\t\t: 85\nmodel name\t: Intel(R) Xeon(R) Gold 6248",
            "Intel(R) Xeon(R) Gold 6248",
        ),
        ("model name\t: Virtual CPU\n", "Virtual CPU"),
    ],
)
def test_a_processor_without_a_number_is_told_by_its_family(tmp_path: Path, lines: str, name: str) -> None:
    (tmp_path / "cpuinfo").write_text(lines)
    assert provenance._processor(tmp_path / "cpuinfo") == name


def test_where_the_system_says_nothing_the_processor_is_named_all_the_same(tmp_path: Path) -> None:
    assert provenance._processor(tmp_path / "none")
