"""How often do intervals and tests hold what they promise? `python -m auvbench.statistics.coverage` measures.

Agents are simulated whose true rate and mean are known: training seeds differ, scenarios differ in difficulty,
and for a difference two agents meet the same scenarios. The share of simulated experiments whose interval contains
the truth is printed for the t-type interval that the tables use and for the two hierarchical bootstraps; then for
the tests of all pairs of a table the share of false alarms and of differences found, with and without moderation.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import expit
from scipy.stats import gamma, norm

from auvbench.statistics.bootstrap import multiplicities, paired_means, seed_weights
from auvbench.statistics.crossed import crossed, means
from auvbench.statistics.differences import pair_spread, pairs
from auvbench.statistics.intervals import FloatArray
from auvbench.statistics.moderation import moderated
from auvbench.statistics.paired import holm

METHODS = ("t-type (used)", "bootstrap", "bootstrap, rescaled")
FAILED = 5.0
"""logits by which a training that failed is worse: 19 % of the scenarios instead of 94 %"""


@dataclass(frozen=True, slots=True)
class World:
    """Where simulated agents come from: success by a logistic model, steps gamma distributed and cut at 1000."""

    level: float
    """logit of the success rate of a middling seed on a middling scenario"""
    seed_sd: float
    """standard deviation of a training seed's logit"""
    scenario_sd: float = 1.0
    """standard deviation of a scenario's logit"""
    failing: float = 0.0
    """share of the trainings that fail: their logit is lower by `FAILED`"""

    def draw(
        self, S: int, E: int, scenarios: FloatArray, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Success (S, E) in {0, 1} and steps (S, E) of an agent on scenarios (E,) of standard normal difficulty."""
        logit = self.level + self.seed_sd * rng.normal(size=(S, 1)) + self.scenario_sd * scenarios
        if self.failing:
            logit = logit - FAILED * (rng.random((S, 1)) < self.failing)
        success = (rng.random((S, E)) < expit(logit)).astype(np.float64)
        steps = np.minimum(rng.gamma(2.0, 100.0 * np.exp(-0.3 * logit)), 1000.0)
        return success, steps

    def truth(self) -> tuple[float, float]:
        """The rate and the mean number of steps over all seeds and scenarios there could be."""
        nodes, weights = np.polynomial.hermite_e.hermegauss(80)
        weights = np.outer([1 - self.failing, self.failing], weights / weights.sum()).ravel()
        nodes = np.hypot(self.seed_sd, self.scenario_sd) * nodes
        logit = self.level + np.concatenate([nodes, nodes - FAILED])
        scale = 100.0 * np.exp(-0.3 * logit)
        cut = 1000.0 / scale
        # E[min(G, c)] of a gamma variable of shape 2: 2 F_3(c) + c (1 - F_2(c))
        steps = scale * (2 * gamma.cdf(cut, 3) + cut * gamma.sf(cut, 2))
        return float(weights @ expit(logit)), float(weights @ steps)


WORLDS = (
    *((f"{sd}", World(level, sd)) for sd in (0.0, 0.5, 1.0) for level in (0.5, 3.0)),
    *(("2.5", World(level, 2.5)) for level in (0.5, 4.0)),
    ("0.5, 3 of 10 fail", World(3.25, 0.5, failing=0.3)),
)
"""what `main` measures; the last three as wild as trainings of reinforcement learning can be"""


def coverage(
    world: World,
    S: int,
    E: int,
    *,
    replications: int,
    resamples: int = 400,
    confidence: float = 0.95,
    seed: int = 0,
) -> dict[str, FloatArray]:
    """By method the share (4,) of experiments whose interval holds the truth, the truth being known.

    Of the success rate, the mean steps, and the differences of both to a second agent of the same world (truth 0).
    Without resamples, or with one seed, the t-type interval alone.
    """
    rng = np.random.default_rng(seed)
    rate, steps = world.truth()
    truth = np.array([rate, steps, 0.0, 0.0])
    inside = {method: np.zeros(4) for method in (METHODS if resamples and S > 1 else METHODS[:1])}
    tail = (1 - confidence) / 2
    for _ in range(replications):
        scenarios = rng.normal(size=E)
        agents = [world.draw(S, E, scenarios, rng) for _ in range(2)]
        lows, highs = _t_type(agents, confidence)
        inside[METHODS[0]] += (lows <= truth) & (truth <= highs)
        for method, rescaled in ((METHODS[1], False), (METHODS[2], True)):
            if method not in inside:
                continue
            drawn = multiplicities(E, resamples, rng)
            weights = [seed_weights(S, resamples, rng, rescaled=rescaled) for _ in range(2)] * 2
            data = [agents[0][0], agents[1][0], agents[0][1], agents[1][1]]
            r = paired_means(data, drawn, weights)
            r = np.column_stack([r[:, 0], r[:, 2], r[:, 0] - r[:, 1], r[:, 2] - r[:, 3]])
            low, high = np.quantile(r, [tail, 1 - tail], axis=0)
            inside[method] += (low <= truth) & (truth <= high)
    return {method: count / replications for method, count in inside.items()}


def _t_type(
    agents: Sequence[tuple[FloatArray, FloatArray]], confidence: float
) -> tuple[FloatArray, FloatArray]:
    """Ends (4,) of the intervals that the tables use."""
    found = []
    for metric in (0, 1):
        table = crossed([agent[metric] for agent in agents], rate=metric == 0)
        one, both = means(table, confidence)[0], pairs(table, confidence)
        found += [(one.low, one.high), (both.low[0, 1], both.high[0, 1])]
    ends = np.array(found)[[0, 2, 1, 3]]
    return ends[:, 0], ends[:, 1]


def errors(
    seed_sds: Sequence[float], S: int, E: int, *, replications: int, alpha: float = 0.05, seed: int = 0
) -> dict[str, tuple[float, float, float]]:
    """By method (moderated or not) what the tests of all pairs of a table of success rates do wrong and right.

    One agent per entry of `seed_sds`, of rates spread from 0.4 to 0.97. Returns the share of single tests that
    reject the true difference, the share of tables in which Holm's correction rejects at least one, and the share
    of differences over 20 points that Holm's correction finds.
    """
    rng = np.random.default_rng(seed)
    levels = rng.permutation(np.linspace(-0.5, 4.0, len(seed_sds)))
    worlds = [World(float(level), sd) for level, sd in zip(levels, seed_sds, strict=True)]
    truth = np.array([world.truth()[0] for world in worlds])
    upper = np.triu_indices(len(worlds), 1)
    true = (truth[:, None] - truth[None, :])[upper]
    wide = np.abs(true) > 0.2
    found = {"plain": np.zeros(3), "moderated (used)": np.zeros(3)}
    for _ in range(replications):
        scenarios = rng.normal(size=E)
        plain = crossed([world.draw(S, E, scenarios, rng)[0] for world in worlds], rate=True)
        for method, table in (("plain", plain), ("moderated (used)", moderated(plain))):
            spread = pair_spread(table).take(upper)
            difference = (table.mean[:, None] - table.mean[None, :])[upper]
            p = spread.p_value(difference - true)
            power = (holm(spread.p_value(difference))[wide] < alpha).mean()
            found[method] += ((p < alpha).mean(), (holm(p) < alpha).any(), power)
    return {method: tuple(sums / replications) for method, sums in found.items()}


def _print_errors(episodes: int, replications: int) -> None:
    print(
        "| agents | seeds | seeds differ by | test | false, single | false, any (Holm) | found of > 20 points |"
    )
    print("|---|---|---|---|---|---|---|")
    for n, S in ((6, 3), (12, 2), (12, 3), (12, 5)):
        for name, sds in (
            ("0.6", [0.6] * n),
            ("0.2 or 1.2", [0.2, 1.2] * (n // 2)),
            ("0.3, one 2.0", [0.3] * (n - 1) + [2.0]),
        ):
            for method, shares in errors(sds, S, episodes, replications=replications).items():
                cells = " | ".join(f"{share:.3f}" for share in shares)
                print(f"| {n} | {S} | {name} | {method} | {cells} |", flush=True)


def main(argv: Sequence[str] | None = None) -> None:
    """Print the tables of docs/statistics.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--replications", type=int, default=2000, help="experiments per row (tests: a fifth)")
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--resamples", type=int, default=400)
    options = parser.parse_args(argv)
    error = norm.ppf(0.975) * np.sqrt(0.95 * 0.05 / options.replications)
    print(
        f"nominal 0.95, {options.episodes} episodes, {options.replications} experiments (95 % +- {error:.3f})\n"
    )
    print(
        "| seeds differ by | true rate | seeds | interval | rate | mean steps | rate difference | steps difference |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for name, world in WORLDS:
        # One seed: only where seeds do not differ is there something that its interval promises to hold.
        for S in (1, 2, 3, 5, 10) if world.seed_sd == 0 else (2, 3, 5, 10):
            found = coverage(
                world, S, options.episodes, replications=options.replications, resamples=options.resamples
            )
            for method, share in found.items():
                cells = " | ".join(f"{value:.3f}" for value in share)
                print(f"| {name} | {world.truth()[0]:.2f} | {S} | {method} | {cells} |", flush=True)
    print()
    _print_errors(options.episodes, max(options.replications // 5, 1))


if __name__ == "__main__":
    main()
