"""A run from a stranger: its links lead nowhere, and nothing outside of it is written or deleted."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from auvbench import cli
from auvbench.errors import RunError
from auvbench.runs import lock
from auvbench.runs.directory import RunDirectory
from auvbench.training import worker
from auvbench.untrusted import path_safety
from tests import configs, synthetic
from tests.unit.runs.test_damage import frozen

LINKS = (
    "checkpoints",
    "evaluations",
    "evaluations/test",
    "lock",
    "model",
    "model/policy.pt",
    "train",
    "train/log.txt",
    "train/episodes.csv",
    "progress.json",
    "manifest.json",
    "config.yaml",
    "replays",
)


QUICK = ("checkpoints", "model/policy.pt", "train/log.txt", "config.yaml")


def content(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture
def photographs(tmp_path: Path) -> Path:
    """What must stay as it is, with names that auvbench would clean up."""
    folder = tmp_path / "photographs"
    for name in ("1000/a.jpg", "2000/b.jpg", ".staging-5/c.jpg", "test/d.jpg", "log.txt", "index.html"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(f"{name}\n")
    return folder


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in LINKS]
)
@pytest.mark.parametrize("state", ["interrupted", "complete"])
def test_no_command_follows_a_link_out_of_a_run(
    name: str, state: str, photographs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = frozen(tmp_path / "out", "algo=random", state=state)
    there = run.path / name
    there.parent.mkdir(parents=True, exist_ok=True)
    target = photographs / "log.txt" if "." in there.name else photographs
    if there.exists():
        target.write_bytes(there.read_bytes())
        there.unlink()
    there.symlink_to(target)
    before = content(photographs)
    path = str(run.path)
    for arguments in (
        ["resume", path],
        ["resume", path, "train.total_steps=9000000"],
        ["evaluate", path, "protocol.episodes=1"],
        ["replay", path],
        ["train", *configs.ORIGINAL, "algo=random", f"output={tmp_path / 'out'}"],
    ):
        code = cli.main(arguments)
        error = capsys.readouterr().err
        assert "defect" not in error
        if arguments[0] in ("resume", "train") or (state == "complete" and arguments[0] != "runs"):
            assert (code, "symbolic link" in error) in {(2, True), (1, True)}
    assert worker.main([path, "--log"]) == 2
    assert content(photographs) == before
    assert there.is_symlink()


def test_a_growing_file_with_a_second_name_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = frozen(tmp_path / "out", "algo=random", state="interrupted")
    shell = tmp_path / ".bashrc"
    shell.write_text("alias ls='ls -l'\n")
    run.train.mkdir()
    os.link(shell, run.train / "log.txt")
    assert worker.main([str(run.path), "--log"]) == 2
    assert cli.main(["resume", str(run.path)]) == 2
    assert "hard link" in capsys.readouterr().err
    assert shell.read_text() == "alias ls='ls -l'\n"


def test_a_pipe_in_a_run_does_not_hang(tmp_path: Path) -> None:
    run = frozen(tmp_path / "out", "algo=random", state="interrupted")
    run.train.mkdir()
    os.mkfifo(run.train / "log.txt")
    with pytest.raises(RunError, match="neither a file nor a folder"):
        path_safety.refuse_links(run.path)
    assert worker.main([str(run.path), "--log"]) == 2


def test_a_link_above_the_run_is_the_user_s_own(tmp_path: Path) -> None:
    run = frozen(tmp_path / "out", "algo=random", state="pending")
    (tmp_path / "link").symlink_to(tmp_path / "out")
    (tmp_path / "one").symlink_to(run.path)
    for path in (tmp_path / "link" / "default" / run.id, tmp_path / "one"):
        with lock.acquire(path):
            pass
    RunDirectory(tmp_path / "link" / "default" / run.id).check()


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["report", "report/figures", "report/index.html", "report/figures/summary.png"]
)
def test_a_report_is_not_written_where_a_link_leads(
    name: str, photographs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    experiment = tmp_path / "out" / "x"
    synthetic.write_experiment(experiment, algorithms=("pid", "random"), episodes=5)
    link = experiment / name
    link.parent.mkdir(parents=True, exist_ok=True)
    link.symlink_to(photographs / "index.html" if "." in link.name else photographs)
    before = content(photographs)
    code = cli.main(["report", str(experiment), "--format", "html,md,csv"])
    error = capsys.readouterr().err
    assert content(photographs) == before
    if "." in link.name:  # a file is replaced, not written through
        assert code == 0
    else:
        assert (code, "symbolic link" in error) == (2, True)


def test_a_name_out_of_a_file_stays_below_its_folder(tmp_path: Path) -> None:
    (tmp_path / "model").mkdir()
    assert path_safety.child(tmp_path, "model/policy.pt") == tmp_path / "model" / "policy.pt"
    bad = (
        "../x",
        "/etc/passwd",
        "a/../../b",
        "",
        "a//b",
        ".",
        "a\0b",
        "a\nb",
        "\x1b[2J",
        "\u202ea",
        "x" * 256,
        5,
        None,
    )
    for name in bad:
        with pytest.raises(ValueError, match="not a valid name"):
            path_safety.child(tmp_path, name)


@pytest.mark.parametrize("link", ["model", "model/policy.pt"])
def test_a_name_out_of_a_file_leads_through_no_link(link: str, photographs: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    (run / link).parent.mkdir(parents=True)
    (run / link).symlink_to(photographs)
    with pytest.raises(ValueError, match="symbolic link"):
        path_safety.child(run, "model/policy.pt")


@pytest.mark.slow
def test_a_folder_deeper_than_python_recurses_is_searched(tmp_path: Path) -> None:
    here = os.getcwd()
    os.chdir(tmp_path)
    try:
        for _ in range(1200):
            os.mkdir("d")
            os.chdir("d")
        os.chdir(here)
        path_safety.refuse_links(tmp_path)
    finally:
        os.chdir(here)
        # pytest's own cleaning recurses and would end a later session with a RecursionError.
        subprocess.run(["rm", "-rf", str(tmp_path / "d")], check=True)
