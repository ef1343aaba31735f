"""Check trackers."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from auvbench import tracking
from auvbench.config.compose import compose
from auvbench.errors import ConfigError, closest
from auvbench.registry import TRACKERS, resolve
from auvbench.testing.draws import ConformanceError, failing, run_checks, untouched
from auvbench.tracking import Service

KEY = "0123456789abcdef0123456789abcdef"
SCALARS = {"train/loss": 0.5, "rollout/return": -3.0, "train/not_finite": float("nan")}


def _config() -> dict[str, Any]:
    plain = OmegaConf.to_container(compose("train", ["algo=ppo"]), resolve=True)
    assert isinstance(plain, dict)
    return {str(key): value for key, value in plain.items()}


def it_logs_a_training(service: Service) -> None:
    """Check that a log opens, accepts numbers (also NaN) and closes, without a draw from a global generator."""
    with untouched("logging"):
        with failing("prepare"):
            service.prepare("conformance")
        with failing("start"):
            log = service.start(KEY, _config(), "ppo-first")
        for step in (0, 1, 1000):
            with failing("write"):
                log.write(SCALARS, step)
        with failing("close"):
            log.close(None)


def an_attempt_continues_the_log_of_an_earlier_one(service: Service) -> None:
    """Check that a log opens again with the same key after a failure, and then accepts a step that is lower than the last one logged."""
    with failing("prepare"):
        service.prepare("conformance")
    for step, error in (
        (10, RuntimeError("stopped by the conformance check, which then resumes the log")),
        (5, None),
    ):
        with failing("start, close, and start with the same key"):
            log = service.start(KEY, _config(), "ppo-first")
            log.write(SCALARS, step)
            log.close(error)


def it_changes_nothing_that_it_gets(service: Service) -> None:
    """Check that the tracker does not change the configuration and the scalars of a run."""
    config, scalars = _config(), {"train/loss": 0.5}
    with failing("start"):
        log = service.start(KEY, config, "ppo-first")
    with failing("write"):
        log.write(scalars, 1)
    with failing("close"):
        log.close(None)
    if config != _config():
        raise ConformanceError("start changes the configuration of the run")
    if scalars != {"train/loss": 0.5}:
        raise ConformanceError("write changes the scalars of the run")


def it_logs_a_table(service: Service) -> None:
    """Check that a ranked table with the files of its report can be logged, and that the files do not change."""
    with tempfile.TemporaryDirectory(prefix="auvbench-testing-") as folder:
        file = Path(folder) / "table.csv"
        csv = "agent,success_rate\nppo,0.5\n"
        file.write_text(csv)
        with failing("table"):
            service.table("conformance", csv, [file])
        if not file.is_file() or file.read_text() != csv:
            raise ConformanceError("table changes a file of the report")


TRACKER_CHECKS: tuple[Callable[[Service], None], ...] = (
    it_logs_a_training,
    an_attempt_continues_the_log_of_an_earlier_one,
    it_changes_nothing_that_it_gets,
    it_logs_a_table,
)
"""Checks of every tracker."""


def check_tracker(name: str, only: Callable[[Any], None] | None = None) -> None:
    """Check a tracker against its contract (`auvbench.tracking.Service`).

    The check logs to the destination that is set in the settings of the tracker's client.

    Args:
        name: value of `train.log`.
        only: one of `TRACKER_CHECKS`; default: all.

    Raises:
        ConformanceError: the tracker breaks its contract.
        ConfigError: the name is unknown, or the tracker lacks a function.
        MissingExtraError: the tracker's client is not installed.
    """
    if name not in TRACKERS.names():
        raise ConfigError(f"train.log={name}: unknown; {closest(name, TRACKERS.names())}")
    tracking.prepare.cache_clear()
    tracking.prepare(name, "conformance")
    service: Service = resolve(TRACKERS[name].code)
    run_checks(TRACKER_CHECKS, only, (f"train.log={name}",), lambda check: check(service))
