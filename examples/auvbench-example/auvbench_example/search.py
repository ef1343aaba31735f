"""An agent that learns: a linear policy, found by the cross-entropy method (Rubinstein 1999) over its weights."""

from dataclasses import dataclass

import numpy as np

from auvbench.plugin import AgentConfig, Components, RunError, TrainConfig, VehicleModel, number
from auvbench_example.pursuit import in_body_axes


@dataclass(kw_only=True)
class SearchConfig(AgentConfig):
    """Types and ranges of what conf/algo/search.yaml says."""

    horizon: int = number(1, 100_000)  # steps for which a candidate steers
    elite: float = number(
        0.0, 1.0, open_low=True
    )  # share of the candidates that the next ones are drawn from
    spread: float = number(0.0, 100.0, open_low=True)  # standard deviation of the first weights
    least_spread: float = number(0.0, 100.0)


class Search:
    """Each environment tries weights of its own; the best of them say where the next are drawn."""

    Config = SearchConfig
    exact_resume = True

    def __init__(self, config: TrainConfig, vehicle: VehicleModel):
        self.shape = (len(vehicle.actuators), 5)
        self.mean = np.zeros(self.shape)
        self.deviation = np.full(self.shape, config.algo.spread)
        self.generator = np.random.default_rng(config.seed)

    def reset(self, episodes):
        """Nothing is remembered from step to step, so there is nothing to forget."""

    def act(self, observation):
        """Actions (n, n_u) in [-1, 1] for observations (n, n_obs), by the mean of the weights."""
        return self.steer(observation, self.mean[None])

    def steer(self, observation, weights):
        """The same with weights (n, n_u, 5), or (1, n_u, 5) for all."""
        yaw_error, error = in_body_axes(observation)
        features = np.column_stack([np.tanh(error / 5.0), yaw_error / np.pi, np.ones(len(error))])
        return np.tanh((features[:, None, :] * weights).sum(axis=2))

    def learn(self, environment, config, callbacks):
        """Generations of `horizon` steps until the budget is used up."""
        algo, steps = config.algo, callbacks.begin()
        best = max(1, round(algo.elite * environment.n))
        while steps < callbacks.total_steps:
            callbacks.checkpoint(steps)  # between generations the state below is all there is
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
        """Writes weights.npz."""
        np.savez(folder / "weights.npz", mean=self.mean)

    def load(self, folder):
        """Reads weights.npz; nothing is unpickled."""
        with np.load(folder / "weights.npz", allow_pickle=False) as arrays:
            self.mean = arrays["mean"]
        if self.mean.shape != self.shape or not np.isfinite(self.mean).all():
            raise RunError(f"{folder / 'weights.npz'}: no finite weights of shape {self.shape}")

    def state(self):
        """All that training goes on with, for a checkpoint."""
        arrays = {"search": {"mean": self.mean, "deviation": self.deviation}}
        return Components(arrays=arrays, values={"generator": self.generator.bit_generator.state})

    def restore(self, components):
        """Returns to what `state` gave."""
        self.mean, self.deviation = (components.arrays["search"][key] for key in ("mean", "deviation"))
        self.generator.bit_generator.state = components.values["generator"]
