"""The generator keeps what the report relies on, or the report's tests would prove nothing."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from auvbench.record import record_columns
from tests.synthetic import write_experiment


def _files(root: Path) -> dict[str, bytes]:
    return {
        str(p.relative_to(root)): p.read_bytes()
        for p in sorted(root.rglob("*"))
        if p.suffix in (".csv", ".yaml", ".json")
    }


def test_same_arguments_write_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_experiment(tmp_path / name / "grid", algorithms=("ppo", "pid"), episodes=8, train_episodes=20)
    assert _files(tmp_path / "a") == _files(tmp_path / "b")


def test_every_agent_meets_the_same_scenarios_and_columns_agree(tmp_path: Path) -> None:
    runs = write_experiment(tmp_path / "grid", algorithms=("ppo", "sac", "pid"), seeds=(0, 1), episodes=30)
    assert len(runs) == 5  # pid has nothing to learn, hence one run
    frames = [pd.read_csv(run / "evaluations" / "test" / "episodes.csv") for run in runs]
    for frame in frames:
        assert list(frame.columns) == ["condition", "frequency_hz", *record_columns("waypoint")]
        assert np.array_equal(frame["waypoint_x_m"], frames[0]["waypoint_x_m"])
        assert (frame.loc[frame["outcome"] == "success", "final_distance_m"] <= 3.0).all()
        assert frame["command_norm_sum_N"].to_numpy() == pytest.approx(
            (frame["command_norm_mean_N"] * frame["steps"]).to_numpy()
        )
    assert not np.array_equal(frames[0]["steps"], frames[1]["steps"])


def test_trajectories_are_as_long_as_their_episodes(tmp_path: Path) -> None:
    (run,) = write_experiment(tmp_path / "grid", algorithms=("pid",), episodes=5, trajectories=2)
    steps = pd.read_csv(run / "evaluations" / "test" / "episodes.csv")["steps"]
    with np.load(run / "evaluations" / "test" / "trajectories.npz", allow_pickle=False) as arrays:
        for episode in (0, 1):
            assert arrays[f"position_nominal_{episode}"].shape == (steps[episode] + 1, 3)
            assert arrays[f"command_nominal_{episode}"].shape == (steps[episode], 6)
        assert "position_nominal_2" not in arrays
