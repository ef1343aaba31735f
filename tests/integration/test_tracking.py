"""Runs and ranked tables in MLflow's database and in the offline files of Weights & Biases, by their own clients."""

from __future__ import annotations

import json
import struct
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from auvbench import tracking
from auvbench.agents.learned.sb3 import Follower
from auvbench.commands import report
from auvbench.errors import AuvbenchWarning, ConfigError, MissingExtraError, TrainingError
from auvbench.registry import TRACKERS
from auvbench.runs.directory import RunDirectory
from auvbench.training.execute import execute
from tests import synthetic
from tests.conftest import Trained
from tests.soak.bits import bits, scalars
from tests.soak.campaign import frozen

CASE = "ppo-8"


def _forget() -> None:
    """Let Weights & Biases, which other tests use too, forget the folder of its first run."""
    if sys.modules.get("wandb") is not None:
        sys.modules["wandb"].teardown()


@pytest.fixture(autouse=True)
def offline(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.chdir(tmp_path)
    for name in ("WANDB_PROJECT", "WANDB_DIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("WANDB_ERROR_REPORTING", "false")
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path}/mlflow.db")
    _forget()
    yield
    _forget()


def stopped_once(service: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> RunDirectory:
    """Return a run that failed between two checkpoints and went on."""
    run = frozen(folder, "logged", CASE, [f"train.log={service}", "train.checkpoint.steps=300"])
    ordinary = Follower._on_step
    struck = []

    def on_step(self: Follower) -> bool:
        if not struck and self.num_timesteps >= 1000:
            struck.append(self.num_timesteps)
            raise RuntimeError("struck")
        return ordinary(self)

    monkeypatch.setattr(Follower, "_on_step", on_step)
    with pytest.raises(TrainingError, match="struck"):
        execute(run)
    execute(run)
    return run


def records(file: Path) -> Iterator[object]:
    """Yield the records of a `.wandb` file: a LevelDB log of protocol buffers after a header of 7 bytes."""
    from wandb.proto.wandb_internal_pb2 import Record

    data, at, whole = file.read_bytes(), 7, b""
    while at + 7 <= len(data):
        if (1 << 15) - at % (1 << 15) < 7:  # the end of a block holds no header
            at += (1 << 15) - at % (1 << 15)
            continue
        _, length, kind = struct.unpack_from("<IHB", data, at)
        whole += data[at + 7 : at + 7 + length]
        at += 7 + length
        if kind in (1, 4):  # a full record, or the last part of one
            record = Record()
            record.ParseFromString(whole)
            whole = b""
            yield record


def logged_wandb(folder: Path) -> tuple[set[str], dict[str, dict[int, float]]]:
    """Return the ids of the logged runs, and their scalars by name and step."""
    ids, found = set(), {}
    for file in sorted(folder.glob("wandb/offline-run-*/*.wandb")):
        for record in records(file):
            kind = record.WhichOneof("record_type")  # type: ignore[attr-defined]
            if kind == "run":
                ids.add(record.run.run_id)  # type: ignore[attr-defined]
            elif kind == "history":
                history = record.history  # type: ignore[attr-defined]
                for item in history.item:
                    name = item.key or "/".join(item.nested_key)
                    found.setdefault(name, {})[history.step.num] = json.loads(item.value_json)
    return ids, found


def logged_mlflow() -> tuple[set[str], dict[str, dict[int, float]]]:
    from mlflow.tracking import MlflowClient

    client = MlflowClient()
    experiment = client.get_experiment_by_name("logged")
    (run,) = client.search_runs([experiment.experiment_id])
    assert run.info.status == "FINISHED"
    assert run.data.params["algo"] == "ppo"
    history = {name: client.get_metric_history(run.info.run_id, name) for name in run.data.metrics}
    return {run.info.run_id}, {name: {m.step: m.value for m in values} for name, values in history.items()}


@pytest.mark.slow
@pytest.mark.parametrize("service", TRACKERS.own)
def test_a_run_that_goes_on_has_one_log_and_the_bits_of_an_unlogged_one(
    service: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, trained: Trained
) -> None:
    pytest.importorskip(service)
    alone = trained(CASE)
    run = stopped_once(service, tmp_path, monkeypatch)
    assert run.id == alone.id
    assert bits(run.path) == bits(alone.path)
    ids, found = logged_wandb(tmp_path) if service == "wandb" else logged_mlflow()
    assert len(ids) == 1
    for name, values in scalars(run.path).items():
        if not name.startswith("time/"):
            assert found[name] == pytest.approx(dict(values), rel=1e-6, nan_ok=True), name


@pytest.mark.slow
@pytest.mark.parametrize("service", TRACKERS.own)
def test_a_report_is_logged_with_its_table(service: str, tmp_path: Path) -> None:
    pytest.importorskip(service)
    synthetic.write_experiment(tmp_path / "outputs" / "study")
    assert report.main(["outputs/study", "--log", service, "--no-figures"]) == 0
    expected = (tmp_path / "outputs/study/report/table.csv").read_text().splitlines()
    (table,) = tmp_path.glob(
        "wandb/offline-run-*/files/media/table/*.json" if service == "wandb" else "mlruns/*/*/*/ranking.json"
    )
    found = json.loads(table.read_text())
    assert found["columns"][1:] == expected[0].split(",")
    assert [row[1] for row in found["data"]] == [line.split(",")[0] for line in expected[1:]]


@pytest.mark.parametrize("service", TRACKERS.own)
def test_a_missing_client_is_named(service: str, monkeypatch: pytest.MonkeyPatch) -> None:
    tracking.prepare.cache_clear()  # of a test before, as are the modules
    monkeypatch.delitem(sys.modules, str(TRACKERS.choose(service).code), raising=False)
    for name in [name for name in sys.modules if name.startswith(f"{service}.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, service, None)
    with pytest.raises(MissingExtraError, match=rf"pip install 'auvbench\[{service}\]'"):
        tracking.prepare(service, "study")


class Full:
    """The module of a client whose logs fail at step 2."""

    def start(self, *_: object) -> Full:
        return self

    def write(self, _: object, step: int) -> None:
        if step == 2:
            raise OSError("quota used up\nat length")

    def close(self, _: object) -> None:
        raise AssertionError("closed after it failed")

    def table(self, *_: object) -> None:
        raise OSError("no login.")


def test_a_client_that_fails_ends_the_log_and_not_the_training(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracking, "_client", lambda *_: Full())
    tracker = tracking.start("wandb", "0" * 32, {}, "run")
    assert tracker is not None
    tracker.write({"loss": 1.0}, 1)
    with pytest.warns(AuvbenchWarning, match="quota used up; the training goes on"):
        tracker.write({"loss": 1.0}, 2)
    tracker.write({"loss": 1.0}, 2)
    tracker.close(None)
    with pytest.raises(ConfigError, match="--log wandb: OSError: no login;"):
        tracking.table("wandb", "report", "", [])
