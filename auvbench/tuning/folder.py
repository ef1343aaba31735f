"""The folder of a study: `<output>/tune/<name>/`; docs/tuning.md has the layout."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from auvbench import __version__
from auvbench.config import schema
from auvbench.config.tuning import Tune, refuse_test
from auvbench.config.validate import check, evaluate_protocol
from auvbench.errors import AuvbenchError, ConfigError, RunError
from auvbench.runs import identity, interpolations, lock
from auvbench.runs.atomic_io import make_folder, storage
from auvbench.runs.directory import damaged, now
from auvbench.runs.files import write_json
from auvbench.tuning import space
from auvbench.tuning.journal import CONTROLLER
from auvbench.tuning.space import Dimension
from auvbench.untrusted import documents, path_safety, reading

SCHEMA_VERSION = 1
"""of study.json and of what a study's journal means"""

RUNS, FRESH = "runs", "fresh"
"""Folders of the trials' runs, and of those with fresh seeds."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What a study is: with the same plan, seed and results it decides the same."""

    name: str
    seed: int
    base: dict[str, Any]
    """a run's plain configuration, whose `algo` the trials vary; seed, name, output and budget are theirs"""
    dimensions: tuple[Dimension, ...]
    tune: Tune
    protocol: schema.Protocol
    command: str = ""

    @property
    def budgets(self) -> tuple[int, ...]:
        return tuple(self.tune.rungs)


@dataclass(frozen=True, slots=True)
class StudyFolder:
    """Where a study lies."""

    path: Path

    @property
    def plan_path(self) -> Path:
        return self.path / "study.json"

    @property
    def journal(self) -> Path:
        return self.path / "journal.log"

    @property
    def runs(self) -> Path:
        return self.path / RUNS

    @property
    def fresh(self) -> Path:
        return self.path / FRESH

    @property
    def report(self) -> Path:
        return self.path / "report"

    @property
    def best(self) -> Path:
        return self.path / "best.yaml"

    def hold(self) -> lock.RunLock:
        """Lock the study for this process.

        Raises:
            RunHeldError: another process holds it.
            RunError: the folder cannot be written.
        """
        place = self.path / CONTROLLER
        with storage(f"cannot write {self.path}"):
            path_safety.check_output(
                self.path, (CONTROLLER, RUNS, FRESH, "report", "journal.log", "study.json")
            )
            make_folder(place)
        try:
            return lock.acquire(place)
        except lock.RunHeldError as error:
            raise lock.RunHeldError(
                place,
                error.holder,
                f"{self.path}: {error.holder} searches here at present; a study has one controller (another "
                "name=NAME is another study)",
            ) from error

    def write(self, plan: Plan) -> None:
        """Keeps the plan; a study that is there already goes on with what was typed for trials and fresh seeds."""
        with storage(f"cannot write {self.plan_path}"):
            write_json(self.plan_path, _plain(plan))

    def read(self) -> Plan:
        """The plan of the study.

        Raises:
            RunError: it is missing, damaged, or of another version.
        """
        try:
            data = documents.json_value(reading.content(self.plan_path))
        except FileNotFoundError as error:
            raise RunError(f"{self.path}: this is no study (study.json is missing)") from error
        except (OSError, ValueError) as error:
            raise damaged(self.plan_path, error, "study") from error
        version = data.get("schema_version") if isinstance(data, dict) else None
        if version != SCHEMA_VERSION:
            raise RunError(
                f"{self.plan_path}: schema_version {version}, but this auvbench reads {SCHEMA_VERSION}; use the auvbench "
                "that wrote it, or give the study another name"
            )
        if found := interpolations.first(data):
            raise RunError(f"{self.plan_path}: {found}: a study's plan is resolved, so this one was edited")
        try:
            return _read(data)
        except (
            AuvbenchError,
            OmegaConfBaseException,
            KeyError,
            TypeError,
            ValueError,
            AttributeError,
        ) as error:
            raise damaged(self.plan_path, error, "study") from error


def _plain(plan: Plan) -> dict[str, Any]:
    return {
        "schema_version": SCHEMA_VERSION,
        "name": plan.name,
        "command": plan.command,
        "created": now(),
        "version": __version__,
        "seed": plan.seed,
        "tune": {key: value for key, value in asdict(plan.tune).items() if key != "space"},
        "space": {dimension.key: dimension.text for dimension in plan.dimensions},
        "protocol": asdict(plan.protocol),
        "base": plan.base,
    }


def _read(data: Mapping[str, Any]) -> Plan:
    tune = _typed(Tune, {**data["tune"], "space": {}})
    protocol = _typed(schema.Protocol, data["protocol"])
    check(tune, "tune.")
    evaluate_protocol(protocol)
    refuse_test(protocol)
    base = dict(data["base"])
    dimensions = tuple(space.read({}, data["space"], {}, space.keys_of(base["algo"])))
    return Plan(str(data["name"]), int(data["seed"]), base, dimensions, tune, protocol, str(data["command"]))


def _typed(kind: type, values: Mapping[str, Any]) -> Any:
    return OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(kind), dict(values)))


FREE = ("trials", "fresh_seeds")
"""What may be typed anew for a study that goes on."""


def changed(there: Plan, here: Plan) -> list[str]:
    """What tells a study from the one that is typed, in words; empty where it is the same."""
    old, new = (
        {**plain, "base": identity.relevant(plain["base"])} for plain in (_plain(there), _plain(here))
    )
    found = []
    for key in dict.fromkeys([*old["space"], *new["space"]]):
        before, after = old["space"].get(key), new["space"].get(key)
        if before != after:
            found.append(f"{key} {_was(before)} -> {_was(after)}")
    if not found and list(old["space"]) != list(new["space"]):
        found.append("the order of the searched keys")
    if there.seed != here.seed:
        found.append(f"seed {there.seed} -> {here.seed}")
    for part in ("tune", "protocol", "base"):
        found += _differences(old[part], new[part], "" if part == "base" else part)
    return found


def _was(text: str | None) -> str:
    return "not searched" if text is None else text


def _differences(there: Any, here: Any, path: str) -> list[str]:
    if isinstance(there, dict) and isinstance(here, dict):
        found = []
        for key in dict.fromkeys([*there, *here]):
            if path == "tune" and key in FREE:
                continue
            found += _differences(there.get(key), here.get(key), f"{path}.{key}" if path else str(key))
        return found
    return [] if there == here else [f"{path} {there} -> {here}"]


def refuse_change(folder: StudyFolder, there: Plan, here: Plan) -> None:
    """Raises ConfigError where another study lies in the folder: it says what changed and how to go on."""
    found = changed(there, here)
    if found:
        more = f" and {len(found) - 4} more" if len(found) > 4 else ""
        raise ConfigError(
            f"{folder.path}: was begun with other values: {', '.join(found[:4])}{more}; type them as before to go on, "
            "or name=NAME for a study of its own"
        )


def fresh_protocol(plan: Plan) -> schema.Protocol:
    """The test of runs with fresh seeds: as many scenarios of the same stream, none of which the search has seen."""
    return replace(
        plan.protocol, name=f"{plan.protocol.name}-fresh", seed=(plan.protocol.seed + 1) % (1 << 32)
    )


def protocol_of(plan: Plan, run: Path) -> schema.Protocol:
    """What a run of the study is tested by."""
    return fresh_protocol(plan) if run.absolute().parent.name == FRESH else plan.protocol


def of_run(run: Path) -> StudyFolder:
    """The study of a trial's run."""
    return StudyFolder(run.absolute().parent.parent)
