"""Runs whose files were edited or damaged: named with what is wrong and what to do, and no cost to the others."""

from __future__ import annotations

import errno
import json
import os
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest

from auvbench import cli
from auvbench.errors import RunError, plain_warnings
from auvbench.runs import directory, identity
from auvbench.runs.directory import RunDirectory, freeze
from auvbench.scheduling import loop
from auvbench.scheduling.loop import Phase, Status
from auvbench.training.checkpoint import extending
from auvbench.training.checkpoint.store import CheckpointWarning
from tests import configs, fake_training

ORDINARY = warnings.formatwarning
Harm = Callable[[Path], object]


def frozen(folder: Path, *overrides: str, state: str = "complete") -> RunDirectory:
    run = freeze(configs.plain(*overrides) | {"output": str(folder)})
    run.update_manifest(state=state)
    return run


def edited(old: str, new: str) -> Harm:
    def harm(path: Path) -> None:
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new))

    return harm


def without(key: str) -> Harm:
    def harm(path: Path) -> None:
        config = RunDirectory(path.parent).config()
        del config[key]
        path.write_text(json.dumps(config))

    return harm


def a_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def a_dangling_link(path: Path) -> None:
    path.unlink()
    path.symlink_to("nowhere")


HARMS = [
    (edited("seed: 42", "seed: 43"), "its id is ppo-k1-f10-s43-"),
    (edited("seed: 42", "seed: abc"), "its id is ppo-k1-f10-sabc-"),
    (edited("seed: 42", "seed: .nan"), "it has no id (ValueError"),
    (edited("seed: 42", "seed: 2026-13-45"), "its id is ppo-k1-f10-s2026-13-45-"),
    (edited("agent: ppo", "agent: sac"), "its id is ppo-k1-f10-s42-"),
    (without("reward"), "it has no id (KeyError: 'reward')"),
    (lambda path: path.write_text("algo: 3"), "it has no id (TypeError"),
    (lambda path: path.write_text(""), "config.yaml: damaged: not a mapping"),
    (lambda path: path.write_bytes(b"\x80\x00\xff"), "config.yaml: damaged"),
    (Path.unlink, "config.yaml: missing; restore it"),
    (a_folder, "config.yaml: damaged: Is a directory"),
    (a_dangling_link, "replace it by its target"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("harm", "message"), HARMS)
def test_a_config_that_is_not_the_run_s_is_refused_whatever_the_state(
    harm: Harm, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = frozen(tmp_path)
    harm(run.config_path)
    for arguments in (["resume", str(run.path)], ["resume", str(run.path), "train.total_steps=9000000"]):
        assert cli.main(arguments) == 2
        error = capsys.readouterr().err
        assert message in error
        assert error.count("\n") == 1
    assert cli.main(["evaluate", str(run.path)]) == 2
    assert message in capsys.readouterr().err
    assert cli.main(["train", *configs.ORIGINAL, f"output={tmp_path}"]) == 2
    error = capsys.readouterr().err
    assert str(run.path) in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("train", [[], {"progress": []}, {"total_steps": "many"}, 3])
@pytest.mark.parametrize("more", [[], ["train.total_steps=9000000"]])
def test_resume_refuses_a_configuration_of_other_types_that_has_the_run_s_id(
    train: object, more: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = frozen(tmp_path, state="interrupted")
    config = run.config()
    config["train"] = config["train"] | train if isinstance(train, dict) else train
    run.write_config(config)
    try:
        run.update_manifest(id=identity.run_id(config))
        moved = run.path.rename(run.path.with_name(identity.run_id(config)))
    except (TypeError, AttributeError):  # such a configuration has no id
        moved = run.path
    assert cli.main(["resume", str(moved), *more]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "train" in error.lower()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"schema_version": 1}', "damaged: its seal is missing; restore it"),
        ('{"schema_version": 1, "state": "comp', "damaged: Unterminated string"),
        (
            None,
            "damaged: steps is 'many', must be a whole number; restore it, or remove the run's folder",
        ),
        (None, "damaged: state is 'done', must be one of pending, running"),
    ],
)
def test_a_manifest_that_lacks_what_is_read_is_one_clear_line(
    text: str | None, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = frozen(tmp_path)
    if text is None:
        run.update_manifest(**({"steps": "many"} if "steps" in message else {"state": "done"}))
    else:
        run.manifest_path.write_text(text)
    for arguments in (["train", *configs.ORIGINAL, f"output={tmp_path}"], ["resume", str(run.path)]):
        assert cli.main(arguments) == 2
        error = capsys.readouterr().err
        assert message in error
        assert error.count("\n") == 1


@pytest.mark.slow
def test_damaged_runs_of_a_folder_are_named_and_the_others_carried_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    seeds = [frozen(tmp_path, "algo=random", f"seed={seed}", state="pending") for seed in range(4)]
    seeds[0].manifest_path.write_bytes(seeds[0].manifest_path.read_bytes()[:100])
    edited("seed: 1", "seed: 7")(seeds[1].config_path)
    assert cli.main(["resume", str(tmp_path), "--workers", "1"]) == 1
    out = capsys.readouterr().out.replace("\n", " ")
    assert f"damaged: {seeds[0].manifest_path}: damaged: " in out
    assert "its id is random-k1-f10-s7-" in out
    assert "2 complete, 2 failed" in out
    assert [run.manifest()["state"] for run in seeds[2:]] == ["complete", "complete"]
    # Nothing left to do for the others: the damaged ones are still named and counted.
    assert cli.main(["resume", str(tmp_path)]) == 1
    assert f"damaged: {seeds[0].manifest_path}" in capsys.readouterr().out


@pytest.mark.slow
def test_a_grid_goes_on_beside_a_damaged_manifest(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = frozen(tmp_path, "algo=random", "seed=0")
    run.manifest_path.write_text("{")
    assert (
        cli.main(
            [
                "train",
                "-m",
                *configs.original(f"output={tmp_path}", "algo=random", "seed=0,1", "launcher.workers=1"),
            ]
        )
        == 1
    )
    assert "1 complete, 1 failed" in capsys.readouterr().out


def test_a_warning_of_ours_is_one_line_without_code() -> None:
    plain_warnings()
    try:
        text = warnings.formatwarning(CheckpointWarning("step 200 is damaged"), CheckpointWarning, "a.py", 1)
        assert text == "auvbench: warning: step 200 is damaged\n"
        assert "a.py:1: UserWarning" in warnings.formatwarning("other", UserWarning, "a.py", 1)
    finally:
        warnings.formatwarning = ORDINARY


@pytest.mark.slow
def test_all_runs_of_a_folder_are_checked_before_the_first_is_extended(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for seed in range(2):
        frozen(tmp_path, f"seed={seed}")
    frozen(tmp_path, "algo=random")

    def unsuitable(run: RunDirectory, total: int) -> extending.Extension:
        if run.id.startswith("random"):
            raise RunError("random does not learn")
        return extending.Extension(run, run.config(), run, None)

    monkeypatch.setattr(extending, "prepare", unsuitable)
    monkeypatch.setattr(extending.Extension, "begin", lambda *_: pytest.fail("one was extended"))
    assert cli.main(["resume", str(tmp_path), "train.total_steps=9000000"]) == 2
    assert (
        "random does not learn (1 of 3 runs cannot be extended; no run was changed)"
        in capsys.readouterr().err
    )


@pytest.mark.parametrize(("fault", "code"), [(errno.ENOSPC, 1), (errno.EACCES, 2)])
def test_a_full_disk_is_no_mistake_of_the_user_s(
    fault: int, code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def write(path: Path, data: bytes) -> None:
        raise OSError(fault, os.strerror(fault), str(path))

    monkeypatch.setattr(directory, "write_atomic", write)
    assert cli.main(["train", f"output={tmp_path}", "algo=random"]) == code
    assert os.strerror(fault).split()[-1] in capsys.readouterr().err.replace("disk is full", "device")


@pytest.mark.parametrize(
    ("state", "steps", "message"),
    [("pending", 0, "stopped before it started"), ("interrupted", 30, "saved at step 30")],
)
def test_a_job_stopped_in_the_queue_has_saved_nothing(
    state: str, steps: int, message: str, tmp_path: Path
) -> None:
    run = fake_training.make(tmp_path / "ppo-a")
    run.update_manifest(state=state, steps=steps)
    outcome, said = loop.judge(run, Stopped(), Status(Phase.ENDED), cancelled=True)
    assert (outcome, said) == (loop.Outcome.INTERRUPTED, message)


class Stopped:
    run = Path()
    mark = None

    def poll(self) -> Status:
        return Status(Phase.ENDED)

    def cancel(self, *, force: bool = False) -> None:
        pass
