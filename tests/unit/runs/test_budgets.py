"""A training that is too short for its task is noticed, once."""

from auvbench.config.compose import compose
from auvbench.runs.budgets import remarks


def composed(*overrides):
    return compose("train", list(overrides), folder=None)


def test_a_short_training_is_noticed_once():
    short = [composed("task=docking", "algo=ppo", f"train.total_steps={n}") for n in (60_000, 200_000)]
    (remark,) = remarks(short)
    assert "task=docking" in remark
    assert "type train.total_steps=500000 or more instead of 200,000" in remark


def test_what_docks_with_fewer_steps_is_not_noticed():
    for algo in ("pid", "ppo_residual"):
        assert remarks([composed("task=docking", f"algo={algo}", "train.total_steps=60000")]) == []
    assert remarks([composed("task=docking", "algo=ppo", "train.total_steps=500000")]) == []
    assert remarks([composed("task=waypoint_state", "algo=ppo", "train.total_steps=1000")]) == []
