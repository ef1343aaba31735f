"""`auvbench tune` from the command line to the preset: real runs, killed, typed again, refused."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from optuna.trial import TrialState

from auvbench import cli
from auvbench.config import schema
from auvbench.errors import ConfigError, RunError
from auvbench.runs import lock, provenance
from auvbench.tuning import folder, outcome, runs
from auvbench.tuning.folder import StudyFolder
from tests.conftest import Once
from tests.waiting import until

PID = [
    "algo=pid",
    "tune.trials=4",
    "tune.startup=2",
    "protocol.episodes=4",
    "tune.fresh_seeds=[7]",
    "launcher.workers=1",
]
PPO = [
    "algo=ppo",
    "algo.n_envs=4",
    "algo.n_steps=choice(16,32)",
    "algo.batch_size=64",
    "algo.n_epochs=2",
    "algo.net_arch=[8]",
    "tune.trials=6",
    "tune.startup=3",
    "tune.rungs=[128,384]",
    "tune.reduction=2",
    "tune.fresh_seeds=[]",
    "protocol.episodes=2",
    "launcher.workers=1",
]


def tune(folder: Path, *arguments: str) -> int:
    return cli.main(["tune", *arguments, f"output={folder}"])


@pytest.fixture(scope="module")
def pid(once: Once, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished study of PID, of this process alone; tests leave it as it is."""

    def make(folder: Path) -> None:
        assert tune(folder, *PID) == 0

    output = tmp_path_factory.mktemp("pid")
    shutil.copytree(once("pid-study", make), output, dirs_exist_ok=True)
    return output


@pytest.mark.slow
def test_pid_is_tuned_and_its_preset_can_be_used(
    pid: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    study = StudyFolder(pid / "tune" / "pid")
    found = outcome.read(study)
    assert [len(found.trials), {outcome.state_of(t) for t in found.trials}] == [4, {"done"}]
    assert found.gains
    assert found.best is not None
    assert (study.report / "trials.csv").read_text().count("\n") == 5
    assert {path.stem for path in (study.report / "figures").glob("*.svg")} == {"history", "slices"}
    commit = provenance.git()["commit"]
    assert ("commit" in study.best.read_text()) == bool(commit)
    assert (commit or "")[:12] in study.best.read_text()
    # The preset, where anybody's own presets lie.
    monkeypatch.chdir(tmp_path)
    Path("conf/algo").mkdir(parents=True)
    Path("conf/algo/pid_tuned.yaml").write_bytes(study.best.read_bytes())
    assert cli.main(["train", "algo=pid_tuned", "seed=0"]) == 0
    run = next(Path("outputs/default").glob("pid_tuned-*"))
    tuned = json.loads(json.dumps(outcome_of(run)))
    assert tuned["study"] == "pid"
    # PID trains nothing, so that the processor time is that of its tests.
    assert tuned["steps"] == 0
    assert tuned["cpu_s"] == found.cpu_s > 0


def outcome_of(run: Path) -> dict[str, object]:
    from auvbench.runs.directory import RunDirectory

    tuned: dict[str, object] = RunDirectory(run).config()["algo"]["tuned"]
    return tuned


@pytest.mark.slow
def test_a_report_on_the_scenarios_of_the_search_says_that_it_is_no_ranking(
    pid: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("conf/algo").mkdir(parents=True)
    Path("conf/algo/pid_tuned.yaml").write_bytes((pid / "tune" / "pid" / "best.yaml").read_bytes())
    assert cli.main(["train", "-m", "algo=pid_tuned,random", "seed=0"]) == 0
    for protocol in ("validation", "test"):
        evaluate = ["evaluate", "outputs", f"protocol={protocol}", "protocol.episodes=3", "--workers", "1"]
        assert cli.main(evaluate) == 0
        capsys.readouterr()
        assert (
            cli.main(["report", "outputs", "--protocol", protocol, "--no-figures", "--format", "terminal,md"])
            == 0
        )
        said = "tuned on the scenarios of this table" in capsys.readouterr().out
        assert said == (protocol == "validation")
        assert ("not a valid ranking" in (Path("outputs/default/report/report.md")).read_text()) == said


@pytest.mark.slow
def test_typed_again_nothing_is_done_twice_and_more_trials_go_on(
    pid: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = StudyFolder(pid / "tune" / "pid")
    before = study.journal.read_bytes()
    manifests = {path: path.stat().st_mtime_ns for path in study.runs.glob("*/manifest.json")}
    assert tune(pid, *PID) == 0
    assert study.journal.read_bytes() == before
    assert {path: path.stat().st_mtime_ns for path in study.runs.glob("*/manifest.json")} == manifests


@pytest.mark.slow
def test_fewer_trials_than_there_are_take_none_away(pid: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (pid / "tune" / "pid" / "journal.log").read_bytes()
    assert tune(pid, *PID, "tune.trials=2") == 0
    assert "4 of 2 trials of " in capsys.readouterr().out
    assert (pid / "tune" / "pid" / "journal.log").read_bytes() == before
    assert tune(pid, *PID) == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            ["algo.bandwidth=interval(0.5,2)"],
            ["algo.bandwidth", "tag(log,interval(0.2,5.0)) -> interval(0.5,2)"],
        ),
        (["algo.bandwidth=1.0"], ["algo.bandwidth", "not searched"]),
        (["seed=3"], ["seed 42 -> 3"]),
        (["tune.rungs=[50000,150000]"], ["tune.rungs [50000, 150000, 400000] -> [50000, 150000]"]),
        (["protocol.episodes=5"], ["protocol.episodes 4 -> 5"]),
        (["vehicle=rexrov"], ["vehicle"]),
    ],
)
def test_another_study_in_the_same_place_is_refused(
    pid: Path, changes: list[str], words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    before = (pid / "tune" / "pid" / "journal.log").read_bytes()
    assert tune(pid, *PID, *changes) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    for word in [*words, "name=NAME"]:
        assert word in error
    assert (pid / "tune" / "pid" / "journal.log").read_bytes() == before


@pytest.mark.slow
def test_a_second_controller_says_so(pid: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = StudyFolder(pid / "tune" / "pid")
    with lock.acquire(study.path / "controller"):
        assert tune(pid, *PID) == 1
    assert f"pid {os.getpid()}" in capsys.readouterr().err
    assert tune(pid, *PID) == 0


@pytest.mark.slow
def test_a_study_of_another_version_is_refused(
    pid: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(pid / "tune", tmp_path / "tune")
    study = StudyFolder(tmp_path / "tune" / "pid")
    plan = json.loads(study.plan_path.read_text())
    for edited, word in (
        ({**plan, "schema_version": 99}, "schema_version is 99"),
        ({**plan, "seed": "x"}, "damaged"),
        ({**plan, "protocol": {**plan["protocol"], "scenarios": "test"}}, "uses the scenarios of a test"),
    ):
        study.plan_path.write_text(json.dumps(edited))
        assert tune(tmp_path, *PID) == 2
        error = capsys.readouterr().err
        assert word in error
        assert error.count("\n") == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    "protocol", ["test", "thesis", "native", "long", "robustness", "transfer", "frequency_sweep"]
)
def test_no_protocol_of_a_test_is_accepted(
    protocol: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tune(tmp_path, *PID, f"protocol={protocol}") == 2
    assert "settings must be chosen on validation scenarios" in capsys.readouterr().err
    assert not list(tmp_path.rglob("*.json"))


@pytest.mark.slow
def test_no_scenarios_of_a_test_are_accepted(tmp_path: Path) -> None:
    assert tune(tmp_path, *PID, "protocol.scenarios=test") == 2
    assert not list(tmp_path.rglob("*.json"))


@pytest.mark.slow
def test_nothing_of_tuning_ever_draws_a_test_scenario(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The one door to scenarios is the roll-out: whoever comes through it from here asks for validation."""
    from auvbench.evaluation import evaluate as module

    asked: list[tuple[str, int]] = []
    real = module.roll_out

    def watched(*arguments: object, **options: object) -> object:
        asked.append((str(options["scenarios"]), int(str(options["seed"]))))
        return real(*arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(module, "roll_out", watched)
    words = [*PID, "tune.trials=1"]
    assert tune(tmp_path, *words) == 0
    assert "0 of 1 trial of pid begun" in capsys.readouterr().out
    study = StudyFolder(tmp_path / "tune" / "pid")
    plan = study.read()
    for run in [*study.runs.glob("*/"), *study.fresh.glob("*/")]:
        from auvbench.runs.directory import RunDirectory

        summaries = list((run / "evaluations").iterdir())
        for path in summaries:
            if not path.name.startswith("."):
                assert json.loads((path / "summary.json").read_text())["scenarios"] == "validation"
        # What workers do, here in this process.
        for path in summaries:
            if not path.name.startswith("."):
                (path / "summary.json").unlink()
        runs.test(RunDirectory(run), folder.of_run(run)[1])
    assert {stream for stream, _ in asked} == {"validation"}
    assert {seed for _, seed in asked} == {plan.protocol.seed, plan.protocol.seed + 1}
    forbidden = schema.Protocol(**{**vars(plan.protocol), "scenarios": "test"})
    with pytest.raises(ConfigError, match="uses the scenarios of a test"):
        runs.test(RunDirectory(next(study.runs.glob("*/"))), forbidden)


def trials(output: Path, name: str) -> list[tuple[object, ...]]:
    found = outcome.read(StudyFolder(output / "tune" / name))
    return sorted(
        (t.number, json.dumps(t.params), json.dumps(t.user_attrs), t.state.name) for t in found.trials
    )


def complete(study: StudyFolder) -> dict[Path, int]:
    """When the policy of each complete run was written."""
    return {
        path.parent: (path.parent / "model" / "policy.pt").stat().st_mtime_ns
        for path in study.runs.glob("*/manifest.json")
        if json.loads(path.read_text())["state"] == "complete"
    }


@pytest.mark.slow
def test_after_two_kills_nothing_is_lost_or_trained_twice(tmp_path: Path) -> None:
    """PPO, six trials, two rungs; SIGKILL of the controller after some operations."""
    study = StudyFolder(tmp_path / "tune" / "ppo")
    command = [sys.executable, "-m", "auvbench", "tune", *PPO, f"output={tmp_path}"]
    log = tmp_path / "log.txt"

    def begin() -> subprocess.Popen[bytes]:
        with open(log, "ab") as output:
            return subprocess.Popen(command, stdout=output, stderr=output, start_new_session=True)

    before: dict[Path, int] = {}
    for operations in (15, 50):
        process = begin()

        def reached(process: subprocess.Popen[bytes] = process, operations: int = operations) -> bool:
            journal = study.journal.read_bytes() if study.journal.exists() else b""
            return process.poll() is not None or journal.count(b"\n") >= operations

        until(reached, f"operation {operations}")
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL, log.read_text()
        before = complete(study) | before
        kept = study.journal.read_bytes()
    assert begin().wait() == 0, log.read_text()
    assert complete(study).items() >= before.items()
    assert study.journal.read_bytes().startswith(kept[: kept.rfind(b"\n") + 1])
    found = outcome.read(study)
    assert len(found.trials) == 6
    assert {t.state for t in found.trials} <= {TrialState.COMPLETE, TrialState.PRUNED}
    # Bit for bit what a run of the larger budget would have been: a promoted run is no approximation.
    best = found.best
    assert best is not None
    assert best.state is TrialState.COMPLETE
    straight = [f"{key}={value}" for key, value in best.params.items()]
    fixed = [word for word in PPO[1:] if word.startswith("algo.") and "choice" not in word]
    line = ["train", "algo=ppo", *fixed, *straight, "seed=0", "train.total_steps=384"]
    assert cli.main([*line, f"output={tmp_path}", "name=straight"]) == 0
    run = next((tmp_path / "straight").glob("*/"))
    promoted = study.runs / run.name
    assert (run / "model" / "policy.pt").read_bytes() == (promoted / "model" / "policy.pt").read_bytes()


@pytest.mark.slow
def test_a_trial_that_cannot_be_is_a_result_and_no_failure_of_the_study(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """156 combinations, more than are checked before: most rollouts are no multiple of most batches."""
    steps = "algo.n_steps=choice(48,17,19,23,29,31,37,41,43,47,53,59)"
    batches = "algo.batch_size=choice(2,3,4,6,8,12,16,24,32,48,64,96,192)"
    fixed = [
        f"algo.{key}" for key in ("learning_rate=0.001", "gamma=0.9", "gae_lambda=0.9", "clip_range=0.2")
    ]
    fixed += [
        "algo.n_envs=8",
        "algo.n_epochs=2",
        "algo.ent_coef=0",
        "algo.log_std_init=0",
        "tune.rungs=[64]",
        "tune.trials=5",
        "tune.startup=5",
    ]
    words = [word for word in PPO if not word.startswith(("algo.n_", "algo.batch", "tune."))]
    assert tune(tmp_path, *words, *fixed, steps, batches, "tune.fresh_seeds=[]") == 0
    found = outcome.read(StudyFolder(tmp_path / "tune" / "ppo"))
    failed = [trial for trial in found.trials if outcome.state_of(trial) == "failed"]
    assert 0 < len(failed) < 5
    assert all("batch_size" in trial.user_attrs["error"] for trial in failed)
    assert f"{len(failed)} failed" in capsys.readouterr().out


@pytest.mark.slow
def test_an_edited_or_removed_line_of_a_journal_is_named(
    pid: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(pid / "tune", tmp_path / "tune")
    path = tmp_path / "tune" / "pid" / "journal.log"
    lines = path.read_bytes().split(b"\n")
    score = next(n for n, line in enumerate(lines) if b"intermediate_value" in line)
    edited = json.dumps({**json.loads(lines[score]), "intermediate_value": 2.0}, separators=(",", ":"))
    for changed in (
        [*lines[:score], edited.encode(), *lines[score + 1 :]],
        lines[:score] + lines[score + 1 :],
    ):
        path.write_bytes(b"\n".join(changed))
        assert tune(tmp_path, *PID) == 2
        error = capsys.readouterr().err
        assert f"line {score + 1}" in error
        assert error.count("\n") == 1
    # The way out that the message names: decided anew; equal settings find their runs again.
    path.rename(tmp_path / "elsewhere.log")
    runs = {run: run.stat().st_mtime_ns for run in path.parent.glob("runs/*/manifest.json")}
    assert tune(tmp_path, *PID) == 0
    assert {run: run.stat().st_mtime_ns for run in runs} == runs
    path.write_bytes(b"\n".join(lines)[:-20])  # as a kill leaves it
    assert tune(tmp_path, *PID) == 0
    with pytest.raises(RunError, match="not a study"):
        StudyFolder(tmp_path).read()


@pytest.mark.slow
def test_a_study_of_a_stranger_appends_to_no_file_outside(
    pid: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The cut-short last line of the journal is code, and `journal.log.torn` leads to the user's shell profile."""
    shutil.copytree(pid / "tune", tmp_path / "tune")
    study = StudyFolder(tmp_path / "tune" / "pid")
    profile = tmp_path / "profile"
    profile.write_text("export A=1\n")
    with open(study.journal, "ab") as journal:
        journal.write(b"touch owned #")
    study.journal.with_name("journal.log.torn").symlink_to(profile)
    assert tune(tmp_path, *PID) == 0
    assert profile.read_text() == "export A=1\n"
    study.journal.unlink()
    study.journal.symlink_to(profile)
    assert tune(tmp_path, *PID) == 2
    assert "symbolic link" in capsys.readouterr().err
    assert profile.read_text() == "export A=1\n"
