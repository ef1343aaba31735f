"""Ctrl-C at any instant is an interruption, whatever a library makes of the exception on its way."""

from __future__ import annotations

import contextlib
import os
import signal
from pathlib import Path

import pytest

from auvbench.config.compose import translate
from auvbench.errors import ConfigError
from auvbench.runs import interruption
from auvbench.runs.directory import RunDirectory
from auvbench.runs.interruption import Interrupted
from auvbench.training import worker
from tests import fake_training


def swallows(_run: RunDirectory) -> None:
    """A library that catches everything, and falls over what it then lacks."""
    found = None
    with contextlib.suppress(BaseException):
        os.kill(os.getpid(), signal.SIGTERM)
    print(found.name)  # type: ignore[attr-defined]


def wraps(_run: RunDirectory) -> None:
    try:
        os.kill(os.getpid(), signal.SIGTERM)
    except BaseException as error:
        raise ConfigError("actuators.value: unknown key") from error


@pytest.mark.parametrize("target", ["swallows", "wraps"])
def test_a_run_is_interrupted_and_not_failed(tmp_path: Path, target: str) -> None:
    run = fake_training.make(tmp_path / "run")
    assert worker.work(run.path, target=f"{__name__}:{target}") == 128 + signal.SIGTERM
    manifest = run.manifest()
    assert (manifest["state"], manifest["error"]) == ("interrupted", None)


def test_an_error_of_the_runs_own_is_a_failure(tmp_path: Path) -> None:
    run = fake_training.make(tmp_path / "run", fail_at=1)
    assert worker.work(run.path, target="tests.fake_training:execute") == 1
    assert run.manifest()["state"] == "failed"


def test_the_interruption_behind_an_error_is_found() -> None:
    error = ValueError("x")
    assert interruption.cause(error) is None
    error.__context__ = RuntimeError()
    error.__context__.__context__ = first = Interrupted(signal.SIGINT)
    first.__context__ = error  # a circle
    assert interruption.cause(error) is first


def test_ctrl_c_while_composing_is_no_mistake_of_the_users() -> None:
    error = ConfigError("")
    wrapped = RuntimeError("unknown key")
    wrapped.__context__ = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        translate(wrapped)
    assert translate(error) is error
