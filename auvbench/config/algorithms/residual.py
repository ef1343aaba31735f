"""Define the learners whose action is added to the action of a controller: their schemas and specs."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.config.algorithms import AgentSpec, Algorithm
from auvbench.config.algorithms.alos import ALOS
from auvbench.config.algorithms.lqr import LQR
from auvbench.config.algorithms.mpc import MPC
from auvbench.config.algorithms.mppi import MPPI
from auvbench.config.algorithms.pid import PID
from auvbench.config.algorithms.sb3 import PPO, SAC
from auvbench.config.algorithms.smc import SMC
from auvbench.config.fields import require
from auvbench.config.schema import number

BASES = ("pid", "lqr", "smc", "mpc", "mppi", "alos")
"""Controllers whose action a residual learner may correct"""


@dataclass(kw_only=True)
class Residual:
    """Keys of the controller to whose action the learner adds its own action; the keys of all other controllers are null."""

    share: float = number(0.0, 2.0, open_low=True)
    pid: PID | None = None
    lqr: LQR | None = None
    smc: SMC | None = None
    mpc: MPC | None = None
    mppi: MPPI | None = None
    alos: ALOS | None = None

    def check(self) -> None:
        """Check that exactly one controller is set.

        Raises:
            ConfigError: no controller or several controllers are set, or the controller's key `agent` has another value
                than the controller's name.
        """
        names = list(self.bases)
        require(len(names) == 1, "algo.residual", " and ".join(names) or "{}", "have exactly one controller")
        agent, name = self.base.agent, names[0]
        require(agent == name, f"algo.residual.{name}.agent", agent, f"be {name}")

    @property
    def base(self) -> Algorithm:
        """Return the keys of the controller that is set."""
        (values,) = self.bases.values()
        return values

    @property
    def bases(self) -> dict[str, Algorithm]:
        """Return the controllers that are not null: the controller's keys by the controller's name."""
        values = {name: getattr(self, name) for name in BASES}
        return {name: value for name, value in values.items() if value is not None}


@dataclass(kw_only=True)
class PPOResidual(PPO):
    residual: Residual

    def check(self) -> None:
        super().check()
        self.residual.check()


@dataclass(kw_only=True)
class SACResidual(SAC):
    residual: Residual

    def check(self) -> None:
        super().check()
        self.residual.check()


def _spec(name: str, title: str, schema: type, algorithm: str) -> AgentSpec:
    code = "auvbench.agents.learned.residual:ResidualLearner"
    return AgentSpec(name, title, schema, code, algorithm, knows=("sheet",), learns=True)


ppo_residual = _spec("ppo_residual", "PPO added to PID", PPOResidual, "stable_baselines3:PPO")
sac_residual = _spec("sac_residual", "SAC added to PID", SACResidual, "stable_baselines3:SAC")
