"""The folder of a study, `<output>/tune/<name>/`, and the plan in it; docs/tuning.md has the layout."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from auvbench import __version__
from auvbench.config import schema
from auvbench.config.agents import learns
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

SCHEMA_VERSION = 2
"""version of study.json and of the journal"""

RUNS, FRESH = "runs", "fresh"
"""folders of the trials' runs and of the runs with fresh seeds"""

FREE = ("trials", "fresh_seeds")
"""keys of `tune` that may change in a study that goes on"""


@dataclass(frozen=True, slots=True)
class Plan:
    """What defines a study."""

    name: str
    seed: int
    base: dict[str, Any]
    """plain configuration of a run; a trial sets algo, seed, name, output and budget"""
    dimensions: tuple[Dimension, ...]
    tune: Tune
    protocol: schema.Protocol
    command: str = ""

    @property
    def learns(self) -> bool:
        """Return whether the algorithm is trained."""
        return learns(self.base["algo"])

    @property
    def budgets(self) -> tuple[int, ...]:
        """Return the environment steps of each rung; one rung where nothing is pruned or trained."""
        one = self.tune.pruner == "none" or not self.learns
        return tuple(self.tune.rungs[-1:] if one else self.tune.rungs)

    @property
    def fresh_protocol(self) -> schema.Protocol:
        """Return the test of runs with fresh seeds: validation scenarios that the search has not seen."""
        return replace(
            self.protocol, name=f"{self.protocol.name}-fresh", seed=(self.protocol.seed + 1) % (1 << 32)
        )


class StudyFolder:
    """The paths of a study."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.plan_path = path / "study.json"
        self.journal = path / "journal.log"
        self.runs, self.fresh = path / RUNS, path / FRESH
        self.report, self.best = path / "report", path / "best.yaml"

    def hold(self) -> lock.RunLock:
        """Lock the study for this process.

        Raises:
            RunHeldError: Another process holds it.
            RunError: The folder cannot be written, or a link leads out of it.
        """
        place = self.path / CONTROLLER
        with storage(f"cannot write {self.path}"):
            names = (CONTROLLER, RUNS, FRESH, "report", self.journal.name, self.plan_path.name)
            path_safety.check_output(self.path, names)
            make_folder(place)
        try:
            return lock.acquire(place)
        except lock.RunHeldError as error:
            raise lock.RunHeldError(
                place,
                error.holder,
                f"{self.path}: {error.holder} is searching here; wait for it, or start another study with name=NAME",
            ) from error

    def write(self, plan: Plan) -> None:
        """Write the plan; a study that goes on takes the trials and fresh seeds that were typed."""
        with storage(f"cannot write {self.plan_path}"):
            write_json(self.plan_path, _plain(plan))

    def read(self) -> Plan:
        """Return the plan of the study.

        Raises:
            RunError: It is missing, damaged, or of another version.
        """
        try:
            data = documents.json_value(reading.content(self.plan_path))
        except FileNotFoundError as error:
            raise RunError(f"{self.path}: not a study (study.json is missing)") from error
        except (OSError, ValueError) as error:
            raise damaged(self.plan_path, error, "study") from error
        version = data.get("schema_version") if isinstance(data, dict) else None
        if version != SCHEMA_VERSION:
            raise RunError(
                f"{self.plan_path}: schema_version is {version}, and this auvbench reads {SCHEMA_VERSION}; use the auvbench "
                "that wrote it, or start another study with name=NAME"
            )
        if found := interpolations.first(data):
            raise RunError(
                f"{self.plan_path}: {found}: a study's plan holds no interpolation; restore the file"
            )
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


def of_run(run: Path) -> tuple[Plan, schema.Protocol]:
    """Return the plan of a run's study, and the protocol that tests the run."""
    plan = StudyFolder(run.absolute().parent.parent).read()
    return plan, plan.fresh_protocol if run.absolute().parent.name == FRESH else plan.protocol


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


def refuse_change(folder: StudyFolder, there: Plan, here: Plan) -> None:
    """Refuse a command that would change the study in the folder.

    Raises:
        ConfigError: Names the changed values.
    """
    old, new = (_comparable(plan) for plan in (there, here))
    if found := _differences(old, new):
        more = f" and {len(found) - 4} more" if len(found) > 4 else ""
        raise ConfigError(
            f"{folder.path}: the study has other values: {', '.join(found[:4])}{more}; type the old values to go on, "
            "or name=NAME for another study"
        )


def _comparable(plan: Plan) -> dict[str, Any]:
    plain = _plain(plan)
    return {
        **plain["space"],
        "seed": plan.seed,
        "tune": {key: value for key, value in plain["tune"].items() if key not in FREE},
        "protocol": plain["protocol"],
        **identity.relevant(plan.base),
    }


def _differences(there: Any, here: Any, path: str = "") -> list[str]:
    if isinstance(there, dict) and isinstance(here, dict):
        return [
            line
            for key in dict.fromkeys([*there, *here])
            for line in _differences(there.get(key), here.get(key), f"{path}.{key}" if path else key)
        ]
    was, now = ("not searched" if value is None else value for value in (there, here))
    return [] if there == here else [f"{path} {was} -> {now}"]
