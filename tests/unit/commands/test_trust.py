"""What another person made is used with the user's rights only after the user has said so."""

from __future__ import annotations

import io
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from auvbench import cli
from auvbench.config import installed
from auvbench.errors import RunError
from auvbench.runs import lock
from auvbench.runs.directory import RunDirectory
from auvbench.training import worker
from tests.unit.runs.test_damage import frozen

BRIEF = ("protocol.episodes=1", "--workers", "1")


@pytest.fixture
def as_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Return a function after which this process has another user's key."""
    return lambda: monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "another"))


@pytest.fixture
def run(tmp_path: Path) -> RunDirectory:
    return frozen(tmp_path / "out", "algo=random", state="pending")


@pytest.mark.slow
def test_what_the_user_made_is_resumed_unasked(run: RunDirectory, tmp_path: Path) -> None:
    copy = tmp_path / "copies" / "x" / run.id
    shutil.copytree(run.path, copy)
    for path in (run.path, copy):
        assert cli.main(["resume", str(path)]) == 0


def test_what_another_person_made_needs_the_flag_once(
    run: RunDirectory, as_another: Callable[[], None], capsys: pytest.CaptureFixture[str]
) -> None:
    as_another()
    before = {path.name: path.read_bytes() for path in run.path.iterdir() if path.is_file()}
    assert cli.main(["resume", str(run.path)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "--trust" in error
    assert str(run.path) in error
    assert {path.name: path.read_bytes() for path in run.path.iterdir() if path.is_file()} == before
    assert cli.main(["resume", str(run.path), "--trust"]) == 0
    assert run.manifest()["state"] == "complete"
    assert cli.main(["resume", str(run.path)]) == 0


@pytest.mark.parametrize(("answer", "code"), [("y\n", 0), ("yes\n", 0), ("\n", 2), ("n\n", 2), ("", 2)])
def test_on_a_terminal_it_is_asked(
    answer: str,
    code: int,
    run: RunDirectory,
    as_another: Callable[[], None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    as_another()
    monkeypatch.setattr(sys, "stdin", Terminal(answer))
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    assert cli.main(["resume", str(run.path)]) == code


@pytest.mark.parametrize("harm", ["no signature", "of another run", "another configuration", "a link"])
def test_a_signature_is_of_one_configuration(harm: str, run: RunDirectory, tmp_path: Path) -> None:
    signature = run.path / lock.MAKER
    assert lock.is_own(run.config_path)
    if harm == "no signature":
        signature.unlink()
    elif harm == "of another run":
        other = frozen(tmp_path / "out", "algo=random", "seed=7", state="pending")
        shutil.copyfile(other.path / lock.MAKER, signature)
    elif harm == "another configuration":
        text = run.config_path.read_text()
        assert "workers: " in text
        run.config_path.write_text(text.replace("workers: ", "workers: 1"))  # no part of the run's id
    else:
        elsewhere = tmp_path / "elsewhere"
        signature.rename(elsewhere)
        signature.symlink_to(elsewhere)
    assert not lock.is_own(run.config_path)
    assert cli.main(["resume", str(run.path)]) == 2


def test_jobs_are_not_asked(run: RunDirectory, as_another: Callable[[], None]) -> None:
    """SLURM and Ray start workers on other hosts."""
    as_another()
    assert worker.main([str(run.path)]) == 0


@pytest.mark.slow
def test_values_that_change_no_result_are_signed_again(run: RunDirectory) -> None:
    command = ["train", "algo=random", f"output={run.path.parent.parent}"]
    assert cli.main([*command, "train.checkpoint.keep=5"]) == 0
    assert lock.is_own(run.config_path)


@pytest.mark.slow
def test_tests_and_reports_take_what_another_person_made(
    run: RunDirectory, as_another: Callable[[], None]
) -> None:
    assert cli.main(["resume", str(run.path)]) == 0
    as_another()
    assert cli.main(["runs", str(run.path)]) == 0
    assert cli.main(["evaluate", str(run.path), *BRIEF]) == 0


@pytest.mark.slow
@pytest.mark.parametrize("command", ["evaluate", "replay", "export"])
def test_what_a_package_computes_needs_the_flag(
    command: str,
    run: RunDirectory,
    as_another: Callable[[], None],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert cli.main(["resume", str(run.path)]) == 0
    monkeypatch.setattr(installed, "releases_of", lambda _: ["slow==1.0"])
    as_another()
    assert cli.main([command, str(run.path)]) == 2
    assert "--trust" in capsys.readouterr().err
    cli.main([command, str(run.path), "--trust", *(BRIEF if command == "evaluate" else ())])
    assert lock.is_own(run.config_path)


@pytest.mark.slow
def test_a_study_of_another_person_needs_the_flag(
    tmp_path: Path,
    as_another: Callable[[], None],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from auvbench.commands import tune

    def stop(*_: object) -> None:
        raise RunError("reached the search")

    monkeypatch.setattr(tune, "_search", stop)
    command = ["tune", "algo=pid", "name=s", f"output={tmp_path}"]
    for _ in range(2):
        assert cli.main(command) == 2
        assert "reached the search" in capsys.readouterr().err
    as_another()
    assert cli.main(command) == 2
    assert "--trust" in capsys.readouterr().err
    assert cli.main([*command, "--trust"]) == 2
    assert "reached the search" in capsys.readouterr().err


def test_the_key_is_private_and_made_once(run: RunDirectory) -> None:
    key = lock.state_folder() / "key"
    assert key.stat().st_mode & 0o777 == 0o600
    before = key.read_bytes()
    lock._key.cache_clear()
    lock.sign(run.config_path)
    assert key.read_bytes() == before


@pytest.mark.slow
def test_without_a_state_directory_runs_are_made_and_need_the_flag(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    assert cli.main(["train", "algo=random", f"output={tmp_path / 'out'}"]) == 0
    (run,) = (tmp_path / "out" / "default").iterdir()
    assert cli.main(["resume", str(run)]) == 2
    assert cli.main(["resume", str(run), "--trust"]) == 0
