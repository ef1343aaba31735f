"""The whole path in a temporary directory, as a user types it: train, evaluate, report."""

from __future__ import annotations

import csv
import json
import re
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
import torch

from auvbench.cli import main

ON_POLICY = ["algo.n_envs=8", "algo.n_steps=32", "algo.batch_size=64", "train.total_steps=512"]
OFF_POLICY = ["algo.n_envs=8", "algo.learning_starts=64", "algo.batch_size=32", "train.total_steps=320"]
OFF_POLICY += ["algo.gradient_steps=1"]
# tests/integration/test_own_agents_conform.py trains, stops and loads every algorithm.
SMALL = {
    "ppo": ON_POLICY,
    "sac": OFF_POLICY,
    "ppo_fast": ["algo.n_envs=8", "algo.batch_size=64", "train.total_steps=512"],
    "recurrent_ppo": [*ON_POLICY, "algo.lstm_size=8"],
    "ppo_residual": ON_POLICY,
    "ppo_thesis": ["algo.n_steps=64", "train.total_steps=128"],
    "sac_thesis": ["algo.learning_starts=64", "train.total_steps=96"],
    "pid": [],
    "random": [],
}
QUICK = ("ppo", "sac", "pid")
ALL = [algo if algo in QUICK else pytest.param(algo, marks=pytest.mark.slow) for algo in SMALL]
SHORT = ["task.max_steps=40", "train.progress=false"]


def auvbench(*arguments: str) -> int:
    return main([str(a) for a in arguments])


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def only_run(folder: Path) -> Path:
    (manifest,) = folder.glob("outputs/default/*/manifest.json")
    return manifest.parent


@pytest.fixture
def outputs(request, once, folder) -> Path:
    """A copy of the outputs of a small training of an algorithm, the test's parameter."""

    def make(made: Path) -> None:
        assert (
            auvbench("train", f"algo={request.param}", *SMALL[request.param], *SHORT, f"output={made}") == 0
        )

    return Path(shutil.copytree(once(f"first-{request.param}", make), folder / "outputs"))


def rows(path: Path) -> list[dict[str, str]]:
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
@pytest.mark.parametrize("outputs", ALL, indirect=True)
def test_every_algorithm_trains_and_is_evaluated(outputs, folder):
    run = only_run(folder)
    manifest = json.loads((run / "manifest.json").read_text())
    assert manifest["state"] == "complete"
    assert manifest["versions"]["torch"] == metadata.version("torch")  # __version__ may add +cu130
    if manifest["algo"] not in ("pid", "random"):
        assert manifest["steps"] >= manifest["total_steps"]
        training = rows(run / "train" / "episodes.csv")
        assert len(training) == manifest["episodes"] > 0
        assert list((run / "train").glob("events.out.tfevents.*"))
        weights = torch.load(run / "model" / "policy.pt", weights_only=True)
        assert all(torch.isfinite(tensor).all() for tensor in weights.values())
    assert (
        auvbench("evaluate", "outputs", "protocol.episodes=3", "protocol.trajectories=2", "--workers", "1")
        == 0
    )
    tested = rows(run / "evaluations" / "test" / "episodes.csv")
    assert [row["episode"] for row in tested] == [str(e) for e in range(3)]
    with np.load(run / "evaluations" / "test" / "trajectories.npz", allow_pickle=False) as archive:
        assert len(archive["position_nominal_0"]) == int(tested[0]["steps"]) + 1
        assert np.linalg.norm(
            archive["position_nominal_1"][-1] - archive["waypoint_nominal_1"]
        ) == pytest.approx(float(tested[1]["final_distance_m"]), rel=1e-5)


@pytest.mark.slow
def test_from_nothing_to_a_ranked_table(folder, capsys):
    for algo in ("ppo", "pid", "random"):
        assert auvbench("train", f"algo={algo}", *SMALL[algo], *SHORT) == 0
    assert auvbench("evaluate", "outputs", "protocol.episodes=8", "--workers", "1") == 0
    tested = capsys.readouterr().out
    assert tested.count(": success ") == 3
    assert auvbench("evaluate", "outputs", "protocol.episodes=8", "--workers", "1") == 0
    assert ": success " not in capsys.readouterr().out
    assert auvbench("report", "outputs", "--no-figures") == 0
    printed = capsys.readouterr().out
    assert printed.lower().index("pid") < printed.lower().index("random"), "PID ranks before random"
    for suffix in ("md", "tex", "csv"):
        assert list(folder.glob(f"outputs/**/report/*.{suffix}")), suffix
    table = rows(folder / "outputs/default/report/table.csv")
    steps = sorted(f"{float(row['par1_steps']):.0f}" for row in table)
    assert sorted(re.findall(r"PAR-1 steps (\d+)", tested)) == steps, "evaluate and report print the same"


@pytest.mark.slow
def test_the_same_command_again_does_nothing(folder, capsys):
    command = ["train", "algo=pid", *SHORT]
    assert auvbench(*command) == 0
    run = only_run(folder)
    assert str(run.relative_to(folder)) in capsys.readouterr().out
    before = {p: p.stat().st_mtime_ns for p in run.rglob("*") if p.is_file()}
    assert auvbench(*command) == 0
    assert "complete already" in capsys.readouterr().out
    assert before == {p: p.stat().st_mtime_ns for p in only_run(folder).rglob("*") if p.is_file()}


@pytest.mark.slow
@pytest.mark.parametrize("outputs", ["ppo"], indirect=True)
def test_the_same_configuration_gives_the_same_bits(outputs, folder):
    command = ["train", "algo=ppo", *SMALL["ppo"], *SHORT, "name=alone"]
    # In a process of its own: what ran before in the other's process may not matter.
    subprocess.run([sys.executable, "-m", "auvbench", *command], check=True, capture_output=True)
    a, b = only_run(folder), next(Path("outputs/alone").glob("*/manifest.json")).parent
    assert a.name == b.name
    assert (a / "train" / "episodes.csv").read_bytes() == (b / "train" / "episodes.csv").read_bytes()
    for key, value in torch.load(a / "model" / "policy.pt", weights_only=True).items():
        other = torch.load(b / "model" / "policy.pt", weights_only=True)[key]
        assert torch.equal(value, other), key


@pytest.mark.parametrize(
    "outputs",
    [
        "ppo",
        *(pytest.param(algo, marks=pytest.mark.slow) for algo in ("recurrent_ppo", "pid")),
    ],
    indirect=True,
)
def test_rows_do_not_depend_on_the_batch(outputs, folder):
    tables = []
    for batch in (500, 2, 1):
        protocol = ["protocol.episodes=3", f"protocol.batch={batch}", "protocol.trajectories=0"]
        assert auvbench("evaluate", "outputs", *protocol, "--force", "--workers", "1") == 0
        tables.append((only_run(folder) / "evaluations" / "test" / "episodes.csv").read_bytes())
    assert tables[0] == tables[1] == tables[2]


@pytest.mark.slow
def test_a_failed_run_keeps_its_error(folder, monkeypatch, capsys):
    from auvbench.envs.batch import Batch
    from auvbench.errors import TrainingError

    def fail(self, action):
        raise TrainingError("the water caught fire")

    monkeypatch.setattr(Batch, "step", fail)
    assert auvbench("train", "algo=ppo", *SMALL["ppo"], *SHORT) == 1
    assert "the water caught fire" in capsys.readouterr().err
    manifest = json.loads((only_run(folder) / "manifest.json").read_text())
    assert manifest["state"] == "failed"
    assert manifest["error"]["message"] == "the water caught fire"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["trian"], "unknown command 'trian'; did you mean 'train'?"),
        (["train", "algo=dqn"], "algo=dqn"),
        (["train", "reward.k=-1"], "reward.k=-1"),
        (["train", "seed=abc"], "'abc'"),
        (["train", "--experimental-rerun", "x"], "unknown option '--experimental-rerun' of train"),
        (["evaluate", "nowhere"], "nowhere: no such file or directory"),
        (["evaluate", "."], "is not a run directory"),
        (["evaluate", "outputs", "protocol=tests"], "protocol=tests: no such option; did you mean 'test'?"),
        (["evaluate", "outputs", "--frobnicate"], "unknown option '--frobnicate' of evaluate"),
        (["evaluate", "protocol=test"], "name a run directory"),
        (["report", "nowhere"], "nowhere"),
        (["runs", "nowhere"], "nowhere"),
    ],
)
def test_mistakes_end_with_one_line_and_exit_code_2(arguments, message, folder, capsys):
    assert auvbench(*arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert message in captured.err
    assert captured.err.startswith("auvbench: ")
    assert captured.err.count("\n") == 1
    assert not (folder / "outputs").exists(), "nothing may have started"
