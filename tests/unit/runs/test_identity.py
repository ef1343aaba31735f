"""The same configuration is the same directory; nothing else is."""

from __future__ import annotations

import shutil

import pytest
from omegaconf import OmegaConf

from auvbench.analysis.load import load
from auvbench.config.compose import typed
from auvbench.errors import ConfigError, RunError
from auvbench.runs import identity
from auvbench.runs.directory import RunDirectory, find_runs, freeze, place
from auvbench.runs.plan import prepare
from tests import configs


def plain(*overrides: str) -> dict:
    return configs.plain(*overrides)


@pytest.fixture(scope="module")
def base() -> str:
    return identity.run_id(plain())


@pytest.mark.parametrize(
    "override",
    [
        "name=other",
        "output=elsewhere",
        "launcher.workers=7",
        "train.progress=false",
        "train.log=wandb",
        "train.checkpoint.seconds=5",
        "simulator.threads=2",
        "reward.k=1.0",
        "+vehicle.rigid_body.mass.source=wu2018",
    ],
)
def test_what_cannot_change_the_result_is_not_part_of_the_id(override, base):
    assert identity.run_id(plain(override.removeprefix("+"))) == base


@pytest.mark.parametrize(
    "override",
    [
        "seed=43",
        "reward.k=2",
        "step.frequency=25",
        "algo.gamma=0.98",
        "train.total_steps=10",
        "noise.sign=positive",
        "simulator.max_step=0.005",
        "vehicle.rigid_body.mass.value=16",
        "task.max_steps=999",
    ],
)
def test_what_changes_the_result_changes_the_id(override, base):
    assert identity.run_id(plain(override)) != base


def test_an_id_is_readable():
    config = plain("algo=sac", "reward.k=40", "step.frequency=55", "seed=7")
    assert identity.run_id(config).startswith("sac-k40-f55-s7-")


def test_an_id_names_a_vehicle_that_is_not_the_default_one(base):
    config = plain("vehicle=rexrov", "reward.k=40", "seed=7")
    assert identity.run_id(config) == f"ppo-rexrov-k40-f10-s7-{identity.digest(config)}"
    assert identity.run_id(plain("vehicle=bluerov2")) == base
    assert (
        plain()["vehicle"]["name"] == identity.DEFAULT_VEHICLE
    )  # or ids would say less than the configuration


def test_the_name_of_a_vehicle_cannot_leave_its_folder():
    config = plain() | {"vehicle": {"name": "../a b"}}
    assert identity.run_id(config).startswith("ppo-.._a_b-k1-")


def test_the_id_is_the_one_of_older_runs():
    # A change here orphans everybody's runs: raise SCHEMA_VERSION instead of mending this number.
    minimal = {
        "algo": {"name": "ppo", "agent": "ppo"},
        "reward": {"k": 1.0},
        "step": {"frequency": 10.0},
        "seed": 42,
        "name": "x",
    }
    assert identity.run_id(minimal) == "ppo-k1-f10-s42-" + identity.digest(minimal)
    assert identity.digest(minimal) == "777dc6c1"


def test_runs_older_than_compiled_updates_keep_id_and_updates():
    older = plain("algo=sac", "algo.updates=sb3", "algo.n_steps=1")
    assert identity.run_id(plain("algo=sac")) != identity.run_id(older)
    of_sb3 = identity.run_id(older)
    del older["algo"]["updates"], older["algo"]["n_steps"]
    assert identity.run_id(older) == of_sb3
    assert typed(OmegaConf.create(older)).algo.updates == "sb3"


def test_runs_older_than_the_fine_term_of_goal_keep_their_id():
    older = plain("task=docking", "reward.fine=0")
    of_one_term = identity.run_id(older)
    assert identity.run_id(plain("task=docking")) != of_one_term
    del older["reward"]["fine"], older["reward"]["fine_length"]
    assert identity.run_id(older) == of_one_term
    assert typed(OmegaConf.create(older)).reward.fine == 0.0


def test_controllers_have_no_budget():
    assert identity.run_id(plain("algo=pid", "train.total_steps=5")) == identity.run_id(plain("algo=pid"))


def test_a_changed_config_is_refused(tmp_path):
    config = plain(f"output={tmp_path}")
    run = freeze(config)
    assert freeze(config).path == run.path
    text = run.config_path.read_text(encoding="utf-8")
    run.config_path.write_text(text.replace("k: 1.0", "k: 40.0"), encoding="utf-8")
    with pytest.raises(RunError, match=r"config.yaml was changed.*its id is ppo-k40-"):
        freeze(config)
    with pytest.raises(RunError, match="does not belong to this run"):
        run.check()


def test_freezing_writes_what_resolves_to_the_same_run(tmp_path):
    run = prepare(configs.composed(f"output={tmp_path}", "algo=td3"), "auvbench train algo=td3")
    assert place(run.config()).path == run.path
    assert run.check()["algo"]["name"] == "td3"
    manifest = run.manifest()
    assert (manifest["state"], manifest["command"]) == ("pending", "auvbench train algo=td3")


@pytest.mark.slow
def test_finding_runs(tmp_path):
    runs = [freeze(plain(f"output={tmp_path}", f"seed={seed}", "name=a")) for seed in range(3)]
    assert {run.id for run in find_runs([tmp_path])} == {run.id for run in runs}
    assert [run.id for run in find_runs([runs[0].path, runs[0].path])] == [runs[0].id]
    (tmp_path / "linked").symlink_to(runs[0].path)
    (tmp_path / "a" / "report").mkdir()
    shutil.copytree(runs[0].path, tmp_path / "a" / "report" / "b")
    shutil.copytree(runs[0].path, tmp_path / "tune" / "study" / "runs" / "trial")
    assert [run.id for run in find_runs([tmp_path])] == sorted(run.id for run in runs)
    assert {run.id for run in load([tmp_path])[0]} == {run.id for run in runs}
    with pytest.raises(RunError, match="no such file or directory"):
        find_runs([tmp_path / "nowhere"])
    (tmp_path / "empty").mkdir()
    with pytest.raises(RunError, match="not a run directory"):
        find_runs([tmp_path / "empty"])


def test_damaged_files_are_named(tmp_path):
    run = RunDirectory(freeze(plain(f"output={tmp_path}")).path)
    run.manifest_path.write_text('{"schema_version": 1,', encoding="utf-8")
    with pytest.raises(RunError, match=r"manifest.json: damaged"):
        run.manifest()
    run.manifest_path.write_text('{"schema_version": 99}', encoding="utf-8")
    with pytest.raises(RunError, match=r"schema_version 99, but this auvbench reads 1"):
        run.manifest()
    run.config_path.write_text("a: [", encoding="utf-8")
    with pytest.raises(RunError, match=r"config.yaml: damaged"):
        run.config()


def test_what_cannot_change_the_result_is_taken_from_the_latest_command(tmp_path):
    first = freeze(plain(f"output={tmp_path}"))
    again = freeze(plain(f"output={tmp_path}", "simulator.threads=2", "train.checkpoint.keep=7"))
    assert again.path == first.path
    config = again.check()
    assert (config["simulator"]["threads"], config["train"]["checkpoint"]["keep"]) == (2, 7)
    again.update_manifest(state="complete")
    freeze(plain(f"output={tmp_path}"))
    assert again.check()["simulator"]["threads"] == 2  # a complete run says how it was made


@pytest.mark.slow
@pytest.mark.parametrize(
    ("override", "key", "value"),
    [
        ("simulator.namespace=bluerov2", "simulator.namespace", "bluerov2"),
        ("simulator.timeout=3", "simulator.timeout", 3.0),
        ("train.progress=false", "train.progress", False),
        ("launcher.workers=7", "launcher.workers", 7),
    ],
)
def test_a_run_that_goes_on_takes_what_is_typed_beyond_its_identity(override, key, value, tmp_path):
    words = (f"output={tmp_path}", "simulator=ros2", "simulator.namespace=blurov2")
    first = freeze(plain(*words))
    first.update_manifest(state="failed")
    assert freeze(plain(*words, override)).path == first.path
    assert OmegaConf.select(OmegaConf.create(first.check()), key) == value


def test_compiled_updates_take_relu_alone():
    with pytest.raises(ConfigError, match=r"algo.activation=tanh: must be relu with algo.updates=compiled"):
        typed(OmegaConf.create(plain("algo=td3", "algo.activation=tanh")))
    typed(OmegaConf.create(plain("algo=td3", "algo.activation=tanh", "algo.updates=sb3")))


def test_a_folder_may_be_renamed(tmp_path):
    """The manifest has the id; the configuration is compared with it."""
    run = freeze(plain("algo=pid", f"output={tmp_path}"))
    renamed = RunDirectory(run.path.rename(tmp_path / "my_best"))
    assert renamed.id == run.path.name
    assert renamed.check() == renamed.config()
    renamed.config_path.write_text(renamed.config_path.read_text().replace("effort: 1.0", "effort: 0.5"))
    with pytest.raises(RunError, match="does not belong to this run"):
        renamed.check()


def test_a_manifest_names_no_folder_elsewhere(tmp_path):
    run = freeze(plain("algo=pid", f"output={tmp_path}"))
    run.update_manifest(id="../../elsewhere")
    assert RunDirectory(run.path).id == run.path.name
