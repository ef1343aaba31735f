"""The registry of auvbench's own agents: one `AgentSpec` each. Importing it imports no agent."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from auvbench.config import algorithms

_SB3 = "auvbench.agents.learned.sb3:SB3Learner"
_RESIDUAL = "auvbench.agents.learned.residual:ResidualLearner"
_CLASSICAL = "auvbench.agents.classical"


@dataclass(frozen=True, slots=True)
class AgentSpec:
    """Everything that auvbench knows of one value of `algo.agent`."""

    name: str
    """Value of `algo.agent`."""
    title: str
    """Name in tables, figures and sentences."""
    schema: type[algorithms.Algorithm]
    """Keys of `algo` with their types and ranges."""
    factory: str
    """`module:callable` that makes the agent from a configuration and a vehicle."""
    algorithm: str = ""
    """`module:class` of the Stable-Baselines3 algorithm; empty for a controller."""
    exportable: bool = False
    """Whether a feed-forward network maps each observation to the action, so that ONNX can hold the policy."""

    @property
    def learns(self) -> bool:
        """Whether the agent has a training."""
        return issubclass(self.schema, algorithms.Network)


def _by_name(*specs: AgentSpec) -> dict[str, AgentSpec]:
    return {spec.name: spec for spec in specs}


AGENTS = _by_name(
    AgentSpec("ppo", "PPO", algorithms.PPO, _SB3, "stable_baselines3:PPO", True),
    AgentSpec("sac", "SAC", algorithms.SAC, _SB3, "stable_baselines3:SAC", True),
    AgentSpec("ddpg", "DDPG", algorithms.DDPG, _SB3, "stable_baselines3:DDPG", True),
    AgentSpec("td3", "TD3", algorithms.TD3, _SB3, "stable_baselines3:TD3", True),
    AgentSpec("tqc", "TQC", algorithms.TQC, _SB3, "sb3_contrib:TQC", True),
    AgentSpec("crossq", "CrossQ", algorithms.CrossQ, _SB3, "sb3_contrib:CrossQ", True),
    AgentSpec("trpo", "TRPO", algorithms.TRPO, _SB3, "sb3_contrib:TRPO", True),
    AgentSpec("recurrent_ppo", "RecurrentPPO", algorithms.RecurrentPPO, _SB3, "sb3_contrib:RecurrentPPO"),
    AgentSpec("ppo_residual", "PPO added to PID", algorithms.PPOResidual, _RESIDUAL, "stable_baselines3:PPO"),
    AgentSpec("sac_residual", "SAC added to PID", algorithms.SACResidual, _RESIDUAL, "stable_baselines3:SAC"),
    AgentSpec("pid", "PID", algorithms.PID, f"{_CLASSICAL}.pid:controller"),
    AgentSpec("alos", "ALOS", algorithms.ALOS, f"{_CLASSICAL}.alos:controller"),
    AgentSpec("lqr", "LQR", algorithms.LQR, f"{_CLASSICAL}.lqr:LQRController"),
    AgentSpec("smc", "SMC", algorithms.SMC, f"{_CLASSICAL}.smc:SMCController"),
    AgentSpec("mpc", "MPC", algorithms.MPC, f"{_CLASSICAL}.mpc:MPCController"),
    AgentSpec("random", "random", algorithms.Random, f"{_CLASSICAL}.random:RandomAgent"),
    AgentSpec("onnx", "ONNX policy", algorithms.ONNX, "auvbench.agents.policy_file:PolicyFile"),
    AgentSpec("ardusub", "ArduSub", algorithms.ArduSub, "auvbench.agents.ardusub:ArduSubAgent"),
)


def learns(algo: Any, *, unknown: bool = False) -> bool:
    """Return whether the agent of an `algo` configuration learns.

    Args:
        algo: typed or plain.
        unknown: the answer for an agent that neither the registry nor the configuration describes.

    >>> learns({"agent": "ppo"}), learns({"agent": "pid"})
    (True, False)
    """
    agent = algo.get("agent") if isinstance(algo, Mapping) else getattr(algo, "agent", None)
    spec = AGENTS.get(str(agent))
    if spec is not None:
        return spec.learns
    # A plug-in agent's configuration holds the answer, so the package need not be installed.
    declared = algo.get("learns") if isinstance(algo, Mapping) else getattr(algo, "learns", None)
    return declared if isinstance(declared, bool) else unknown
