"""Predict the motions and rewards of plans by an ensemble, for `pets.py`.

The ensemble predicts the change of the motion: velocity, angular velocity and direction of gravity, in body axes. The other observed
numbers follow from the motion by their definitions (`auvbench.blocks`): the vehicle moves with its velocity and turns with its yaw rate,
both integrated by the trapezoidal rule, and the error is the reference minus the position. This module does not depend on the vehicle.

Each member of the ensemble simulates every plan to its end with its own draws (trajectory sampling "TS infinity" of Chua et al. 2018, with
one particle per member). All plans have the same draws, so that differences between plans have less noise.
"""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor, nn

from auvbench.agents.learned.ensemble import Ensemble, bounded
from auvbench.config import schema
from auvbench.errors import ConfigError
from auvbench.registry import TASKS

MOTION = ("velocity", "angular_velocity", "gravity")
"""blocks that the ensemble predicts"""
SIZE = 9
"""Length of a motion: three blocks of three values"""
REWARDS = ("thesis", "tracking", "goal", "exponential")
"""rewards that can be computed from the predicted observation"""
TASKS_KNOWN = ("waypoint", "station_keeping")
"""tasks whose reference is fixed, so that reward and end of an episode can be computed from the predicted observation"""
STEEPEST = 1e-2
"""Lower limit of the squared cosine of the pitch, which is the denominator of the yaw rate"""


class Prediction:
    """Networks of an ensemble, prepared for the fast simulation of plans."""

    def __init__(self, ensemble: Ensemble) -> None:
        layers = ensemble.folded()
        weight, self._bias = layers[0]
        self._motion, self._action = weight[:, :SIZE].contiguous(), weight[:, SIZE:].contiguous()
        self._layers = layers[1:]
        self._high, self._low = ensemble.high.detach(), ensemble.low.detach()
        self._scale = ensemble.output_scale.clone()
        self.members = ensemble.members

    def roll_out(self, motion: Tensor, previous: Tensor, actions: Tensor, noise: Tensor) -> Tensor:
        """Return motions (H + 1, members, n, 9) under plans.

        Args:
            motion: (9,) motion at the start of the plans.
            previous: (n_u,) action of the last step.
            actions: (H, n, n_u) n plans of H steps.
            noise: (H, members, 1, 9) standard normal draws.
        """
        horizon, n, n_u = actions.shape
        before = torch.cat([previous.expand(1, n, n_u), actions[:-1]])
        commands = torch.cat([before, actions], dim=2).reshape(1, horizon * n, 2 * n_u)
        # Contribution of the actions to the first layer, for all steps at once.
        pushed = torch.bmm(commands.expand(self.members, -1, -1), self._action).add_(self._bias)
        pushed = pushed.view(self.members, horizon, n, -1).transpose(0, 1).contiguous()
        states = torch.empty(horizon + 1, self.members, n, SIZE)
        states[0] = motion
        for k in range(horizon):
            rows = pushed[k].baddbmm_(states[k], self._motion)
            for weight, bias in self._layers:
                rows = torch.bmm(nn.functional.silu(rows, inplace=True), weight).add_(bias)
            change, spread = rows[..., :SIZE], rows[..., SIZE:]
            deviation = torch.exp(0.5 * bounded(spread, self._low, self._high)).mul_(self._scale)
            torch.add(states[k], change, out=states[k + 1])
            states[k + 1].addcmul_(deviation, noise[k])
        return states


def moved(states: Tensor, dt: float) -> tuple[Tensor, Tensor]:
    """Integrate motions: return the displacement (H, ..., 3) in m and the change of yaw (H, ...) in rad since the start.

    The displacement is in level axes with the yaw of the start: forward, to port and up.

    Args:
        states: (H + 1, ..., 9) velocity in m/s, angular velocity in rad/s and direction of gravity, body axes.
        dt: s, duration of a step.
    """
    velocity, rates, gravity = states[..., :3], states[..., 3:6], states[..., 6:]
    up = -gravity / torch.linalg.vector_norm(gravity, dim=-1, keepdim=True).clamp_min(0.1)
    level = (1.0 - up[..., 0].square()).clamp_min(STEEPEST)
    turning = (up[..., 2] * rates[..., 2] + up[..., 1] * rates[..., 1]) / level
    turn = torch.zeros_like(turning)
    turn[1:] = torch.cumsum(0.5 * dt * (turning[1:] + turning[:-1]), dim=0)
    cosine = level.sqrt()
    rise = (up * velocity).sum(-1)
    forward = (velocity[..., 0] - up[..., 0] * rise) / cosine
    port = (up[..., 2] * velocity[..., 1] - up[..., 1] * velocity[..., 2]) / cosine
    c, s = torch.cos(turn), torch.sin(turn)
    speed = torch.stack([c * forward - s * port, s * forward + c * port, rise], dim=-1)
    return torch.cumsum(0.5 * dt * (speed[1:] + speed[:-1]), dim=0), turn[1:]


def followed(aim: Tensor, states: Tensor, dt: float) -> Tensor:
    """Return the position error in m and the yaw error in rad (4,) after a step, relative to a fixed reference.

    Args:
        aim: (4,) errors before the step.
        states: (2, 9) motions before and after the step.
        dt: s, duration of the step.
    """
    displacement, turn = moved(states, dt)
    c, s = torch.cos(turn[0]), torch.sin(turn[0])
    x, y, z = aim[:3] - displacement[0]
    return torch.stack([c * x + s * y, c * y - s * x, z, aim[3] - turn[0]])


class Returns:
    """Discounted sum of the task's own reward along predicted motions.

    Raises:
        ConfigError: the reward is not a function of the observation, or the task does not observe the numbers that the reward needs.
    """

    def __init__(self, config: schema.TrainConfig) -> None:
        require_known(config)
        self._task: Any = config.task
        self._reward: Any = config.reward
        self._gamma, self._tail = config.algo.gamma, config.algo.terminal_weight
        self._dt = 1.0 / config.step.frequency
        p = self._reward
        self._decay = p.rate if p.name == "exponential" else 1.0 / p.length
        """Decay of the reward with the distance, 1/m"""
        self._has_yaw = TASKS[config.task.name].has_yaw

    def __call__(self, aim: Tensor, previous: Tensor, actions: Tensor, states: Tensor) -> Tensor:
        """Return the returns (members, n) of plans.

        Args:
            aim: (4,) position error in m, level axes, and yaw error in rad at the start.
            previous: (n_u,) action of the last step.
            actions: (H, n, n_u).
            states: (H + 1, members, n, 9) predicted motions.
        """
        _, n, n_u = actions.shape
        displacement, turn = moved(states, self._dt)
        error = aim[:3] - displacement
        distance = torch.linalg.vector_norm(error, dim=-1)
        if self._has_yaw:
            yaw_error = aim[3] - turn
        else:
            yaw_error = torch.atan2(error[..., 1], error[..., 0]) - turn
        before = torch.cat([previous.expand(1, n, n_u), actions[:-1]])
        effort = actions.square().mean(-1)[:, None]
        change = (actions - before).square().mean(-1)[:, None]
        start = torch.linalg.vector_norm(aim[:3]).expand(1, *distance.shape[1:])
        reward = self._steps(distance, torch.cat([start, distance[:-1]]), yaw_error, effort, change)
        return self._summed(reward, distance)

    def _steps(
        self, distance: Tensor, last: Tensor, yaw_error: Tensor, effort: Tensor, change: Tensor
    ) -> Tensor:
        """Return the reward (H, members, n) of steps that do not end the episode."""
        p, reward = self._reward, torch.exp(-distance * self._decay)
        if p.name == "thesis":
            return torch.where(distance < last, reward.mul(p.k), p.regress)
        if p.name == "exponential":
            return reward.mul(p.k)
        off = torch.remainder(yaw_error + math.pi, 2.0 * math.pi) - math.pi
        reward += p.yaw * torch.exp(-off.abs() / p.yaw_length)
        reward -= p.effort * effort + p.change * change
        if p.name == "goal":
            reward += p.fine * torch.exp(-distance / p.fine_length)
        return reward.mul(p.k)

    def _summed(self, reward: Tensor, distance: Tensor) -> Tensor:
        """Return the discounted sums (members, n) up to the end of the episode. If the plan does not end the episode, its last reward
        counts `terminal_weight` times.
        """
        p = self._reward
        factor = p.k if p.name in ("tracking", "goal") else 1.0
        over = torch.zeros_like(reward, dtype=torch.bool)
        if radius := getattr(self._task, "goal_radius", 0.0):
            over = distance < radius
            success = factor * getattr(p, "success", 0.0)
            reward = torch.where(over, success if p.name == "thesis" else reward + success, reward)
        if bounds := getattr(self._task, "bounds", 0.0):
            over = distance > bounds
            reward = torch.where(
                over, p.failure if p.name == "exponential" else reward + factor * p.failure, reward
            )
        weight = self._gamma ** torch.arange(len(reward), dtype=torch.float32)[:, None, None]
        weight = torch.where(over, weight, torch.cat([weight[:-1], weight[-1:] * self._tail]))
        # A step's reward is added only if no earlier step ended the episode.
        alive = torch.ones_like(reward)
        alive[1:] = torch.cumprod((~over[:-1]).float(), dim=0)
        return (alive * weight * reward).sum(0)


def require_known(config: schema.TrainConfig) -> None:
    """Refuse a task or a reward that cannot be computed from the predicted observation.

    Raises:
        ConfigError: the message names the key, its value and the possible values.
    """
    name = config.task.name
    if name not in TASKS_KNOWN:
        raise ConfigError(
            f"task={name}: algo=pets cannot compute its reward from the observation; use {', '.join(TASKS_KNOWN)}"
        )
    if config.reward.name not in REWARDS:
        raise ConfigError(
            f"reward.name={config.reward.name}: algo=pets cannot compute it from the observation; use {', '.join(REWARDS)}"
        )
    if getattr(config.reward, "velocity", 0.0) > 0.0:
        raise ConfigError(
            f"reward.velocity={config.reward.velocity:g}: algo=pets does not predict the velocity error; use 0"
        )
    if config.task.position_frame != "body":
        raise ConfigError(
            f"task.position_frame={config.task.position_frame}: algo=pets needs body; task=waypoint_state has it"
        )
