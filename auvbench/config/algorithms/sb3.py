"""Define the learners of Stable-Baselines3: their schemas and specs."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.config.algorithms import AgentSpec, Algorithm
from auvbench.config.fields import require
from auvbench.config.schema import choice, later, number


@dataclass(kw_only=True)
class Network(Algorithm):
    """Keys that all learners of Stable-Baselines3 share."""

    net_arch: list[int]
    activation: str = choice("tanh", "relu", "elu", "silu")
    learning_rate: float = number(0.0, 1.0, open_low=True)
    learning_rate_schedule: str = choice("constant", "linear")
    batch_size: int = number(1, 1 << 24)
    gamma: float = number(0.0, 1.0)
    horizon_s: float | None = later(number(0.0, 1e7, open_low=True))  # s

    def check(self) -> None:
        for key in ("net_arch", "critic_net_arch"):
            widths = getattr(self, key, ())
            require(all(width > 0 for width in widths), f"algo.{key}", widths, "have widths of at least 1")


@dataclass(kw_only=True)
class OnPolicy(Network):
    n_steps: int = number(1, 1 << 24)
    gae_lambda: float = number(0.0, 1.0)
    normalize_advantage: bool
    log_std_init: float = number(-20.0, 5.0)

    @property
    def rollout(self) -> int:
        """Return the number of environment steps between two updates of the policy."""
        return self.n_steps * self.n_envs

    def check(self) -> None:
        samples = f"algo.n_steps x algo.n_envs = {self.rollout}"
        require(self.rollout % self.batch_size == 0, "algo.batch_size", self.batch_size, f"divide {samples}")
        require(self.rollout >= 2, "algo.n_steps", self.n_steps, "be at least 2 with one environment")
        super().check()


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

    def check(self) -> None:
        super().check()
        factor, shrinking = self.sub_sampling_factor, self.line_search_shrinking_factor
        left = f"leave at least 2 of the algo.n_steps x algo.n_envs = {self.rollout} samples"
        require(self.rollout >= 2 * factor, "algo.sub_sampling_factor", factor, left)
        require(shrinking < 1.0, "algo.line_search_shrinking_factor", shrinking, "be less than 1")


@dataclass(kw_only=True)
class OffPolicy(Network):
    buffer_size: int = number(1, 1 << 31)
    learning_starts: int = number(0, 1 << 40)
    train_freq: int = number(1, 1 << 24)
    gradient_steps: int = number(-1, 1 << 24)
    n_steps: int = later(number(1, 1000), 1)
    updates: str = later(choice("compiled", "sb3"), "sb3")

    def check(self) -> None:
        super().check()
        steps, size, n = self.gradient_steps, self.buffer_size, self.n_envs
        every = "be at least 1, or -1 for one gradient step per environment step"
        require(steps != 0, "algo.gradient_steps", steps, every)
        require(size >= n, "algo.buffer_size", size, f"be at least algo.n_envs={n}")
        fits = self.updates == "sb3" or self.activation == "relu"
        what = f"be relu with algo.updates={self.updates}; algo.updates=sb3 takes every activation"
        require(fits, "algo.activation", self.activation, what)


@dataclass(kw_only=True)
class Targets(OffPolicy):
    """Keys of algorithms with target networks."""

    tau: float = number(0.0, 1.0, open_low=True)


@dataclass(kw_only=True)
class Entropy(OffPolicy):
    """Keys of algorithms with an entropy reward."""

    ent_coef: str
    target_entropy: str

    def check(self) -> None:
        super().check()
        for key in ("ent_coef", "target_entropy"):
            value = getattr(self, key)
            fits = value == "auto" or _is_number(value.removeprefix("auto").removeprefix("_"))
            require(fits, f"algo.{key}", value, "be auto, auto_<initial value> or a number")


@dataclass(kw_only=True)
class SAC(Entropy, Targets):
    target_update_interval: int = number(1, 1 << 24)


@dataclass(kw_only=True)
class TQC(SAC):
    n_quantiles: int = number(1, 10_000)
    n_critics: int = number(1, 100)
    top_quantiles_to_drop_per_net: int = number(0, 10_000)

    def check(self) -> None:
        super().check()
        dropped, quantiles = self.top_quantiles_to_drop_per_net, f"algo.n_quantiles={self.n_quantiles}"
        key = "algo.top_quantiles_to_drop_per_net"
        require(dropped < self.n_quantiles, key, dropped, f"be less than {quantiles}")


@dataclass(kw_only=True)
class CrossQ(Entropy):
    policy_delay: int = number(1, 1000)
    critic_net_arch: list[int]
    n_critics: int = number(1, 100)
    batch_norm_momentum: float = number(0.0, 1.0, open_low=True)
    renorm_warmup_steps: int = number(0, 1 << 40)

    def check(self) -> None:
        super().check()
        what = "be at least 2 for batch normalisation"
        require(self.batch_size >= 2, "algo.batch_size", self.batch_size, what)


@dataclass(kw_only=True)
class DDPG(Targets):
    action_noise: float = number(0.0, 10.0)


@dataclass(kw_only=True)
class TD3(Targets):
    action_noise: float = number(0.0, 10.0)
    policy_delay: int = number(1, 1000)
    target_policy_noise: float = number(0.0, 10.0)
    target_noise_clip: float = number(0.0, 10.0)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _spec(name: str, title: str, schema: type, algorithm: str, *, exportable: bool = True) -> AgentSpec:
    code = "auvbench.agents.learned.sb3:SB3Learner"
    return AgentSpec(name, title, schema, code, algorithm, exportable, learns=True)


ppo = _spec("ppo", "PPO", PPO, "stable_baselines3:PPO")
sac = _spec("sac", "SAC", SAC, "stable_baselines3:SAC")
ddpg = _spec("ddpg", "DDPG", DDPG, "stable_baselines3:DDPG")
td3 = _spec("td3", "TD3", TD3, "stable_baselines3:TD3")
tqc = _spec("tqc", "TQC", TQC, "sb3_contrib:TQC")
crossq = _spec("crossq", "CrossQ", CrossQ, "sb3_contrib:CrossQ")
trpo = _spec("trpo", "TRPO", TRPO, "sb3_contrib:TRPO")
recurrent_ppo = _spec(
    "recurrent_ppo", "RecurrentPPO", RecurrentPPO, "sb3_contrib:RecurrentPPO", exportable=False
)
