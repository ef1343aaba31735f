"""A learner: the cross-entropy method (Rubinstein 1999) searches the weights of a linear policy."""

from dataclasses import dataclass

import numpy as np

from auvbench.plugin import AgentConfig, Components, RunError, TrainConfig, VehicleModel, number
from auvbench_example.pursuit import errors


@dataclass(kw_only=True)
class SearchConfig(AgentConfig):
    """Types and ranges of the keys of conf/algo/search.yaml."""

    horizon: int = number(1, 100_000)  # steps for which a candidate acts
    elite: float = number(0.0, 1.0, open_low=True)  # share of candidates that give the next distribution
    spread: float = number(0.0, 100.0, open_low=True)  # standard deviation of the first weights
    least_spread: float = number(0.0, 100.0)


class Search:
    """Each environment tests its own weights; the best weights give the distribution of the next ones."""

    Config = SearchConfig
    exact_resume = True

    def __init__(self, config: TrainConfig, vehicle: VehicleModel):
        self.shape = (len(vehicle.actuators), 5)
        self.mean = np.zeros(self.shape)
        self.deviation = np.full(self.shape, config.algo.spread)
        self.generator = np.random.default_rng(config.seed)

    def reset(self, episodes):
        """Do nothing: the agent has no memory of earlier steps."""

    def act(self, observation):
        """Return actions (n, n_u) in [-1, 1] for observations (n, n_obs), with the mean weights."""
        return self.steer(observation, self.mean[None])

    def steer(self, observation, weights):
        """Return actions with weights (n, n_u, 5), or with weights (1, n_u, 5) for all observations."""
        yaw_error, error = errors(observation)
        features = np.column_stack([np.tanh(error / 5.0), yaw_error / np.pi, np.ones(len(error))])
        return np.tanh((features[:, None, :] * weights).sum(axis=2))

    def learn(self, environment, config, callbacks):
        """Learn in generations of `horizon` steps until the budget is used up."""
        algo, steps = config.algo, callbacks.begin()
        best = max(1, round(algo.elite * environment.n))
        while steps < callbacks.total_steps:
            callbacks.checkpoint(steps)  # between generations, `state` has everything that training needs
            weights = self.mean + self.deviation * self.generator.standard_normal(
                (environment.n, *self.shape)
            )
            score, observation = np.zeros(environment.n), environment.reset()
            for _ in range(algo.horizon):
                result = environment.step(self.steer(observation, weights))
                steps += environment.n
                callbacks.step(steps, result)
                score += result.reward
                observation = result.observation
            elite = weights[np.argsort(-score, kind="stable")[:best]]
            self.mean, self.deviation = elite.mean(axis=0), np.maximum(elite.std(axis=0), algo.least_spread)
            callbacks.log({"search/best_return": float(score.max())}, steps)

    def save(self, folder):
        """Write weights.npz."""
        np.savez(folder / "weights.npz", mean=self.mean)

    def load(self, folder):
        """Read weights.npz without unpickling."""
        with np.load(folder / "weights.npz", allow_pickle=False) as arrays:
            self.mean = arrays["mean"]
        if self.mean.shape != self.shape or not np.isfinite(self.mean).all():
            raise RunError(f"{folder / 'weights.npz'}: no finite weights of shape {self.shape}")

    def state(self):
        """Return everything that training needs to continue, for a checkpoint."""
        arrays = {"search": {"mean": self.mean, "deviation": self.deviation}}
        return Components(arrays=arrays, values={"generator": self.generator.bit_generator.state})

    def restore(self, components):
        """Restore the result of `state`."""
        self.mean, self.deviation = (components.arrays["search"][key] for key in ("mean", "deviation"))
        self.generator.bit_generator.state = components.values["generator"]
