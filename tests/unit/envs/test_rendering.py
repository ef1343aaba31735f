"""What an environment shows."""

from __future__ import annotations

import itertools
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from matplotlib.figure import Figure

import auvbench
from auvbench.envs import sb3
from auvbench.envs.vector_env import AuvVectorEnv
from auvbench.errors import ConfigError

assert auvbench.__version__
ID = "auvbench/Waypoint-v1"


@pytest.mark.slow
def test_pictures_show_where_the_vehicle_is():
    env = gymnasium.make(ID, render_mode="rgb_array", frequency=25)
    assert env.metadata["render_fps"] == 25
    env.reset(seed=1, options={"waypoint": [10, 0, -20], "pose": [0, 0, -20, 0]})
    first = env.render()
    assert first.shape == (352, 832, 3)
    assert first.dtype == np.uint8
    np.testing.assert_array_equal(first, env.render(), err_msg="the same state, the same picture")
    pictures = [first]
    for _ in range(30):
        env.step(np.array([0.7, 0.7, -0.7, -0.7, 0, 0], dtype=np.float32))
        pictures.append(env.render())
    # In its first step, from rest, the vehicle moves by millimetres: less than a pixel.
    assert all((a != b).any() for a, b in itertools.pairwise(pictures[1:]))
    blue = np.array([0x00, 0x72, 0xB2])
    path = [
        int((np.abs(p.astype(int) - blue).sum(-1) < 60).sum()) for p in (first, pictures[15], pictures[30])
    ]
    assert path[0] < path[1] < path[2], "the path grows"
    # What was inked bit by bit is what is drawn at once.
    scene = env.unwrapped._renderer._scenes[0]
    at_once = pickle.loads(pickle.dumps(scene))
    heading = "a"
    at_once._outgrown = lambda: False
    difference = np.abs(scene.frame(heading).astype(int) - at_once.frame(heading).astype(int))
    assert (difference > 80).mean() < 0.01


@pytest.mark.slow
def test_pictures_show_the_solids_of_a_world():
    """Also those of a copy, which draws anew."""
    brown = np.array([0x8A, 0x6D, 0x3B])

    def inked(env):
        return int((np.abs(env.render().astype(int) - brown).sum(-1) < 60).sum())

    counts = {}
    for world in ("open", "pillars"):
        env = gymnasium.make("auvbench/Docking-v1", render_mode="rgb_array", world=world)
        env.reset(seed=1)
        counts[world] = inked(env)
        assert inked(pickle.loads(pickle.dumps(env.unwrapped))) == counts[world]
    assert counts["open"] == 0
    assert counts["pillars"] > 50


@pytest.mark.slow
def test_a_picture_is_drawn_on_the_one_before(monkeypatch):
    drawn = []
    whole = Figure.draw
    monkeypatch.setattr(Figure, "draw", lambda *arguments: (drawn.append(1), whole(*arguments))[1])
    env = gymnasium.make(ID, render_mode="rgb_array")
    env.reset(seed=1)
    for _ in range(60):
        env.render()
        env.step(np.zeros(6, dtype=np.float32))
    assert 0 < len(drawn) < 6


def test_a_line_says_the_same():
    env = gymnasium.make(ID, render_mode="ansi")
    env.reset(seed=1, options={"waypoint": [10, 0, -20], "pose": [0, 0, -20, np.pi / 2]})
    assert env.render() == (
        "step 0 (0.0 s): at (0.00, 0.00, -20.00) m, yaw 90 deg; waypoint (10.00, 0.00, -20.00) m, 10.00 m away; "
        "under way"
    )
    env.step(np.zeros(6, dtype=np.float32))
    assert env.render().startswith("step 1 (0.1 s): at (")


def test_modes():
    silent = gymnasium.make(ID, render_mode=None)
    silent.reset(seed=0)
    assert silent.unwrapped.render() is None
    with pytest.raises(ConfigError, match="render_mode=rgb: unknown; did you mean 'rgb_array'"):
        AuvVectorEnv(2, render_mode="rgb")
    with pytest.raises(ResetNeeded):
        gymnasium.make(ID, render_mode="ansi").unwrapped.render()


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["NEXT_STEP", "SAME_STEP", "DISABLED"])
def test_a_batch_shows_each_environment(mode):
    envs = AuvVectorEnv(2, "task.max_steps=3", render_mode="ansi", autoreset_mode=mode)
    envs.reset(seed=1)
    lines = []
    for _ in range(3):
        envs.step(np.zeros((2, 6)))
        lines.append(envs.render())
    assert len(lines[0]) == 2
    if mode == "SAME_STEP":
        assert all(line.startswith("step 0 (") for line in lines[2])
    else:
        assert all(line.endswith("timeout") for line in lines[2])
    if mode == "NEXT_STEP":
        envs.step(np.zeros((2, 6)))
        assert all(line.startswith("step 0 (") for line in envs.render())
    pictures = AuvVectorEnv(2, render_mode="rgb_array")
    pictures.reset(seed=1)
    pictures.step(np.zeros((2, 6)))
    one, other = pictures.render()
    assert (one != other).any()


@pytest.mark.slow
def test_stable_baselines_tiles_the_pictures():
    env = sb3.make(2, render_mode="rgb_array", overrides="task.max_steps=3")
    env.reset()
    for _ in range(4):
        env.step(np.zeros((2, 6), dtype=np.float32))
    assert env.render("rgb_array").shape[2] == 3
