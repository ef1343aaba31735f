"""Define the schemas of the `algo` group and the specs of auvbench's own agents.

Each agent has one `AgentSpec`. Importing this module imports no agent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from auvbench.config.schema import choice, choice_of, later, name, number
from auvbench.config.schema import name as plain_name
from auvbench.registry import AGENTS, Declared, Spec, schema_fault


@dataclass(kw_only=True)
class Tuned:
    """How the values of a preset were chosen; `auvbench tune` writes it, and reports read it."""

    study: str = name()
    protocol: str = name()
    scenarios: str = choice("validation")
    seed: int = number(0, (1 << 32) - 1)  # seed of the protocol's scenarios
    trials: int = number(1, 1 << 31)
    steps: int = number(0, 1 << 62)  # environment steps of training over all trials
    version: str
    date: str


@dataclass(kw_only=True)
class Algorithm:
    """Keys of every `algo/*.yaml`: the agent's name and its number of environments."""

    name: str = name()
    agent: str = choice_of(lambda: AGENTS.own)
    n_envs: int = number(1, 65_536)
    tuned: Tuned | None = None  # search that chose the values


@dataclass(kw_only=True)
class Network:
    """Keys that all learners share."""

    net_arch: list[int]
    activation: str = choice("tanh", "relu", "elu", "silu")
    learning_rate: float = number(0.0, 1.0, open_low=True)
    learning_rate_schedule: str = choice("constant", "linear")
    batch_size: int = number(1, 1 << 24)
    gamma: float = number(0.0, 1.0)
    horizon_s: float | None = later(number(0.0, 1e7, open_low=True))  # s


@dataclass(kw_only=True)
class OnPolicy(Network, Algorithm):
    n_steps: int = number(1, 1 << 24)
    gae_lambda: float = number(0.0, 1.0)
    normalize_advantage: bool
    log_std_init: float = number(-20.0, 5.0)


@dataclass(kw_only=True)
class PPO(OnPolicy):
    n_epochs: int = number(1, 1000)
    clip_range: float = number(0.0, 10.0, open_low=True)
    ent_coef: float = number(0.0, 10.0)
    vf_coef: float = number(0.0, 10.0)
    max_grad_norm: float = number(0.0, 1e6, open_low=True)


@dataclass(kw_only=True)
class RecurrentPPO(PPO):
    lstm_size: int = number(1, 1 << 14)
    lstm_layers: int = number(1, 16)
    critic_lstm: bool


@dataclass(kw_only=True)
class TRPO(OnPolicy):
    target_kl: float = number(0.0, 10.0, open_low=True)
    cg_max_steps: int = number(1, 10_000)
    cg_damping: float = number(0.0, 100.0)
    line_search_shrinking_factor: float = number(0.0, 1.0, open_low=True)
    line_search_max_iter: int = number(1, 1000)
    n_critic_updates: int = number(1, 1000)
    sub_sampling_factor: int = number(1, 1 << 20)


@dataclass(kw_only=True)
class OffPolicy(Network, Algorithm):
    buffer_size: int = number(1, 1 << 31)
    learning_starts: int = number(0, 1 << 40)
    train_freq: int = number(1, 1 << 24)
    gradient_steps: int = number(-1, 1 << 24)
    n_steps: int = later(number(1, 1000), 1)
    updates: str = later(choice("compiled", "sb3"), "sb3")


@dataclass(kw_only=True)
class Targets(OffPolicy):
    """Keys of algorithms with target networks."""

    tau: float = number(0.0, 1.0, open_low=True)


@dataclass(kw_only=True)
class Entropy:
    """Keys of algorithms with an entropy reward."""

    ent_coef: str
    target_entropy: str


@dataclass(kw_only=True)
class SAC(Entropy, Targets):
    target_update_interval: int = number(1, 1 << 24)


@dataclass(kw_only=True)
class TQC(SAC):
    n_quantiles: int = number(1, 10_000)
    n_critics: int = number(1, 100)
    top_quantiles_to_drop_per_net: int = number(0, 10_000)


@dataclass(kw_only=True)
class CrossQ(Entropy, OffPolicy):
    policy_delay: int = number(1, 1000)
    critic_net_arch: list[int]
    n_critics: int = number(1, 100)
    batch_norm_momentum: float = number(0.0, 1.0, open_low=True)
    renorm_warmup_steps: int = number(0, 1 << 40)


@dataclass(kw_only=True)
class DDPG(Targets):
    action_noise: float = number(0.0, 10.0)


@dataclass(kw_only=True)
class TD3(Targets):
    action_noise: float = number(0.0, 10.0)
    policy_delay: int = number(1, 1000)
    target_policy_noise: float = number(0.0, 10.0)
    target_noise_clip: float = number(0.0, 10.0)


@dataclass(kw_only=True)
class Cascade(Algorithm):
    """Keys of the controllers that steer by velocity."""

    cruise_speed: float = number(0.0, 100.0, open_low=True)  # m/s
    approach: float = number(0.0, 100.0, open_low=True)  # 1/s
    filter_time: float = number(0.0, 1e3, open_low=True)  # s
    effort: float = number(0.0, 1.0, open_low=True)


@dataclass(kw_only=True)
class PID(Cascade):
    bandwidth: float = number(0.0, 100.0, open_low=True)  # rad/s
    heading_bandwidth: float = number(0.0, 100.0, open_low=True)  # rad/s
    integral_time: float = number(0.0, 1e6, open_low=True)  # s
    heading_integral_time: float | None = later(number(0.0, 1e6, open_low=True))  # s


@dataclass(kw_only=True)
class ALOS(PID):
    look_ahead: float = number(0.0, 1e4, open_low=True)  # m
    look_ahead_vertical: float = number(0.0, 1e4, open_low=True)  # m
    adaptation: float = number(0.0, 10.0)  # rad/(m s)
    adaptation_vertical: float = number(0.0, 10.0)  # rad/(m s)
    largest_angle: float = number(0.0, 1.5, open_low=True)  # rad


@dataclass(kw_only=True)
class LQR(Cascade):
    velocity_error: float = number(0.0, 100.0, open_low=True)  # m/s
    yaw_error: float = number(0.0, 100.0, open_low=True)  # rad
    yaw_rate: float = number(0.0, 100.0, open_low=True)  # rad/s
    integral_error: float = number(0.0, 1e6, open_low=True)  # m
    effort_share: float = number(0.0, 1e3, open_low=True)


@dataclass(kw_only=True)
class SMC(Cascade):
    surface: float = number(0.0, 100.0)  # 1/s
    boundary_layer: float = number(0.0, 100.0, open_low=True)  # m/s, rad/s
    switching_gain: float = number(0.0, 1e3)  # m/s2, rad/s2
    largest_gain: float = number(0.0, 1e3, open_low=True)  # m/s2, rad/s2
    adaptation: float = number(0.0, 1e3)  # 1/s2
    heading_bandwidth: float = number(0.0, 100.0, open_low=True)  # rad/s


@dataclass(kw_only=True)
class MPC(Algorithm):
    horizon: float = number(0.0, 1e3, open_low=True)  # s
    effort: float = number(0.0, 1.0, open_low=True)
    terminal_weight: float = number(0.0, 1e6)
    effort_weight: float = number(0.0, 1e6)
    change_weight: float = number(0.0, 1e6)
    spin_weight: float = number(0.0, 1e6)
    damping: float = number(0.0, 1e6)


BASES = ("pid", "lqr", "smc", "mpc", "alos")
"""Controllers whose action a residual learner may correct"""


@dataclass(kw_only=True)
class Residual:
    """A learner's action added to one controller's; the other controllers are null."""

    share: float = number(0.0, 2.0, open_low=True)
    pid: PID | None = None
    lqr: LQR | None = None
    smc: SMC | None = None
    mpc: MPC | None = None
    alos: ALOS | None = None

    @property
    def base(self) -> Algorithm:
        """Return the controller's values."""
        (values,) = self.bases.values()
        return values

    @property
    def bases(self) -> dict[str, Algorithm]:
        """Return the values of the controllers that are not null, by name."""
        values = {name: getattr(self, name) for name in BASES}
        return {name: value for name, value in values.items() if value is not None}


@dataclass(kw_only=True)
class PPOResidual(PPO):
    residual: Residual


@dataclass(kw_only=True)
class SACResidual(SAC):
    residual: Residual


@dataclass(kw_only=True)
class Random(Algorithm):
    pass


@dataclass(kw_only=True)
class ONNX(Algorithm):
    path: str
    sha256: str


@dataclass(kw_only=True)
class ArduSub(Algorithm):
    sha256: str
    mode: str = choice("guided", "poshold", "alt_hold")
    stick: float = number(0.0, 1e3, open_low=True)  # 1/m, 1/rad
    parameters: dict[str, float]


_SB3 = "auvbench.agents.learned.sb3:SB3Learner"
_RESIDUAL = "auvbench.agents.learned.residual:ResidualLearner"
_CLASSICAL = "auvbench.agents.classical"
_SHEET = ("sheet",)


@dataclass(kw_only=True)
class AgentConfig:
    """The `algo` configuration of a package's agent; a subclass adds its own keys."""

    name: str = plain_name()
    agent: str = plain_name()
    n_envs: int = number(1, 65_536)
    package: str
    learns: bool
    tuned: Tuned | None = None  # search that chose the values


@dataclass(frozen=True, slots=True)
class AgentSpec(Spec):
    """Description of one value of `algo.agent`."""

    base: ClassVar[type] = AgentConfig

    name: str
    """Value of `algo.agent`."""
    title: str
    """Name in tables, figures and sentences."""
    schema: type
    """Keys of `algo` with their types and ranges."""
    factory: str
    """`module:callable` that creates the agent from a configuration and a vehicle."""
    algorithm: str = ""
    """`module:class` of the Stable-Baselines3 algorithm; empty for a controller."""
    exportable: bool = False
    """Whether a feed-forward network maps each observation to the action, so that ONNX can hold the policy."""
    knows: tuple[str, ...] = ()
    """What the agent knows in addition to the observation: `sheet` (the vehicle's data) or `model` (a
    simulation of it).
    """
    observes: bool = True
    """Whether the agent reads the observation."""
    trained: bool = False
    """Whether the agent of an installed package has a training."""

    @property
    def code(self) -> str:
        """Return `module:callable` of the agent."""
        return self.factory

    @property
    def learns(self) -> bool:
        """Whether the agent has a training."""
        return self.trained or issubclass(self.schema, Network)

    @classmethod
    def adopt(cls, found: Declared, thing: Any) -> AgentSpec:
        """Return the spec of a package's agent, whose entry point names the factory itself.

        Raises:
            ConfigError: the entry point is not callable, its `Config` is not a schema, or a learner lacks a
                required attribute.
        """
        schema = getattr(thing, "Config", AgentConfig)
        if fault := schema_fault(schema, AgentConfig, "Config"):
            raise found.error(fault)
        if not callable(thing):
            raise found.error(
                f"is a {type(thing).__name__}; it must be a class or a function that makes an agent"
            )
        trained = callable(getattr(thing, "learn", None))
        if trained:
            exact = getattr(thing, "exact_resume", None)
            needed = ("save", "load", "state", "restore") if exact else ("save", "load")
            lacking = [name for name in needed if not callable(getattr(thing, name, None))]
            lacking += [] if isinstance(exact, bool) else ["exact_resume, True or False"]
            if lacking:
                raise found.error(f"learns but lacks {', '.join(lacking)} (auvbench.agents.base.Learner)")
        return cls(found.name, found.name, schema, found.value, exportable=True, trained=trained)


ppo = AgentSpec("ppo", "PPO", PPO, _SB3, "stable_baselines3:PPO", True)
sac = AgentSpec("sac", "SAC", SAC, _SB3, "stable_baselines3:SAC", True)
ddpg = AgentSpec("ddpg", "DDPG", DDPG, _SB3, "stable_baselines3:DDPG", True)
td3 = AgentSpec("td3", "TD3", TD3, _SB3, "stable_baselines3:TD3", True)
tqc = AgentSpec("tqc", "TQC", TQC, _SB3, "sb3_contrib:TQC", True)
crossq = AgentSpec("crossq", "CrossQ", CrossQ, _SB3, "sb3_contrib:CrossQ", True)
trpo = AgentSpec("trpo", "TRPO", TRPO, _SB3, "sb3_contrib:TRPO", True)
recurrent_ppo = AgentSpec("recurrent_ppo", "RecurrentPPO", RecurrentPPO, _SB3, "sb3_contrib:RecurrentPPO")
ppo_residual = AgentSpec(
    "ppo_residual", "PPO added to PID", PPOResidual, _RESIDUAL, "stable_baselines3:PPO", knows=_SHEET
)
sac_residual = AgentSpec(
    "sac_residual", "SAC added to PID", SACResidual, _RESIDUAL, "stable_baselines3:SAC", knows=_SHEET
)
pid = AgentSpec("pid", "PID", PID, f"{_CLASSICAL}.pid:controller", knows=_SHEET)
alos = AgentSpec("alos", "ALOS", ALOS, f"{_CLASSICAL}.alos:controller", knows=_SHEET)
lqr = AgentSpec("lqr", "LQR", LQR, f"{_CLASSICAL}.lqr:LQRController", knows=_SHEET)
smc = AgentSpec("smc", "SMC", SMC, f"{_CLASSICAL}.smc:SMCController", knows=_SHEET)
mpc = AgentSpec("mpc", "MPC", MPC, f"{_CLASSICAL}.mpc:MPCController", knows=("model",))
random = AgentSpec("random", "random", Random, f"{_CLASSICAL}.random:RandomAgent", observes=False)
onnx = AgentSpec("onnx", "ONNX policy", ONNX, "auvbench.agents.policy_file:PolicyFile")
ardusub = AgentSpec("ardusub", "ArduSub", ArduSub, "auvbench.agents.ardusub:ArduSubAgent", observes=False)


def learns(algo: Any, *, unknown: bool = False) -> bool:
    """Return whether the agent of an `algo` configuration learns.

    Args:
        algo: typed or plain configuration.
        unknown: result for an agent that neither the registry nor the configuration describes.

    >>> learns({"agent": "ppo"}), learns({"agent": "pid"})
    (True, False)
    """
    agent = algo.get("agent") if isinstance(algo, Mapping) else getattr(algo, "agent", None)
    if agent in AGENTS.own:
        return AGENTS[str(agent)].learns
    # A plug-in agent's configuration has the answer, so the package need not be installed.
    declared = algo.get("learns") if isinstance(algo, Mapping) else getattr(algo, "learns", None)
    return declared if isinstance(declared, bool) else unknown
