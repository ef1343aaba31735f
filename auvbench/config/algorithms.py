"""The schemas of the `algo` group: who learns or controls, and how."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.config.schema import choice, later, name, number


@dataclass(kw_only=True)
class Algorithm:
    """What every `algo/*.yaml` has: which agent it is and how many environments it drives."""

    name: str = name()
    agent: str = choice("ppo", "sac", "ddpg", "td3", "pid", "lqr", "smc", "mpc", "random")
    n_envs: int = number(1, 65_536)


@dataclass(kw_only=True)
class Network:
    """What the learners share."""

    net_arch: list[int]
    activation: str = choice("tanh", "relu", "elu", "silu")
    learning_rate: float = number(0.0, 1.0, open_low=True)
    learning_rate_schedule: str = choice("constant", "linear")
    batch_size: int = number(1, 1 << 24)
    gamma: float = number(0.0, 1.0)
    horizon_s: float | None = later(number(0.0, 1e7, open_low=True))  # s


@dataclass(kw_only=True)
class PPO(Network, Algorithm):
    n_steps: int = number(1, 1 << 24)
    n_epochs: int = number(1, 1000)
    gae_lambda: float = number(0.0, 1.0)
    clip_range: float = number(0.0, 10.0, open_low=True)
    normalize_advantage: bool
    ent_coef: float = number(0.0, 10.0)
    vf_coef: float = number(0.0, 10.0)
    max_grad_norm: float = number(0.0, 1e6, open_low=True)
    log_std_init: float = number(-20.0, 5.0)


@dataclass(kw_only=True)
class OffPolicy(Network, Algorithm):
    buffer_size: int = number(1, 1 << 31)
    learning_starts: int = number(0, 1 << 40)
    tau: float = number(0.0, 1.0, open_low=True)
    train_freq: int = number(1, 1 << 24)
    gradient_steps: int = number(-1, 1 << 24)


@dataclass(kw_only=True)
class SAC(OffPolicy):
    ent_coef: str
    target_entropy: str
    target_update_interval: int = number(1, 1 << 24)


@dataclass(kw_only=True)
class DDPG(OffPolicy):
    action_noise: float = number(0.0, 10.0)


@dataclass(kw_only=True)
class TD3(OffPolicy):
    action_noise: float = number(0.0, 10.0)
    policy_delay: int = number(1, 1000)
    target_policy_noise: float = number(0.0, 10.0)
    target_noise_clip: float = number(0.0, 10.0)


@dataclass(kw_only=True)
class Cascade(Algorithm):
    """What the controllers that steer by velocity share."""

    cruise_speed: float = number(0.0, 100.0, open_low=True)  # m/s
    approach: float = number(0.0, 100.0, open_low=True)  # 1/s
    filter_time: float = number(0.0, 1e3, open_low=True)  # s
    effort: float = number(0.0, 1.0, open_low=True)


@dataclass(kw_only=True)
class PID(Cascade):
    bandwidth: float = number(0.0, 100.0, open_low=True)  # rad/s
    heading_bandwidth: float = number(0.0, 100.0, open_low=True)  # rad/s
    integral_time: float = number(0.0, 1e6, open_low=True)  # s


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


@dataclass(kw_only=True)
class Random(Algorithm):
    pass
