"""`auvbench submit` and `auvbench verify`: an entry is tested again from its archive alone."""

from __future__ import annotations

import io
import json
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from auvbench.cli import main
from auvbench.commands import verify
from auvbench.config.compose import compose
from auvbench.config.validate import evaluate_config
from auvbench.errors import ReportError
from auvbench.evaluation.evaluate import evaluate
from auvbench.reporting import entries, verification
from auvbench.reporting.entries import unpack
from auvbench.runs.atomic_io import sha256
from auvbench.runs.plan import prepare
from auvbench.training.execute import execute
from auvbench.untrusted import archives

ROOT = Path(__file__).parents[2]
WORDS = ("--name", "My agent", "--who", "Jane Doe", "--knows", "none", "--trials", "0")


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """A test of five episodes."""
    whole = evaluate_config

    def few(config: Any) -> Any:
        found = whole(config)
        found.protocol.episodes = 5
        return found

    monkeypatch.setattr("auvbench.config.validate.evaluate_config", few)


@pytest.fixture
def tested(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small: None) -> Path:
    """A folder with a tested run of LQR."""
    monkeypatch.chdir(tmp_path)
    run = prepare(compose("train", ["algo=lqr", "name=mine"]))
    execute(run)
    protocol = evaluate_config(compose("evaluate", ["protocol.episodes=5"])).protocol
    evaluate(run, protocol)
    return Path("outputs/mine")


def submit(folder: Path, *words: str, knows: str = "sheet,model,velocities") -> int:
    line = [knows if word == "none" else word for word in WORDS]
    return main(["submit", str(folder), *line, *words])


def changed(path: Path, change: Callable[[dict[str, bytes]], None]) -> Path:
    """A copy of an archive with changed files."""
    files = dict(archives.members(path.read_bytes(), 1 << 30))
    change(files)
    target = path.with_name("changed.zip")
    with zipfile.ZipFile(target, "w") as packed:
        for name, data in files.items():
            packed.writestr(name, data)
    return target


def test_an_entry_is_verified_from_its_archive_alone(
    tested: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert submit(tested) == 0
    first = Path("my-agent.zip").read_bytes()
    shutil.rmtree(tested)
    assert main(["verify", "my-agent.zip", "--to", "results/entries", "--workers", "1"]) == 0
    printed = capsys.readouterr().out
    assert "rows: 1 of 1 runs have the same bits" in printed
    assert "verified: the same bits" in printed
    kept = Path("results/entries/my-agent")
    assert json.loads((kept / "verified.json").read_text())["ok"] is True
    table = Path("results/entries/README.md").read_text()
    assert "| [My agent](my-agent/) | Jane Doe |" in table
    assert "same bits" in table
    # The folder is a study, and an entry again.
    assert main(["report", str(kept), "--format", "csv", "--no-figures", "--out", "out"]) == 0
    assert main(["verify", str(kept), "--workers", "1"]) == 0
    assert first == Path("my-agent.zip").read_bytes()


def test_rows_that_are_not_those_of_the_agent_are_not_verified(
    tested: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert submit(tested) == 0
    rows = verification.same_rows
    monkeypatch.setattr(
        verification, "same_rows", lambda one, other: rows(one.assign(steps=one["steps"] - 1), other)
    )
    assert main(["verify", "my-agent.zip", "--to", "entries", "--workers", "1"]) == 1
    assert "not verified" in capsys.readouterr().out
    assert "| no: " in Path("entries/README.md").read_text()


def test_on_another_processor_the_verdict_counts(tested: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert submit(tested) == 0
    monkeypatch.setattr(verification, "same_rows", lambda one, other: False)
    host = {"cpu": "another", "name": "x", "cores": 1, "threads": 1}
    monkeypatch.setattr(verification.provenance, "host", lambda threads=1: host)
    assert main(["verify", "my-agent.zip", "--workers", "1"]) == 0
    verdicts = iter([("ahead", 1.0, (0.5, 1.5)), ("open", 1.0, (0.5, 1.5))])
    monkeypatch.setattr(verification, "_verdict", lambda *_: next(verdicts))
    assert main(["verify", "my-agent.zip", "--workers", "1"]) == 1


def test_rows_are_compared_to_the_last_bit() -> None:
    one = pd.DataFrame({"a": [1.0, float("nan")], "b": ["x", "y"]})
    assert verification.same_rows(one, one[["b", "a"]].copy())
    assert not verification.same_rows(one, one.assign(a=[1.0 + 2**-52, float("nan")]))
    assert not verification.same_rows(one, one.drop(columns="b"))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--knows", "velocity"], "did you mean 'velocities'"),
        (["--knows", "none,sheet"], "name some of"),
        (["--knows", "none"], "gives the agent"),
        (["--trials", "5"], "name the scenarios on which you scored the trials"),
        (["--trials", "-1"], "trials"),
        (["--name", "x" * 61], "1 to 60 characters"),
        (["--protocol", "tset"], "did you mean 'test'"),
        (["--out", "x.tar"], "must end in .zip"),
        (["--where", "algo=pid"], "no run has algo"),
    ],
)
def test_a_wrong_word_is_one_line(
    tested: Path, words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert submit(tested, *words) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not list(Path().glob("*.zip"))


def test_runs_that_cannot_be_an_entry_are_named(tested: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = prepare(compose("train", ["algo=smc", "name=mine"]))
    assert submit(tested) == 2
    assert "pending" in capsys.readouterr().err
    execute(other)
    assert submit(tested) == 2
    assert "no evaluation by protocol test" in capsys.readouterr().err
    evaluate(other, evaluate_config(compose("evaluate", ["protocol.episodes=5"])).protocol)
    assert submit(tested) == 2
    assert "has 2 agents (LQR, SMC); enter one" in capsys.readouterr().err
    assert submit(ROOT / "results" / "defaults") == 2
    assert "a published study has no weights" in capsys.readouterr().err


def _entry(found: dict[str, bytes], **changes: object) -> None:
    found["entry.json"] = json.dumps(json.loads(found["entry.json"]) | changes).encode()


def _outside(found: dict[str, bytes]) -> None:
    """Name a file outside the folder, and bring it along."""
    named = {"../evil": {"bytes": 1, "sha256": sha256(b"x")}}
    _entry(found, files=json.loads(found["entry.json"])["files"] | named)
    found["../evil"] = b"x"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda f: f.pop("entry.json"), "entry.json is missing"),
        (lambda f: f.update({"../evil": b"x"}), "but entry.json does not list"),
        (
            _outside,
            "is not a valid name of a file below",
        ),
        (lambda f: f.update({"runs.parquet": f["runs.parquet"] + b"x"}), "bytes instead of"),
        (lambda f: f.pop("episodes.parquet"), "episodes.parquet is missing"),
        (lambda f: _entry(f, trials=-1), "trials is -1"),
        (lambda f: _entry(f, knows=["all"]), "knows"),
        (lambda f: _entry(f, protocol="../x"), "unknown to this version"),
        (lambda f: _entry(f, who="a\x1b[31m"), "who is"),
    ],
)
def test_a_damaged_or_hostile_archive_is_one_line(
    tested: Path, change: Callable[[dict[str, bytes]], None], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert submit(tested) == 0
    capsys.readouterr()
    assert main(["verify", str(changed(Path("my-agent.zip"), change))]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not Path("../evil").exists()


def test_an_archive_that_unpacks_without_end_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("entry.json", b"0" * 5_000_000)
    path = tmp_path / "bomb.zip"
    path.write_bytes(stream.getvalue())
    monkeypatch.setattr(entries, "LARGEST", 1_000_000)
    with pytest.raises(ReportError, match="would unpack to"):
        unpack(path, tmp_path / "to")


@pytest.mark.parametrize(("simulator", "agent"), [("ros2", "pid"), ("fossen", "ardusub")])
def test_an_entry_starts_no_program(simulator: str, agent: str) -> None:
    with pytest.raises(ValueError, match="an entry"):
        verification._refuse_programs(simulator, agent)


def test_the_entry_of_another_person_stays(tested: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert submit(tested) == 0
    assert main(["verify", "my-agent.zip", "--to", "entries", "--workers", "1"]) == 0
    assert submit(tested, "--who", "John Roe") == 0
    capsys.readouterr()
    assert main(["verify", "my-agent.zip", "--to", "entries", "--workers", "1"]) == 2
    assert "is not an entry of John Roe" in capsys.readouterr().err


def test_the_shipped_table_has_the_entries_that_are_shipped() -> None:
    folder = ROOT / "results" / "entries"
    text = (folder / "README.md").read_text(encoding="utf-8")
    assert (
        text.partition(verify.BEGIN)[2].partition(verify.END)[0].strip() == entries.overview(folder).strip()
    )


@pytest.mark.slow
def test_an_onnx_file_is_entered_with_its_card(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small: None, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for suffix in ("onnx", "json"):
        (file,) = (ROOT / "results" / "leaderboard" / "policies").glob(f"ppo-k1-*.{suffix}")
        shutil.copy(file, tmp_path / f"mine.{suffix}")
    assert main(["submit", "mine.onnx", *WORDS]) == 0
    assert main(["verify", "my-agent.zip", "--workers", "1"]) == 0
    assert "verified" in capsys.readouterr().out
    (tmp_path / "mine.json").unlink()
    assert main(["submit", "mine.onnx", *WORDS]) == 2
    assert "mine.json: no such file" in capsys.readouterr().err
