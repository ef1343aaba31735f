"""Log ranked tables, and the scalars of runs, to Weights & Biases or MLflow through the client of each service.

Logging changes neither a run's id nor its results. The clients' environment variables set server, project and
mode (docs/tracking.md).
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
"""value of `train.log` that logs only to the run's TensorBoard file"""


class Tracker(Protocol):
    """An open log of a run at a tracking service; `close` ends the log."""

    def write(self, scalars: Mapping[str, float], step: int) -> None:
        """Add scalars by name at an environment step."""

    def close(self, error: BaseException | None) -> None:
        """End the log; if `error` is not None, mark this attempt of the run as failed."""


class Service(Protocol):
    """Functions that the module of a tracker must define. If one raises, the user sees the first line of the exception."""

    def prepare(self, experiment: str) -> None:
        """Create what parallel runs cannot create themselves; called once, before the first run of a grid.

        `experiment` is the `name` of the runs.
        """

    def start(self, key: str, config: Mapping[str, Any], name: str) -> Tracker:
        """Open the service's log of a run; see `tracking.start`."""

    def table(self, name: str, csv: str, files: list[Path]) -> None:
        """Log a ranked table; see `tracking.table`."""


@functools.cache
def prepare(service: str, experiment: str) -> None:
    """Import the client and create MLflow's experiment.

    Called once before the first run of a grid, because parallel runs cannot create the experiment themselves.

    Args:
        service: value of `train.log`.
        experiment: `name` of the runs.

    Raises:
        MissingExtraError: the client is not installed.
        ConfigError: MLflow's server or database does not answer; the message has the client's reason.
    """
    if service == LOCAL:
        return
    with _refusals(option := f"train.log={service}"):
        _client(service, option).prepare(experiment)


def start(service: str, key: str, config: Mapping[str, Any], name: str) -> Tracker | None:
    """Open the service's log of a run, or reopen it if an earlier attempt of the run exists; return None for TensorBoard.

    Args:
        service: value of `train.log`.
        key: 32 hexadecimal digits, the same for each attempt of a run.
        config: resolved configuration of the run.
        name: id of the run.

    Raises:
        MissingExtraError: the client is not installed.
        ConfigError: the client cannot log; the message has its reason.
    """
    if service == LOCAL:
        return None
    with _refusals(option := f"train.log={service}"):
        return _Lenient(_client(service, option).start(key, config, name), option)


def table(service: str, name: str, csv: str, files: list[Path]) -> None:
    """Log a ranked table with the files of its report, as a separate logged run.

    Args:
        service: one of `registry.TRACKERS`.
        name: name of the logged run.
        csv: content of the table.
        files: files of the report.

    Raises:
        MissingExtraError: the client is not installed.
        ConfigError: the client cannot log; the message has its reason.
    """
    with _refusals(option := f"--log {service}"):
        _client(service, option).table(name, csv, files)


class _Lenient:
    """Tracker whose failure ends the log, not the training."""

    def __init__(self, tracker: Tracker, option: str) -> None:
        self._tracker: Tracker | None = tracker
        self._option = option

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
            message = f"{self._option}: {_first_line(error)}; the training goes on without this log"
            warnings.warn(AuvbenchWarning(message), stacklevel=3)


def _client(service: str, option: str) -> Service:
    """Return the module of a service, and so import the service's client; `option` is the user's option, for error messages."""
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
            f"{option}: {spec.code} must define {', '.join(lacking)} (see auvbench.tracking.Service)"
        )
    return module


@contextmanager
def _refusals(option: str) -> Iterator[None]:
    """Turn an exception of a client into a `ConfigError` of one line that names the option."""
    try:
        yield
    except AuvbenchError:
        raise
    except Exception as error:
        raise ConfigError(
            f"{option}: {_first_line(error)}; docs/tracking.md lists the client's settings"
        ) from error


def _first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return f"{type(error).__name__}: {lines[0].rstrip('.')}" if lines else type(error).__name__
