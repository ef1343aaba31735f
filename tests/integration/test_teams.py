"""A team from training to replay: one row for each episode of a team."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from auvbench.cli import main
from auvbench.config.compose import compose
from auvbench.config.validate import evaluate_config
from auvbench.evaluation import rollout
from auvbench.evaluation.replay import replay
from auvbench.runs.directory import RunDirectory
from tests import configs

WORDS = ["task=formation", "vehicle=bluerov2_heavy", "task.time_limit=3"]
TINY = [
    *("algo=ppo", "algo.n_envs=4", "algo.n_steps=16", "algo.batch_size=32", "algo.n_epochs=1"),
    "train.total_steps=1500",
]

SAC = [
    "algo=sac",
    "algo.n_envs=4",
    "algo.batch_size=32",
    "algo.learning_starts=100",
    "train.total_steps=1500",
]


def only(folder: Path) -> Path:
    (path,) = (manifest.parent for manifest in (folder / "default").glob("*/manifest.json"))
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    "algo",
    [["algo=pid"], ["algo=mpc", "algo.horizon=1"], TINY, SAC],
    ids=["pid", "mpc", "ppo", "sac"],
)
def test_a_team_is_one_row_in_training_tests_and_replays(algo: list[str], tmp_path: Path) -> None:
    assert main(["train", f"output={tmp_path}", *WORDS, *algo]) == 0
    path = only(tmp_path)
    words = ["protocol=own", "protocol.episodes=5", "protocol.trajectories=2", "protocol.batch=3"]
    assert main(["evaluate", str(path), *words]) == 0
    rows = pd.read_csv(path / "evaluations" / "own" / "episodes.csv")
    assert rows["episode"].tolist() == [0, 1, 2, 3, 4]
    assert (rows["environment"] == 0).all()
    assert (rows["separation_min_m"] > 0.0).all()
    if algo in (TINY, SAC):
        trained = pd.read_csv(path / "train" / "episodes.csv")
        # 1,536 steps of 12 vehicles are 128 steps of each team.
        assert set(trained["environment"]) <= {0, 1, 2, 3}
        assert not trained.duplicated(["environment", "episode"]).any()
        assert trained["steps"].max() <= 30
    with np.load(path / "evaluations" / "own" / "trajectories.npz") as archive:
        others, position = archive["others_nominal_1"], archive["position_nominal_1"]
    assert others.shape == (len(position), 2, 3)
    protocol = evaluate_config(compose("evaluate", words)).protocol
    shown = replay(RunDirectory(path), protocol, "nominal", 1)
    np.testing.assert_array_equal(shown.others, others)
    assert shown.record["formation_error_rms_m"] == rows["formation_error_rms_m"][1]
    assert main(["report", str(tmp_path / "default"), "--protocol", "own"]) == 0
    page = (tmp_path / "default" / "report" / "index.html").read_text(encoding="utf-8")
    data = json.loads(re.findall(r'<script type="application/json" id="data">(.*)</script>', page)[0])
    (track,) = data["episodes"][1]["tracks"]
    paths = [np.frombuffer(base64.b64decode(text), "<i2").reshape(-1, 3) for text in track["others"]]
    np.testing.assert_allclose(np.stack(paths, 1) * track["unit"], others, atol=0.0051)


def test_rows_do_not_depend_on_the_size_of_a_batch() -> None:
    """The random agent's actions depend on its episode numbers, of which each vehicle has its own."""
    from auvbench.agents.base import make
    from auvbench.vehicles import sheet

    config = configs.training(*WORDS, "algo=random", "task.time_limit=1")
    agent = make(config, sheet.load(config.vehicle))
    rows = [
        rollout.roll_out(config, agent, episodes=np.arange(3), seed=4, batch=size).records for size in (3, 1)
    ]
    assert rows[0] == rows[1]
    assert rollout.rows_of(np.array([2, 5]), 3).tolist() == [6, 7, 8, 15, 16, 17]
    assert rollout.rows_of(np.array([2, 5]), 1).tolist() == [2, 5]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["task=waypoint", "task.vehicles=3"], "task.vehicles"),
        ([*WORDS, "task.vehicles=9"], "task.vehicles=9: must be at least 1 and at most 8"),
        ([*WORDS, "task.vehicles=3", "task.slots=[[0,0,0],[0,1,0]]"], "task.vehicles=3: must be at most 2"),
        ([*WORDS, "simulator=ros2"], "task.vehicles=3: simulator=ros2 allows one vehicle in an episode"),
        ([*WORDS, "algo=alos"], "task=formation does not have"),
        ([*WORDS, "algo=apf"], "apf"),
    ],
)
def test_what_a_team_cannot_do_is_one_line(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["train", "algo=pid", f"output={tmp_path}", *words]) == 2
    error = capsys.readouterr().err.strip()
    assert message in error
    assert len(error.splitlines()) == 1
