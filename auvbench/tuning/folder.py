"""Manage the folder of a study, `<output>/tune/<name>/`, and its plan; docs/tuning.md describes the layout."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from optuna.storages.journal import BaseJournalBackend

from auvbench import __version__
from auvbench.config import schema
from auvbench.config.algorithms import learns
from auvbench.config.tuning import Tune, refuse_test
from auvbench.config.validate import evaluate_protocol, validate_fields
from auvbench.errors import AuvbenchError, ConfigError, RunError
from auvbench.runs import identity, lock
from auvbench.runs.atomic_io import make_folder, storage, write_json
from auvbench.runs.directory import damaged
from auvbench.runs.run_filter import flat
from auvbench.tuning import space
from auvbench.tuning.space import Dimension
from auvbench.untrusted import path_safety, reading, typed_json
from auvbench.untrusted.text import short
from auvbench.untrusted.typed_json import Prose

CONTROLLER = "controller"
"""name of the folder with the lock of the study's controller; it is next to the journal"""

LARGEST = 1 << 28
"""largest journal to read, in bytes"""

DIGEST = "digest"


class Journal(BaseJournalBackend):
    """Journal of a study: a file of operations, which only the process with the study's lock may write.

    Raises:
        RunError: a line is damaged, or the file cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.logs: list[dict[str, Any]] = []
        self._last, self._size = "", 0
        try:
            data = reading.content(path_safety.child(path.parent, path.name), LARGEST)
        except FileNotFoundError:
            return
        except (OSError, ValueError) as error:
            raise RunError(f"{path}: cannot be read: {error}") from error
        for line in data.split(b"\n")[:-1]:  # text after the last line break is incomplete
            self._take(line)

    def _take(self, line: bytes) -> None:
        try:
            log = reading.json_value(line)
            if not isinstance(log, dict) or log.pop(DIGEST, "") != self._digest(log):
                raise ValueError("its digest does not match this line and the lines before")
        except ValueError as error:
            why = str(error).splitlines()[0]
            raise RunError(
                f"{self.path} line {len(self.logs) + 1} is damaged ({why}): restore the file, or start over "
                f"(mv {self.path} ELSEWHERE). Finished runs are reused."
            ) from error
        self._last = self._digest(log)
        self._size += len(line) + 1
        self.logs.append(log)

    def _digest(self, log: dict[str, Any]) -> str:
        text = json.dumps([self._last, log], separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def read_logs(self, log_number_from: int) -> list[dict[str, Any]]:
        """Return the operations from number `log_number_from` on."""
        return self.logs[log_number_from:]

    def append_logs(self, logs: list[dict[str, Any]]) -> None:
        """Append operations to the journal, and sync the file to disk before returning.

        Raises:
            LockLostError: another process has the lock of the study.
            TrainingError: the disk is full or failing.
        """
        lock.verify(self.path.parent / CONTROLLER)
        with storage(f"cannot write {self.path}"):
            descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
            with open(descriptor, "r+b") as file:
                file.truncate(self._size)
                file.seek(self._size)
                for log in logs:
                    plain = json.loads(json.dumps(log))
                    line = json.dumps({**plain, DIGEST: self._digest(plain)}, separators=(",", ":")).encode()
                    file.write(line + b"\n")
                    self._take(line)
                file.flush()
                os.fsync(file.fileno())


SCHEMA_VERSION = 2
"""version of study.json and of the journal"""

RUNS, FRESH = "runs", "fresh"
"""folders of the trials' runs and of the runs with fresh seeds"""

FREE = ("trials", "fresh_seeds")
"""keys of `tune` that may change when a study continues"""


@dataclass(frozen=True)
class Plan:
    """Definition of a study, stored in study.json."""

    name: str
    seed: int
    base: dict[str, Any]
    """plain configuration of a run, in which each trial replaces algo, seed, name, output and budget"""
    tune: Tune
    """settings of the search; `tune.space` has all ranges of the study"""
    protocol: schema.Protocol
    command: Prose
    version: str = __version__
    schema_version: int = SCHEMA_VERSION

    @cached_property
    def dimensions(self) -> tuple[Dimension, ...]:
        """Return the search space."""
        return tuple(space.read({}, self.tune.space, {}, space.keys_of(self.base["algo"])))

    @property
    def learns(self) -> bool:
        """Return whether the algorithm is trained."""
        return learns(self.base["algo"])

    @property
    def budgets(self) -> tuple[int, ...]:
        """Return the environment steps of each rung; one rung if trials are not pruned or not trained."""
        single_rung = self.tune.pruner == "none" or not self.learns
        return tuple(self.tune.rungs[-1:] if single_rung else self.tune.rungs)

    @property
    def fresh_protocol(self) -> schema.Protocol:
        """Return the protocol for runs with fresh seeds: validation scenarios outside the search."""
        return replace(
            self.protocol, name=f"{self.protocol.name}-fresh", seed=(self.protocol.seed + 1) % (1 << 32)
        )


class StudyFolder:
    """Paths of a study."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.plan_path = path / "study.json"
        self.journal = path / "journal.log"
        self.runs, self.fresh = path / RUNS, path / FRESH
        self.report, self.best = path / "report", path / "best.yaml"

    def hold(self) -> lock.RunLock:
        """Lock the study for this process.

        Raises:
            RunError: another process has the lock, the folder is not writable, or a link leads out of the folder.
        """
        place = self.path / CONTROLLER
        with storage(f"cannot write {self.path}"):
            names = (CONTROLLER, RUNS, FRESH, "report", self.journal.name, self.plan_path.name)
            path_safety.check_output(self.path, names)
            make_folder(place)
        return lock.acquire(place)

    def write(self, plan: Plan) -> None:
        """Write the plan to study.json. When a study continues, the plan may have another number of trials and other fresh seeds."""
        with storage(f"cannot write {self.plan_path}"):
            write_json(self.plan_path, asdict(plan))

    def read(self) -> Plan:
        """Return the plan of the study.

        Raises:
            RunError: the plan is missing, damaged, or of another version.
        """
        try:
            plan = typed_json.read(self.plan_path, Plan)
            if plan.schema_version != SCHEMA_VERSION:
                raise ValueError(f"schema_version is {plan.schema_version}, must be {SCHEMA_VERSION}")
            validate_fields(plan.tune, "tune.")
            evaluate_protocol(plan.protocol)
            refuse_test(plan.protocol)
            if not plan.dimensions or not plan.budgets:
                raise ValueError("it has no ranges or no rungs")
        except FileNotFoundError as error:
            raise RunError(f"{self.path}: not a study (study.json is missing)") from error
        except (AuvbenchError, OSError, LookupError, TypeError, ValueError, AttributeError) as error:
            raise damaged(self.plan_path, error, "study") from error
        return plan


def of_run(run: Path) -> tuple[Plan, schema.Protocol]:
    """Return the plan of a run's study, and the protocol that tests the run."""
    plan = StudyFolder(run.absolute().parent.parent).read()
    return plan, plan.fresh_protocol if run.absolute().parent.name == FRESH else plan.protocol


def refuse_change(folder: StudyFolder, stored: Plan, typed: Plan) -> None:
    """Reject a command that would change the study in the folder.

    Raises:
        ConfigError: a value differs; the message names the changed values.
    """
    searched = {**stored.tune.space, **typed.tune.space}
    old, new = (_values(plan, searched) for plan in (stored, typed))
    changed = [key for key in dict.fromkeys([*old, *new]) if old.get(key) != new.get(key)]
    if changed:
        shown = [
            f"{key} {short(old.get(key, 'not searched'), 60)} -> {short(new.get(key, 'not searched'), 60)}"
            for key in changed[:4]
        ]
        more = f" and {len(changed) - 4} more" if len(changed) > 4 else ""
        raise ConfigError(
            f"{folder.path}: the study has other values: {', '.join(shown)}{more}; give the old values to continue, "
            "or name=NAME for another study"
        )


def _values(plan: Plan, searched: Mapping[str, str]) -> dict[str, Any]:
    """Return the values that define a study, by key; a searched key has its range instead of a value."""
    values = flat(
        {
            "seed": plan.seed,
            "tune": {k: v for k, v in asdict(plan.tune).items() if k not in ("space", *FREE)},
            "protocol": asdict(plan.protocol),
            **identity.relevant(plan.base),
        }
    )
    return {**{key: value for key, value in values.items() if key not in searched}, **plan.tune.space}
