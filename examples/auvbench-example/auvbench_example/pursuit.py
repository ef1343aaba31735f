"""A controller: thrust towards the waypoint, proportional to the errors of position and heading."""

from dataclasses import dataclass

import numpy as np

from auvbench.plugin import AgentConfig, TrainConfig, VehicleModel, number


@dataclass(kw_only=True)
class PursuitConfig(AgentConfig):
    """Types and ranges of the keys of conf/algo/pursuit.yaml."""

    force_gain: float = number(0.0, 1e4, open_low=True)  # N/m
    turn_gain: float = number(0.0, 1e4, open_low=True)  # N m/rad
    effort: float = number(0.0, 1.0, open_low=True)  # share of each thruster's range


def errors(observation):
    """Return the yaw error (n,) in rad and the position error (n, 3) in m, in level axes that turn with the vehicle."""
    return observation[:, 3].astype(np.float64), observation[:, :3].astype(np.float64)


class Pursuit:
    """Proportional control of position and heading; the pseudo-inverse distributes the forces to the thrusters."""

    Config = PursuitConfig

    def __init__(self, config: TrainConfig, vehicle: VehicleModel):
        self.gains = config.algo
        self.vehicle = vehicle
        self.inverse = np.linalg.pinv(vehicle.allocation[[0, 1, 2, 5]])  # (n_u, 4): surge, sway, heave, yaw
        self.limit = config.algo.effort * np.abs(vehicle.force_limits).min()

    def reset(self, episodes):
        """Do nothing: the agent has no memory of earlier steps."""

    def act(self, observation):
        """Return actions (n, n_u) in [-1, 1] for observations (n, n_obs)."""
        yaw_error, error = errors(observation)
        wanted = np.column_stack([self.gains.force_gain * error, self.gains.turn_gain * yaw_error])
        wanted[:, 2] -= self.vehicle.buoyancy - self.vehicle.weight
        # Not a matrix product, whose rounding may depend on the size of the batch.
        thrust = (wanted[:, None, :] * self.inverse).sum(axis=2)
        largest = np.abs(thrust).max(axis=1, keepdims=True)
        return self.vehicle.action(thrust * np.minimum(1.0, self.limit / np.maximum(largest, 1e-9)))
