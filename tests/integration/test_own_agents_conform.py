"""All agents of our own against the suites that we ask others to pass, and our simulators against their contract."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from auvbench import testing
from auvbench.config import folders
from auvbench.config.algorithms import learns
from auvbench.integrations.gazebo import bindings
from auvbench.registry import AGENTS, SIMULATORS
from auvbench.testing import SIMULATOR_CHECKS, agents, check_simulator
from auvbench.training import validation

ON_POLICY = ("algo.n_envs=2", "algo.n_steps=32", "algo.batch_size=32", "algo.net_arch=[8]")
OFF_POLICY = (
    "algo.n_envs=2",
    "algo.batch_size=16",
    "algo.gradient_steps=1",
    "algo.learning_starts=32",
    "algo.net_arch=[8]",
)
OVERRIDES: dict[str, tuple[str, ...]] = {
    "ppo": ON_POLICY,
    "sac": OFF_POLICY,
    "ddpg": OFF_POLICY,
    "td3": OFF_POLICY,
    "tqc": OFF_POLICY,
    "crossq": OFF_POLICY,
    "trpo": ON_POLICY,
    "recurrent_ppo": ON_POLICY,
    "ppo_residual": ON_POLICY,
    "sac_residual": OFF_POLICY,
    "pets": (
        "algo.n_envs=2",
        "algo.members=1",
        "algo.net_arch=[8]",
        "algo.gradient_steps=2",
        "algo.learning_starts=32",
        "algo.fit_every=64",
        "algo.samples=4",
        "algo.horizon=0.2",
    ),
    "pid": (),
    "alos": ("task=path_following",),
    "apf": ("task=transit",),
    "lqr": (),
    "smc": (),
    "adrc": (),
    "mpc": (),
    "mppi": ("algo.samples=32",),
    "random": (),
    "onnx": (),  # and a file, made below
}
"""Of each agent, what makes it small enough to be checked in seconds."""

EXTRAS = {"mpc": "casadi", "mppi": "casadi", "onnx": "onnxruntime"}
"""what an agent needs that may be missing"""

PLANNERS = ("mpc", "mppi")
"""controllers whose actions take milliseconds each: they fly 10 steps instead of 25"""

STEPS = 192

absent = bindings.missing()


def test_no_agent_and_no_simulator_is_left_out() -> None:
    # ArduSub moves the vehicle itself: tests/integration/test_ardusub_contest.py.
    assert OVERRIDES.keys() | {"ardusub"} == AGENTS.keys()
    assert set(folders.options("simulator")) == set(SIMULATORS.own) == {"fossen", "gazebo", "ros2"}


@pytest.mark.slow
@pytest.mark.parametrize("agent", [name for name in OVERRIDES if learns({"agent": name})])
def test_a_learner_keeps_its_contract(agent: str, monkeypatch: pytest.MonkeyPatch) -> None:
    torch.set_num_threads(1)
    whole = validation.evaluate_config

    def few(composed: Any) -> Any:
        """Return the protocol of tests during training with three episodes: PETS plans each step of each."""
        settings = whole(composed)
        return replace(settings, protocol=replace(settings.protocol, episodes=3))

    monkeypatch.setattr(validation, "evaluate_config", few)
    testing.check_agent(f"algo={agent}", *OVERRIDES[agent], steps=STEPS)


@pytest.mark.parametrize(
    "agent",
    [
        pytest.param(name, marks=pytest.mark.slow) if name == "mpc" else name
        for name in OVERRIDES
        if not learns({"agent": name})
    ],
)
def test_a_controller_keeps_its_contract(agent: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if (extra := EXTRAS.get(agent)) and importlib.util.find_spec(extra) is None:
        pytest.skip(f"{extra} is not installed")
    overrides = OVERRIDES[agent]
    if agent in PLANNERS:
        monkeypatch.setattr(agents, "STEPS", 10)
    if agent == "onnx":
        from tests import onnx_files

        # The file's policy has the original study's observation.
        path = onnx_files.saved(tmp_path / "policy.onnx", onnx_files.model())
        overrides = ("vehicle=bluerov2", "task=waypoint", f"algo.path={path}")
    testing.check_agent(f"algo={agent}", *overrides)


@pytest.mark.gazebo
@pytest.mark.skipif(absent is not None, reason=f"Gazebo is not here: {absent}")
@pytest.mark.parametrize("check", SIMULATOR_CHECKS, ids=lambda check: check.__name__)
def test_gazebo_keeps_its_contract(check: object) -> None:
    check_simulator("simulator=gazebo", only=check)  # type: ignore[arg-type]


@pytest.mark.parametrize("check", SIMULATOR_CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("vehicle", ["bluerov2", "lrauv"])
def test_the_embedded_simulator_keeps_its_contract(vehicle: str, check: object) -> None:
    check_simulator("simulator=fossen", f"vehicle={vehicle}", only=check)  # type: ignore[arg-type]
