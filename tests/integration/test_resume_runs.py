"""Runs that are interrupted, ill or out of disk, and go on: the same bits as a run that nothing happened to."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

from auvbench.agents.learned.sb3 import Follower
from auvbench.cli import main
from auvbench.errors import ConfigError, RunError, TrainingError
from auvbench.runs import lock
from auvbench.runs.directory import RunDirectory
from auvbench.runs.interruption import Interrupted
from auvbench.training.checkpoint.extending import prepare
from auvbench.training.checkpoint.store import CheckpointStore, CheckpointWarning
from auvbench.training.execute import execute
from tests.conftest import Trained
from tests.soak.bits import bits
from tests.soak.campaign import frozen

CASES = ("ppo-8", pytest.param("sac-8", marks=pytest.mark.slow))
WITH_RESIDUAL = pytest.mark.parametrize(
    "case", [*CASES, pytest.param("ppo_residual-8", marks=pytest.mark.slow)], indirect=True
)
"""for what depends on the algorithm; the rest does not tell PPO with a residual from PPO"""
EVERY = "train.checkpoint.steps=200"


@pytest.fixture(scope="module", params=CASES)
def case(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def whole(case: str, trained: Trained) -> dict[str, str]:
    """Return the bits of the run that nothing happens to."""
    return bits(trained(case).path)


@pytest.fixture
def run(case: str, tmp_path: Path) -> RunDirectory:
    made = frozen(tmp_path, "tried", case, [EVERY])
    assert isinstance(made, RunDirectory)
    return made


Strike = Callable[[int, Callable[[Follower], None]], None]


@pytest.fixture
def strike(monkeypatch: pytest.MonkeyPatch) -> Strike:
    """Calls a function once, in the first step of the environments at or after a number of steps."""
    ordinary = Follower._on_step

    def arm(step: int, blow: Callable[[Follower], None]) -> None:
        armed = [True]

        def on_step(self: Follower) -> bool:
            going_on = ordinary(self)
            if armed and self.num_timesteps >= step:
                armed.clear()
                blow(self)
            return going_on

        monkeypatch.setattr(Follower, "_on_step", on_step)

    return arm


@pytest.mark.slow
@WITH_RESIDUAL
def test_cadence_does_not_change_a_bit(whole: dict[str, str], run: RunDirectory) -> None:
    execute(run)
    assert len(CheckpointStore(run.path).steps()) == 2
    assert bits(run.path) == whole


@pytest.mark.slow
def test_nothing_in_a_run_needs_unpickling(run: RunDirectory) -> None:
    execute(run)
    kinds = set()
    for path in run.path.rglob("*"):
        if not path.is_file():
            continue
        kinds.add(path.suffix)
        if path.suffix == ".pt":
            torch.load(path, weights_only=True)
        elif path.suffix == ".npz":
            with np.load(path, allow_pickle=False) as arrays:
                assert all(not arrays[name].dtype.hasobject for name in arrays.files)
        elif "tfevents" not in path.name:
            path.read_text(encoding="utf-8")  # a pickle begins with a byte that is no UTF-8
    assert {".pt", ".npz", ".json", ".yaml", ".csv"} <= kinds


@pytest.mark.slow
def test_a_checkpoint_by_the_clock_does_not_change_a_bit(
    case: str, whole: dict[str, str], tmp_path: Path
) -> None:
    run = frozen(tmp_path, "timed", case, ["train.checkpoint.seconds=0.2", "train.checkpoint.keep=1"])
    execute(run)
    assert len(CheckpointStore(run.path).steps()) == 1
    assert bits(run.path) == whole


@pytest.mark.slow
@WITH_RESIDUAL
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_signals_save_and_leave(
    whole: dict[str, str], run: RunDirectory, strike: Strike, number: signal.Signals, code: int
) -> None:
    strike(600, lambda _: os.kill(os.getpid(), number))
    with pytest.raises(Interrupted, match="saved at step") as caught:
        execute(run)
    assert caught.value.exit_code == code
    assert run.manifest()["state"] == "interrupted"
    steps = CheckpointStore(run.path).steps()
    assert steps[0] >= 600
    assert run.manifest()["steps"] == steps[0]
    before, used = run.manifest()["phases"], run.manifest()["cpu_time_s"]
    assert before["training_s"] > 0
    execute(run)
    assert bits(run.path) == whole
    assert run.manifest()["cpu_time_s"] > used > 0
    after = run.manifest()["phases"]  # of both attempts
    assert all(after[name] >= before[name] for name in before)
    assert after["setup_s"] > before["setup_s"]


@WITH_RESIDUAL
@pytest.mark.slow
def test_a_run_without_normalisation_resumes_as_well(case: str, tmp_path: Path, strike: Strike) -> None:
    plain = ["train.normalise_observations=false", "train.normalise_rewards=false"]
    whole = frozen(tmp_path, "whole", case, plain)
    execute(whole)
    run = frozen(tmp_path, "tried", case, [EVERY, *plain])
    strike(600, lambda _: os.kill(os.getpid(), signal.SIGTERM))
    with pytest.raises(Interrupted):
        execute(run)
    execute(run)
    assert bits(run.path) == bits(whole.path)


@pytest.mark.slow
def test_without_time_to_save_the_last_checkpoint_counts(
    case: str, whole: dict[str, str], run: RunDirectory, strike: Strike, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("auvbench.training.learning.GRACE", -1.0)
    strike(900, lambda _: os.kill(os.getpid(), signal.SIGTERM))
    # SAC's rollout is one step of the batch: there is always time to end it.
    message = "the last checkpoint is of step" if case.startswith("ppo") else "saved at step"
    with pytest.raises(Interrupted, match=message):
        execute(run)
    monkeypatch.undo()
    execute(run)
    assert bits(run.path) == whole


@pytest.mark.slow
def test_a_nan_in_the_physics_stops_the_run(whole: dict[str, str], run: RunDirectory, strike: Strike) -> None:
    def blow(recorder: Follower) -> None:
        recorder.training_env.get_attr("batch")[0].simulator.pose[3, 1] = np.nan

    strike(700, blow)
    with pytest.raises(TrainingError, match=r"environment 3 is (nan|not finite)"):
        execute(run)
    manifest = run.manifest()
    assert manifest["state"] == "failed"
    assert 700 <= manifest["error"]["step"] <= 720
    assert "environment 3" in manifest["error"]["message"]
    assert 0 < CheckpointStore(run.path).steps()[0] < 700
    execute(run)
    assert bits(run.path) == whole


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.slow
def test_weights_that_are_no_numbers_stop_the_run(
    whole: dict[str, str], run: RunDirectory, strike: Strike, value: float
) -> None:
    def blow(recorder: Follower) -> None:
        with torch.no_grad():
            next(iter(recorder.model.policy.parameters())).view(-1)[0] = value

    strike(700, blow)
    with pytest.raises(TrainingError, match=r"step \d+: "):
        execute(run)
    assert run.manifest()["state"] == "failed"
    assert CheckpointStore(run.path).steps()[0] < 900
    execute(run)
    assert bits(run.path) == whole


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::auvbench.training.checkpoint.store.CheckpointWarning")
@pytest.mark.parametrize("damage", ["flip", "truncate"])
def test_damage_to_any_component_costs_time_alone(
    whole: dict[str, str], run: RunDirectory, strike: Strike, damage: str
) -> None:
    def crash(_: Follower) -> None:
        raise TrainingError("crash")

    rng = np.random.default_rng(0)
    for step in (800, 880, 950):
        strike(step, crash)
        with pytest.raises(TrainingError, match="crash"):
            execute(run)
        store = CheckpointStore(run.path)
        newest = store.folder / str(store.steps()[0])
        victims = [path for path in (*newest.iterdir(), *store.folder.glob("replay/*")) if path.is_file()]
        victim = victims[rng.integers(len(victims))]
        data = bytearray(victim.read_bytes())
        if damage == "flip":
            data[rng.integers(len(data))] ^= 1 << int(rng.integers(8))
        victim.write_bytes(data if damage == "flip" else data[: len(data) // 3])
    execute(run)
    assert bits(run.path) == whole


@pytest.mark.slow
def test_a_damaged_checkpoint_is_named(run: RunDirectory, strike: Strike) -> None:
    strike(900, lambda _: os.kill(os.getpid(), signal.SIGTERM))
    with pytest.raises(Interrupted):
        execute(run)
    newest, older = CheckpointStore(run.path).steps()
    (run.path / f"checkpoints/{newest}/policy.pt").write_bytes(b"rubbish")
    with pytest.warns(CheckpointWarning, match=rf"step {newest} .*policy\.pt.*using the one of step {older}"):
        execute(run)


@pytest.mark.slow
def test_clocks_that_jump_backwards_do_not_matter(
    whole: dict[str, str], run: RunDirectory, strike: Strike, monkeypatch: pytest.MonkeyPatch
) -> None:
    strike(600, lambda _: os.kill(os.getpid(), signal.SIGTERM))
    with pytest.raises(Interrupted):
        execute(run)
    now, now_ns = time.time, time.time_ns
    monkeypatch.setattr(time, "time", lambda: now() - 86_400.0)
    monkeypatch.setattr(time, "time_ns", lambda: now_ns() - 86_400 * 10**9)
    execute(run)
    assert bits(run.path) == whole


@pytest.mark.slow
def test_the_manifest_knows_the_last_checkpoint_while_the_run_goes_on(
    run: RunDirectory, strike: Strike
) -> None:
    """So that a kill -9 leaves more than "running, step 0"."""
    seen = []
    strike(900, lambda _: seen.append((run.manifest(), CheckpointStore(run.path).steps()[0])))
    execute(run)
    (manifest, step), *_ = seen
    assert manifest["state"] == "running"
    assert manifest["steps"] == step >= 600
    assert manifest["wall_time_s"] > 0.0


@pytest.mark.slow
def test_a_run_that_somebody_took_over_is_not_written_to(
    run: RunDirectory, strike: Strike, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []

    def files() -> dict[Path, bytes]:
        return {path: path.read_bytes() for path in run.path.rglob("*") if path.is_file()}

    def lost(*_: object, **__: object) -> None:
        seen.append(files())
        raise lock.LockLostError("taken over")

    strike(700, lambda _: monkeypatch.setattr(lock, "verify", lost))
    with pytest.raises(lock.LockLostError):
        execute(run)
    (before,) = seen
    assert files() == before


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 3 MB."""
    mount = tmp_path / "disk"
    mount.mkdir()
    try:
        command = ["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", str(mount)]
        done = subprocess.run(command, capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        done = False
    if not done:
        pytest.skip("mounting a small tmpfs needs root")
    yield mount
    subprocess.run(["umount", "-l", str(mount)], check=True)


def fill(disk: Path) -> None:
    with (disk / "ballast").open("wb", buffering=0) as file:
        try:
            while True:
                file.write(b"\0" * 4096)
        except OSError:
            return


@pytest.mark.slow
def test_a_full_disk_is_named_and_costs_nothing(
    case: str, whole: dict[str, str], small_disk: Path, strike: Strike, capsys: pytest.CaptureFixture[str]
) -> None:
    run = frozen(small_disk, "tried", case, [EVERY])
    strike(500, lambda _: fill(small_disk))
    assert main(["resume", str(run.path)]) == 1
    error = capsys.readouterr().err
    assert "disk is full; free some space and run the same command again" in error
    assert error.count("\n") == 1
    store = CheckpointStore(run.path)
    assert store.peek() is not None
    assert run.manifest()["steps"] >= store.steps()[0] - 200
    assert not [path for path in store.folder.iterdir() if path.name.startswith(".")]
    with pytest.raises(TrainingError, match="disk is full"):  # still full: still one clear line
        execute(run)
    (small_disk / "ballast").unlink()
    execute(run)
    assert bits(run.path) == whole


@pytest.mark.slow
def test_outputs_that_become_read_only_are_named_and_cost_nothing(
    case: str, whole: dict[str, str], small_disk: Path, strike: Strike
) -> None:
    run = frozen(small_disk, "tried", case, [EVERY])
    # The table of episodes is open, and a file system with files open for writing refuses a plain remount.
    strike(500, lambda recorder: protect(small_disk, recorder))
    with pytest.raises(TrainingError, match="read-only; make it writable"):
        execute(run)
    with pytest.raises(TrainingError, match="read-only"):
        execute(run)
    subprocess.run(["umount", str(small_disk)], check=True)
    execute(run)
    assert bits(run.path) == whole


def protect(disk: Path, recorder: Follower) -> None:
    """A read-only bind mount over the run's disk: what is opened from now on is refused."""
    subprocess.run(["mount", "--bind", str(disk), str(disk)], check=True)
    subprocess.run(["mount", "-o", "remount,bind,ro", str(disk)], check=True)


TOTALS = {"ppo-8": (1000, 2000), "sac-8": (500, 1000), "ppo_residual-8": (1000, 2000)}


@pytest.mark.slow
@WITH_RESIDUAL
def test_an_extended_run_is_the_longer_run(case: str, whole: dict[str, str], tmp_path: Path) -> None:
    small, large = TOTALS[case]
    run = frozen(tmp_path, "tried", case, [f"train.total_steps={small}"])
    execute(run)
    before = {path: path.read_bytes() for path in run.path.rglob("*") if path.is_file()}
    assert main(["resume", str(run.path), f"train.total_steps={large}"]) == 0
    assert {path: path.read_bytes() for path in run.path.rglob("*") if path.is_file()} == before
    longer = frozen(tmp_path, "tried", case, [])
    assert longer.path != run.path
    assert bits(longer.path) == whole
    assert main(["resume", str(run.path), f"train.total_steps={large}"]) == 0  # nothing left to do


def test_what_cannot_be_extended_says_why(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = frozen(tmp_path, "tried", case, [])
    with pytest.raises(RunError, match="has no checkpoint to extend"):
        prepare(run, 10_000).begin()
    with pytest.raises(ConfigError, match=r"train\.total_steps=10: must be more than"):
        prepare(run, 10).begin()
    linear = frozen(tmp_path, "tried", case, ["algo.learning_rate_schedule=linear"])
    with pytest.raises(RunError, match=r"learning_rate_schedule=linear.*depends on train\.total_steps"):
        prepare(linear, 10_000).begin()
    assert main(["resume", str(run.path), "algo.gamma=0.9"]) == 2
    assert "algo.gamma=0.9" in capsys.readouterr().err
    assert main(["resume", str(run.path), "train.total_steps=2.5"]) == 2
    assert "'2.5' is not a whole number" in capsys.readouterr().err
    assert main(["resume"]) == 2
    assert main(["resume", str(tmp_path / "nowhere")]) == 2


@pytest.mark.slow
def test_resume_finishes_an_interrupted_run(
    whole: dict[str, str], run: RunDirectory, strike: Strike, capsys: pytest.CaptureFixture[str]
) -> None:
    strike(600, lambda _: os.kill(os.getpid(), signal.SIGTERM))
    assert main(["resume", str(run.path)]) == 143
    assert "stopped by SIGTERM, saved at step" in capsys.readouterr().err
    assert main(["resume", str(run.path)]) == 0
    assert bits(run.path) == whole
    assert main(["resume", str(run.path)]) == 0
    assert "complete already" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("cases", "said"), [(["ppo-8"], "complete already"), (["ppo-8", "sac-8"], "complete           2")]
)
def test_resume_of_complete_runs_imports_nothing_heavy(cases: list[str], said: str, trained: Trained) -> None:
    code = (
        "import sys; from auvbench.cli import main; code = main(['resume', *sys.argv[1:]]);"
        "print([name for name in ('torch', 'hydra', 'omegaconf', 'numba') if name in sys.modules]); sys.exit(code)"
    )
    typed = [sys.executable, "-c", code, *(str(trained(case).path) for case in cases)]
    shown = subprocess.run(typed, capture_output=True, text=True, check=True).stdout
    assert said in shown
    assert shown.splitlines()[-1] == "[]"


@pytest.mark.slow
def test_resume_finishes_several_runs_side_by_side(trained: Trained, tmp_path: Path) -> None:
    """In fresh processes of their own, which end with the same bits as one here."""
    runs = [frozen(tmp_path / "tried", "tried", "sac-8", [EVERY, *seed]) for seed in ([], ["seed=7"])]
    other = frozen(tmp_path / "tried", "tried", "ppo-8", [])
    assert main(["resume", str(tmp_path / "tried"), "--workers", "2", "--where", "algo=sac"]) == 0
    assert bits(runs[0].path) == bits(trained("sac-8").path)
    assert [run.manifest()["state"] for run in (runs[1], other)] == ["complete", "pending"]
