"""Scalars of runs and ranked tables in Weights & Biases or MLflow, through their own clients.

A log changes neither a run's id nor its bits. The environment variables of the clients set server, project and mode
(docs/tracking.md).
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

from auvbench.errors import AuvbenchError, AuvbenchWarning, ConfigError, MissingExtraError
from auvbench.registry import TRACKERS, resolve

LOCAL = "tensorboard"
"""the value of `train.log` with which the run's TensorBoard file is the only log"""


class Tracker(Protocol):
    """A logged run that is open."""

    def write(self, scalars: Mapping[str, float], step: int) -> None:
        """Add scalars by name at an environment step."""

    def close(self, error: BaseException | None) -> None:
        """End the logged run, or with an error this attempt."""


class Service(Protocol):
    """What the module of a tracker offers. An exception in any of them is a line for the user."""

    def prepare(self, experiment: str) -> None:
        """Do before the first run of a grid what its runs cannot do at once; `experiment` is the `name` of the runs."""

    def start(self, key: str, config: Mapping[str, Any], name: str) -> Tracker:
        """Open the logged run of a training; see `tracking.start`."""

    def table(self, name: str, csv: str, files: list[Path]) -> None:
        """Log a ranked table; see `tracking.table`."""


@functools.cache
def prepare(service: str, experiment: str) -> None:
    """Do before the first run of a grid what its runs cannot do at once: import the client, and make MLflow's experiment.

    Args:
        service: `train.log`.
        experiment: `name` of the runs.

    Raises:
        MissingExtraError: the client is not installed.
        ConfigError: MLflow's server or database does not answer; its reason is named.
    """
    if service == LOCAL:
        return
    with _refusals(f"train.log={service}"):
        _client(service).prepare(experiment)


def start(service: str, key: str, config: Mapping[str, Any], name: str) -> Tracker | None:
    """Open the logged run of a training, or the one that an earlier attempt opened; None for TensorBoard alone.

    Args:
        service: `train.log`.
        key: 32 hexadecimal digits, the same for each attempt of a run.
        config: the run's resolved configuration.
        name: the run's id.

    Raises:
        MissingExtraError: the client is not installed.
        ConfigError: the client cannot log; its reason is named.
    """
    if service == LOCAL:
        return None
    with _refusals(f"train.log={service}"):
        return _Lenient(_client(service).start(key, config, name), f"train.log={service}")


def table(service: str, name: str, csv: str, files: list[Path]) -> None:
    """Log a ranked table with the files of its report, as a logged run of its own.

    Args:
        service: one of `registry.TRACKERS`.
        name: of the logged run.
        csv: the table.
        files: of the report.

    Raises:
        MissingExtraError: the client is not installed.
        ConfigError: the client cannot log; its reason is named.
    """
    with _refusals(f"--log {service}"):
        _client(service).table(name, csv, files)


class _Lenient:
    """A tracker whose failure ends the log, not the training."""

    def __init__(self, tracker: Tracker, what: str) -> None:
        self._tracker: Tracker | None = tracker
        self._what = what

    def write(self, scalars: Mapping[str, float], step: int) -> None:
        self._try(lambda tracker: tracker.write(scalars, step))

    def close(self, error: BaseException | None) -> None:
        self._try(lambda tracker: tracker.close(error))

    def _try(self, action: Callable[[Tracker], None]) -> None:
        if self._tracker is None:
            return
        try:
            action(self._tracker)
        except Exception as error:
            self._tracker = None
            message = f"{self._what}: {_first_line(error)}; the training goes on without this log"
            warnings.warn(AuvbenchWarning(message), stacklevel=3)


def _client(service: str) -> Service:
    """Return the module of a service, which imports its client."""
    spec = TRACKERS.choose(service)
    try:
        module: Service = resolve(spec.code)
    except ModuleNotFoundError as error:
        if not spec.extra:
            raise
        raise MissingExtraError(service, extra=spec.extra, purpose=f"logging to {service}") from error
    lacking = [name for name in ("prepare", "start", "table") if not callable(getattr(module, name, None))]
    if lacking:
        raise ConfigError(
            f"train.log={service}: {spec.code} lacks {', '.join(lacking)} (auvbench.tracking.Service)"
        )
    return module


@contextmanager
def _refusals(what: str) -> Iterator[None]:
    """Turn an exception of a client into one line for the user."""
    try:
        yield
    except AuvbenchError:
        raise
    except Exception as error:
        raise ConfigError(
            f"{what}: {_first_line(error)}; docs/tracking.md names the client's settings"
        ) from error


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return f"{type(error).__name__}: {lines[0].rstrip('.')}" if lines else type(error).__name__
