"""Runs on Gazebo: trained, stopped, resumed, tested."""

import json

import numpy as np
import pytest
import torch

from auvbench.agents.learned.sb3 import Follower
from auvbench.cli import main
from auvbench.integrations.gazebo import bindings
from auvbench.runs.directory import RunDirectory

absent = bindings.missing()
pytestmark = [
    pytest.mark.gazebo,
    pytest.mark.slow,
    pytest.mark.skipif(absent is not None, reason=f"Gazebo is not here: {absent}"),
]

GAZEBO = [
    "simulator=gazebo",
    "algo.n_envs=4",
    "algo.n_steps=32",
    "algo.batch_size=128",
    "train.total_steps=512",
]


@pytest.fixture(autouse=True)
def one_thread():
    torch.set_num_threads(1)


def trained(tmp_path, name, *overrides):
    arguments = [
        f"output={tmp_path}",
        f"name={name}",
        "algo=ppo",
        "train.progress=false",
        *GAZEBO,
        *overrides,
    ]
    assert main(["train", *arguments]) == 0
    (run,) = (tmp_path / name).glob("ppo-*")
    return RunDirectory(run)


def test_the_same_run_twice_is_the_same_bits(tmp_path):
    one, two = trained(tmp_path, "one"), trained(tmp_path, "two")
    assert one.id == two.id
    weights = [(run.model / "policy.pt") for run in (one, two)]
    first, second = (torch.load(path, weights_only=True) for path in weights)
    assert str(first.keys()) == str(second.keys())
    assert one.train.joinpath("episodes.csv").read_bytes() == two.train.joinpath("episodes.csv").read_bytes()


def test_a_stopped_run_goes_on_and_says_how(tmp_path, monkeypatch):
    ordinary = Follower._on_step
    struck = []

    def on_step(self):
        if not struck and self.num_timesteps >= 300:
            struck.append(self.num_timesteps)
            raise RuntimeError("struck")
        return ordinary(self)

    monkeypatch.setattr(Follower, "_on_step", on_step)
    arguments = [
        f"output={tmp_path}",
        "algo=ppo",
        "train.progress=false",
        "train.checkpoint.steps=128",
        *GAZEBO,
    ]
    assert main(["train", *arguments]) == 1
    assert main(["train", *arguments]) == 0
    (run,) = tmp_path.glob("*/ppo-*")
    manifest = json.loads((run / "manifest.json").read_text())
    assert manifest["state"] == "complete"
    assert manifest["episodes_begun_again"] == [256]
    assert manifest["versions"]["gz-sim8"].startswith("8.")


def test_a_policy_meets_the_same_scenarios_in_both_simulators(tmp_path):
    assert main(["train", f"output={tmp_path}", "algo=pid"]) == 0
    (run,) = tmp_path.glob("*/pid-*")
    assert main(["evaluate", str(run), "protocol=gazebo", "protocol.episodes=4", "--workers", "1"]) == 0
    rows = np.genfromtxt(
        run / "evaluations" / "gazebo" / "episodes.csv",
        delimiter=",",
        names=True,
        dtype=None,
        encoding="utf-8",
    )
    by = {c: rows[rows["condition"] == c] for c in np.unique(rows["condition"])}
    assert set(by) == {"nominal", "simulator=gazebo", "simulator=gazebo-published"}
    for there in by.values():
        for column in ("episode", "waypoint_x_m", "start_yaw_rad"):
            assert np.array_equal(there[column], by["nominal"][column])
        assert np.all(there["outcome"] == "success")
    assert np.abs(by["simulator=gazebo"]["steps"] - by["nominal"]["steps"]).max() <= 3
