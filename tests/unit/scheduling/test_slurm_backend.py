"""The SLURM backend against a cluster that says what the test wants; the real one is in tests/cluster."""

from __future__ import annotations

import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from auvbench.cli import main
from auvbench.config.compose import compose
from auvbench.errors import UserError
from auvbench.integrations.cluster import slurm
from auvbench.integrations.cluster.slurm import SlurmBackend
from auvbench.integrations.cluster.spec import Slurm
from auvbench.runs.directory import RunDirectory
from auvbench.scheduling import grid, loop, views
from auvbench.scheduling.loop import Phase, SubmitError
from auvbench.untrusted import path_safety
from tests import fake_training

SBATCH = """\
#!/bin/sh
echo run >> "$CLUSTER/count"
number=$((100 + $(wc -l < "$CLUSTER/count")))
for script; do :; done
cp "$script" "$CLUSTER/$number.sh"
printf '%s\\n' "$@" > "$CLUSTER/$number.options"
env | grep ^SBATCH_ > "$CLUSTER/$number.env"
echo "Submitted batch job $number"
"""


class Cluster:
    """What squeue and scontrol say, and what was asked for; sbatch is a program that keeps what it is given."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.queue: dict[str, tuple[str, str]] = {}  # number -> state, name; besides what sbatch was given
        self.job = ""  # scontrol show job
        self.down = False
        self.asked: list[list[str]] = []

    @property
    def scripts(self) -> list[str]:
        return [file.read_text() for file in sorted(self.folder.glob("*.sh"))]

    @property
    def arguments(self) -> list[str]:
        """Of the last sbatch, but for the script."""
        return sorted(self.folder.glob("*.options"))[-1].read_text().splitlines()[:-1]

    @property
    def options(self) -> dict[str, str]:
        """Of the last script, as sbatch reads them."""
        words = [
            word
            for line in self.scripts[-1].splitlines()
            if line.startswith("#SBATCH ")
            for word in shlex.split(line.removeprefix("#SBATCH "))
        ]
        return dict(word.removeprefix("--").partition("=")[::2] for word in words)

    def __call__(self, arguments: Sequence[str], *, check: bool = True) -> str:
        self.asked.append(list(arguments))
        if self.down:
            if check:
                raise SubmitError(f"{arguments[0]} refused: Unable to contact slurm controller")
            return ""
        if arguments[0] == "squeue":
            return "".join(f"{number}|{state}|{name}\n" for number, (state, name) in self.queue.items())
        return self.job if arguments[0] == "scontrol" else ""


@pytest.fixture
def cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Cluster:
    programs, folder = tmp_path / "bin", tmp_path / "cluster"
    programs.mkdir()
    folder.mkdir()
    for name in ("sbatch", "srun", "squeue", "scontrol", "scancel"):
        (programs / name).write_text(SBATCH if name == "sbatch" else "#!/bin/sh\n")
        (programs / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}:{os.environ['PATH']}")
    monkeypatch.setenv("CLUSTER", str(folder))
    cluster = Cluster(folder)
    monkeypatch.setattr(slurm, "command", cluster)
    return cluster


@pytest.fixture
def run(tmp_path: Path) -> RunDirectory:
    return fake_training.make(tmp_path / "ppo-k1-f10-s0-12345678")


def backend(*overrides: str) -> SlurmBackend:
    config = compose("train", ["launcher=slurm", "launcher.poll=0.1", "launcher.grace=0", *overrides])
    found = grid.backend(config.launcher)
    assert isinstance(found, SlurmBackend)
    return found


def submit(cluster: Cluster, run: RunDirectory, *overrides: str) -> slurm.SlurmJob:
    job = backend(*overrides).submit(run.path)
    cluster.queue[job.number] = ("PENDING", run.id)
    return job


def poll(job: slurm.SlurmJob) -> Any:
    job.backend.look_again()
    return job.poll()


def test_the_script_says_what_was_configured(cluster: Cluster, run: RunDirectory) -> None:
    backend(
        "launcher.partition=long",
        "launcher.time='04:00:00'",
        "launcher.mem=3G",
        "launcher.setup=['module load python','source env/bin/activate']",
        "launcher.sbatch=['--nice=100','--constraint=avx2&ib']",
    ).submit(run.path)
    (script,) = cluster.scripts
    found = cluster.options
    assert found["partition"] == "long"
    assert found["time"] == "04:00:00"
    assert found["signal"] == "B:USR1@120"
    assert found["mem"] == "3G"
    assert found["job-name"] == run.id
    assert found["output"] == str(run.train / "log.txt")
    assert found["open-mode"] == "append"
    assert "requeue" in found
    assert not {"account", "error", "wckey", "array"} & set(found)
    assert cluster.arguments == ["--nice=100", "--constraint=avx2&ib"]
    lines = [line for line in script.splitlines() if line and not line.startswith("#")]
    assert lines[:3] == ["trap '' USR1", "module load python", "source env/bin/activate"]
    words = shlex.split(lines[-1])
    assert words[:2] == ["exec", sys.executable]
    assert words[words.index("auvbench.integrations.cluster.job") + 1] == str(run.path)


def test_the_script_is_a_shell_script_whatever_the_path(cluster: Cluster, tmp_path: Path) -> None:
    odd = fake_training.make(tmp_path / "it's 100% odd" / "run")
    backend().submit(odd.path)
    (script,) = cluster.scripts
    subprocess.run(["bash", "-n"], input=script, text=True, check=True)
    assert shlex.split(script.strip().splitlines()[-1])[5] == str(odd.path)
    assert cluster.options["output"] == str(odd.train / "log.txt").replace("%", "%%")


@pytest.fixture
def many(tmp_path: Path) -> list[RunDirectory]:
    return [fake_training.make(tmp_path / "it's many" / f"run{number}") for number in range(101)]


def filled(runs: list[RunDirectory], *overrides: str) -> loop.Loop:
    """A sweep that has submitted what it can."""
    sweep = loop.Loop(runs, backend(*overrides), views.View(Console(quiet=True), runs))
    sweep._fill()
    return sweep


def test_more_than_a_hundred_runs_are_one_array(cluster: Cluster, many: list[RunDirectory]) -> None:
    sweep = filled(many)
    (script,) = cluster.scripts
    assert cluster.options["array"] == "0-100"
    assert {str(job): run.id for job, run in sweep.active.items()} == {
        f"slurm job 101_{task}": run.id for task, run in enumerate(many)
    }
    # The task's shell opens the log of its run and starts the worker of its run.
    script = script.replace(f"exec {sys.executable}", "echo worker")
    environment = {**os.environ, "SLURM_ARRAY_TASK_ID": "7"}
    subprocess.run(["bash"], input=script, text=True, check=True, env=environment)
    words = (many[7].train / "log.txt").read_text()
    assert f" auvbench.integrations.cluster.job {many[7].path} --target" in words
    assert not (many[8].train / "log.txt").exists()


def test_the_next_sweep_finds_the_tasks_of_an_array(cluster: Cluster, many: list[RunDirectory]) -> None:
    filled(many)
    name = cluster.options["job-name"]
    cluster.queue = {f"101_{task}": ("PENDING", name) for task in range(101)}
    assert len(filled(many).active) == 101
    assert len(cluster.scripts) == 1
    cluster.queue["101_3"] = ("PENDING", "another array")
    assert backend().adopt(many[3].path) is None


def test_an_array_that_is_refused_is_submitted_run_by_run(
    cluster: Cluster, many: list[RunDirectory], tmp_path: Path
) -> None:
    program = tmp_path / "bin" / "sbatch"
    refusing = 'grep -q "SBATCH --array" "$(for script; do :; done; echo "$script")" && exit 1\n'
    program.write_text(SBATCH.replace("echo run", refusing + "echo run", 1))
    sweep = filled(many)
    assert {str(job) for job in sweep.active} == {f"slurm job {number}" for number in range(101, 202)}


def test_an_array_has_no_more_tasks_than_workers(cluster: Cluster, many: list[RunDirectory]) -> None:
    sweep = filled(many, "launcher.workers=2")
    assert len(sweep.active) == len(cluster.scripts) == 2


def test_a_sweep_inside_a_job_does_not_hand_on_its_settings(
    cluster: Cluster, run: RunDirectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SBATCH_PARTITION", "of-the-surrounding-job")
    backend().submit(run.path)
    assert (cluster.folder / "101.env").read_text() == ""


def test_a_submitted_run_holds_no_link_so_that_whoever_works_on_it_takes_it(
    cluster: Cluster, run: RunDirectory
) -> None:
    backend().submit(run.path)
    path_safety.refuse_links(run.path)
    assert (run.path / slurm.SCRIPT).read_text() == cluster.scripts[0]


@pytest.mark.slow
def test_a_job_waits_runs_and_ends(cluster: Cluster, run: RunDirectory) -> None:
    job = submit(cluster, run)
    assert job.poll().phase is Phase.QUEUED
    for state, phase in (
        ("RUNNING", Phase.RUNNING),
        ("COMPLETING", Phase.RUNNING),
        ("PENDING", Phase.QUEUED),
    ):
        cluster.queue[job.number] = (state, run.id)
        assert poll(job).phase is phase
    cluster.queue.clear()
    run.update_manifest(state="complete")
    assert poll(job).ended


def test_a_dead_job_says_how_it_died(cluster: Cluster, run: RunDirectory) -> None:
    job = submit(cluster, run)
    cluster.queue[job.number] = ("FAILED", run.id)
    cluster.job = f"JobId={job.number} JobName={run.id} JobState=FAILED Reason=NonZeroExitCode ExitCode=0:9"
    status = poll(job)
    assert status.ended
    assert (
        status.describe()
        == f"slurm job {job.number} ended as FAILED (killed by signal 9, possibly out of memory)"
    )


@pytest.mark.slow
def test_a_job_that_the_cluster_has_forgotten_is_dead_after_the_grace(
    cluster: Cluster, run: RunDirectory
) -> None:
    job = submit(cluster, run, "launcher.grace=3600")
    cluster.queue.clear()
    assert not poll(job).ended  # a slow file server may still bring its manifest
    job.backend.options.grace = 0.0
    assert poll(job).describe() == f"slurm job {job.number} is no longer known to the cluster"


@pytest.mark.slow
def test_a_silent_controller_says_nothing_about_the_jobs(cluster: Cluster, run: RunDirectory) -> None:
    job = submit(cluster, run)
    cluster.down = True
    assert poll(job).phase is Phase.QUEUED


def test_the_queue_is_asked_once_for_all_and_not_too_often(cluster: Cluster, tmp_path: Path) -> None:
    several = backend("launcher.poll=3600")
    jobs = [several.submit(fake_training.make(tmp_path / f"run{i}").path) for i in range(5)]
    for _ in range(10):
        for job in jobs:
            job.poll()
    assert sum(arguments[0] == "squeue" for arguments in cluster.asked) == 1


@pytest.mark.slow
def test_the_next_sweep_finds_a_living_job_and_only_that(cluster: Cluster, run: RunDirectory) -> None:
    assert backend().adopt(run.path) is None
    job = submit(cluster, run)
    adopted = backend().adopt(run.path)
    assert adopted is not None
    assert adopted.number == job.number
    cluster.queue[job.number] = ("PENDING", "somebody's else")  # the number was given out again
    assert backend().adopt(run.path) is None
    cluster.queue[job.number] = ("COMPLETED", run.id)
    assert backend().adopt(run.path) is None
    (run.path / slurm.JOB_FILE).write_text("{")
    assert backend().adopt(run.path) is None


def test_cancelling_asks_the_worker_first(cluster: Cluster, run: RunDirectory) -> None:
    job = submit(cluster, run)
    cluster.asked.clear()
    job.cancel()
    assert cluster.asked == [
        ["scancel", "--state=PENDING", job.number],
        ["scancel", "--signal=TERM", "--full", job.number],
    ]
    job.cancel(force=True)
    assert cluster.asked[-1] == ["scancel", job.number]


def test_a_machine_without_slurm_is_one_clear_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.which", lambda program: None)
    with pytest.raises(UserError, match=r"launcher=slurm: sbatch not found"):
        backend()


def test_a_refusal_carries_sbatch_s_own_words(
    cluster: Cluster, run: RunDirectory, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bin" / "sbatch").write_text(
        "#!/bin/sh\necho 'sbatch: error: invalid partition specified: x' >&2\nexit 1\n"
    )
    with pytest.raises(SubmitError, match=r"sbatch refused: .*invalid partition specified: x"):
        backend().submit(run.path)
    assert capfd.readouterr() == ("", "")


def test_every_key_is_explained() -> None:
    text = Path("conf/launcher/slurm.yaml").read_text()
    for key in Slurm.__dataclass_fields__:
        assert f"\n{key}:" in text


@pytest.mark.parametrize("option", ["--array=0-3", "-Q", "--parsable", "--wrap=ls"])
def test_an_option_that_sbatch_would_answer_otherwise(cluster: Cluster, option: str) -> None:
    with pytest.raises(UserError, match=rf"launcher\.sbatch={option}: auvbench sets this option itself"):
        backend(f"launcher.sbatch=['{option}']")


@pytest.mark.slow
def test_the_line_that_names_the_mistake_is_passed_on(
    cluster: Cluster, run: RunDirectory, tmp_path: Path
) -> None:
    (tmp_path / "bin" / "sbatch").write_text(
        "#!/bin/sh\necho 'sbatch: unrecognized option --foo' >&2\n"
        "echo 'Try \"sbatch --help\" for more information' >&2\nexit 1\n"
    )
    with pytest.raises(SubmitError, match=r"^sbatch refused: unrecognized option --foo$") as caught:
        backend().submit(run.path)
    assert caught.value.exit_code == 2


def test_a_second_signal_leaves_at_once(cluster: Cluster, run: RunDirectory) -> None:
    job = submit(cluster, run, "launcher.grace=100000")
    cluster.queue[job.number] = ("RUNNING", run.id)
    found = loop.Loop([run], job.backend, views.View(Console(), [run]))
    adopted = job.backend.adopt(run.path)
    assert adopted is not None
    found.waiting.clear()
    found.active[adopted] = run
    for _ in range(2):
        found._note(signal.SIGINT, None)
        found._obey()
    assert cluster.asked[-1] == ["scancel", job.number]
    assert not found.goes_on()
    assert found.result.of(loop.Outcome.INTERRUPTED) == {run.path: f"{adopted} gets the signal to end"}
    assert found.result.exit_code == 130


def test_a_dry_run_shows_the_batch_script_and_submits_nothing(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["train", "--dry-run", "-m", "algo=pid", "seed=0,1", "launcher=slurm"]) == 0
    said = capsys.readouterr().out
    assert said.count("#SBATCH --job-name=pid-bluerov2_2026-k1-f10-s0-") == 1
    assert cluster.scripts == []
    assert not (tmp_path / "outputs").exists()
