"""The original study's claims: each verdict from data made to deserve it, and the functions behind them."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from auvbench.analysis import claims, thesis
from auvbench.analysis.evidence import (
    FAILS,
    HOLDS,
    OPEN,
    Evidence,
    Part,
    by_interval,
    independent,
    learning,
    partial_rank_correlation,
    together,
    trend,
)
from auvbench.analysis.records import RunRecord
from auvbench.analysis.sources import RunFolder
from auvbench.reporting import tables
from auvbench.statistics.intervals import Estimate
from tests.unit.analysis.agents import agent, record

GRID = [(k, f) for k in (1.0, 40.0, 100.0) for f in (10.0, 25.0, 55.0)]


def training(when=None, *, episodes=600, length=1000, end_fails=False, top_fails=0.0) -> pd.DataFrame:
    """Training records that succeed in 200 steps from the step `when` on, and time out before."""
    steps, outcome, at = [], [], 0
    for i in range(episodes):
        good = when is not None and at >= when and not (end_fails and i >= episodes - 120)
        steps.append(200 if good else length)
        outcome.append("success" if good else "timeout" if length >= 1000 else "collision")
        at += steps[-1]
    returns = np.arange(episodes, dtype=float)
    frame = pd.DataFrame({"step": np.cumsum(steps), "steps": steps, "outcome": outcome, "return": returns})
    frame["final_distance_m"] = 2.0
    failing = round(top_fails * (episodes // 20))
    frame.loc[episodes - failing :, "outcome"] = "timeout"
    return frame


def trained(folder, algo, k, f, seed, frame, steps=1_000_000) -> RunRecord:
    run = record(algo, k, f, seed, steps=steps)
    directory = folder / run.id
    (directory / "train").mkdir(parents=True)
    frame.to_csv(directory / "train" / "episodes.csv", index=False)
    return RunRecord(run.id, RunFolder(directory), run.state, run.seed, run.config, run.manifest)


SWIFT = agent("pid", level=8, steps=80)
"""a control that converges within 18.2 s"""
SLOW = agent("pid", level=8, steps=220)
"""a control that converges within 40 s and not within 18.2 s"""


def claim(number, runs=(), agents=()):
    """Judge one claim: the others would compare all pairs of agents."""
    text, parts = claims.CLAIMS[number - 1]
    return together(text, parts(Evidence(runs, agents, 0.95, 0)))


def with_runs(one, runs):
    """The agent with its own runs replaced by those that were trained on disk."""
    own = {run.id: run for run in runs}
    return replace(one, runs=tuple(own[run.id] for run in one.runs))


# Convergence


def test_convergence_is_dated_by_the_first_window_of_short_successes(tmp_path):
    found = learning(trained(tmp_path, "sac", 1, 25, 0, training(when=100_000)))
    # 100 episodes of 1000 steps (40 s), then successes of 200: half of the window that begins after 50 episodes are
    # successes, and its mean is 24 s.
    assert found.converged
    assert found.converged_at(40.0) == 50_000
    assert found.converged_at(11.0) == 74_000, (
        "long episodes are cut at the limit; 74 short ones bring the mean below 8.8 s"
    )
    assert found.converged_at(7.9) == np.inf, "no success within the limit"


@pytest.mark.parametrize(
    "frame",
    [training(), training(when=100_000, end_fails=True), training(length=150)],
    ids=["never", "lost", "collides early"],
)
def test_no_convergence(tmp_path, frame):
    found = learning(trained(tmp_path, "sac", 1, 25, 0, frame))
    assert not found.converged


def test_too_few_episodes_say_nothing(tmp_path):
    assert learning(trained(tmp_path, "sac", 1, 25, 0, training(episodes=99))) is None
    assert learning(record("sac", 1, 25, 0)) is None


# Trend


def test_trend_is_mann_whitney_for_two_levels():
    rng = np.random.default_rng(0)
    low, high = rng.normal(0, 1, 5), rng.normal(1.2, 1, 6)
    points = [("a", 0.0, x) for x in low] + [("a", 1.0, x) for x in high]
    found = trend(points)
    test = stats.mannwhitneyu(high, low, alternative="greater", method="exact")
    assert found.share == pytest.approx(test.statistic / 30)
    # 10,000 permutations: four standard errors.
    assert found.p_up == pytest.approx(test.pvalue, abs=4 * np.sqrt(test.pvalue / 10_000))


def test_trend_in_strata_agrees_with_all_permutations():
    points = [
        ("a", 1.0, 3.0),
        ("a", 2.0, 5.0),
        ("a", 3.0, 4.0),
        ("b", 1.0, 1.0),
        ("b", 2.0, 1.0),
        ("b", 2.0, 7.0),
    ]

    def statistic(a, b):
        wins = sum((y > x) + 0.5 * (y == x) for i, x in enumerate(a) for y in a[i + 1 :])
        return wins + sum((y > b[0]) + 0.5 * (y == b[0]) for y in b[1:])

    exact = [statistic(a, b) for a in permutations([3.0, 5.0, 4.0]) for b in permutations([1.0, 1.0, 7.0])]
    observed = statistic([3.0, 5.0, 4.0], [1.0, 1.0, 7.0])
    found = trend(points)
    assert found.share == pytest.approx(observed / 5)
    assert found.p_up == pytest.approx(np.mean(np.array(exact) >= observed), abs=0.02)
    assert found.p_down == pytest.approx(np.mean(np.array(exact) <= observed), abs=0.02)


def test_single_runs_cannot_resolve_a_trend():
    """The original study's own evidence for its second claim: two pairs of runs."""
    found = trend([("K=1", -25.0, -5.0), ("K=1", -10.0, -3.0), ("K=40", -25.0, -6.0), ("K=40", -10.0, -4.0)])
    assert found.share == 1
    assert found.p_up == pytest.approx(0.25, abs=0.02)
    assert trend([("a", 1.0, 3.0), ("b", 2.0, 4.0)]) is None


# Verdicts


def test_parts_make_a_verdict():
    assert together("x", [Part(HOLDS), Part(HOLDS)]).verdict == HOLDS
    assert together("x", [Part(HOLDS), Part(OPEN)]).verdict == OPEN
    assert together("x", [Part(OPEN), Part(FAILS)]).verdict == FAILS
    found = together("x", [Part(HOLDS, "s1"), Part(OPEN, "s2", "m2")])
    assert (found.statistic, found.missing) == ("(a) holds: s1; (b) cannot be said: s2.", "(b) m2.")


def test_by_interval():
    def at(confidence):
        half = 0.5 if confidence == 0.95 else 0.8
        return Estimate(1.0, 1.0 - half, 1.0 + half)

    one, three = (Evidence((), (), 0.95, 0).levels(n) for n in (1, 3))
    assert three == pytest.approx((0.95, 1 - 0.05 / 3))
    bounds = (0.0, 0.4, 1.0, 1.6, 2.0)
    assert [by_interval(at, one, x) for x in bounds] == [HOLDS, HOLDS, OPEN, FAILS, FAILS]
    assert [by_interval(at, three, x) for x in bounds] == [HOLDS, HOLDS, OPEN, OPEN, FAILS]
    assert [by_interval(at, three, x, less=True) for x in bounds] == [FAILS, OPEN, OPEN, HOLDS, HOLDS]


def test_nothing_there_means_nothing_said():
    answers = claims.judge([], [])
    assert len(answers) == 7
    assert {answer.verdict for answer in answers} == {OPEN}
    assert all(answer.missing for answer in answers)


# The claims


def test_claim_1(tmp_path):
    runs = [trained(tmp_path, "sac", k, 55.0, s, training()) for k in (1.0, 40.0, 100.0) for s in range(5)]
    told = claim(1, runs, [SWIFT])
    assert told.verdict == HOLDS
    assert "K=1: 0 of 5 (at most 45 %)" in told.statistic
    for controls in ([], [SLOW]):
        told = claim(1, runs, controls)
        assert told.verdict == OPEN, "no control converges within 18.2 s"
        assert "18.2 s" in told.missing
    few = claim(1, [run for run in runs if run.seed < 4], [SWIFT])
    assert few.verdict == OPEN, "none of four: it may still be half"
    assert "ore training seeds with K=1, 40 and 100" in few.missing
    short = [
        RunRecord(r.id, r.source, r.state, r.seed, r.config, {**r.manifest, "steps": 60_000}) for r in runs
    ]
    told = claim(1, short, [SWIFT])
    assert told.verdict == OPEN
    assert "1,000,000 training steps in 15 runs" in told.missing
    assert "K=100" in claim(1, runs[:10], [SWIFT]).missing


def test_claim_1_fails_where_most_trainings_converge(tmp_path):
    good = [
        trained(tmp_path, "sac", k, 55.0, s, training(when=50_000))
        for k in (1.0, 40.0, 100.0)
        for s in range(3)
    ]
    assert claim(1, good).verdict == FAILS, "nine of nine"
    assert claim(1, good[:3]).verdict == OPEN, "three of three: it may still be half"


def test_claim_2(tmp_path):
    def grid(folder, when):
        return [
            trained(tmp_path / folder, "sac", k, f, s, training(when[f], episodes=900))
            for k in (1.0, 40.0)
            for f in when
            for s in range(3)
        ]

    runs = grid("sooner", {10.0: 50_000, 25.0: 120_000, 55.0: None})
    told = claim(2, runs, [SLOW])
    assert told.verdict == HOLDS
    assert "left out: 6 runs" in told.statistic, "no control converges within 18.2 s"
    assert claim(2, runs).verdict == OPEN
    equal = [replace(run, config={**run.config, "task.time_limit": 100.0}) for run in runs]
    told = claim(2, equal, [SLOW])
    assert told.verdict == HOLDS
    assert "left out" not in told.statistic
    assert claim(2, grid("turned", {10.0: None, 25.0: 120_000, 55.0: 50_000}), [SLOW]).verdict == FAILS
    assert claim(2, runs[:1], [SLOW]).verdict == OPEN


def test_claim_2_compares_equal_budgets(tmp_path):
    """A run that converged after the shorter one ended has not converged sooner than it."""
    late = trained(tmp_path, "sac", 1.0, 10.0, 0, training(700_000, episodes=2000), steps=1_000_000)
    brief = trained(tmp_path, "sac", 1.0, 25.0, 0, training(episodes=300), steps=300_000)
    told = claim(2, [late, brief], [SLOW])
    assert told.verdict == OPEN
    assert "converge" in told.missing


@pytest.mark.parametrize("level", [8.0, 1.0], ids=["a controller", "a frozen policy"])
@pytest.mark.parametrize("time_limit", [None, 100.0], ids=["1000 steps", "100 s"])
def test_no_claim_holds_for_policies_that_learn_nothing(tmp_path, level, time_limit):
    """One policy in every cell, its test episodes as training records: what it shows is no effect of learning."""
    policy = agent("sac", level=level, steps=220, seeds=5, episodes=400)
    seconds, reached = policy.metrics["duration_s"], policy.outcome == 0
    runs, agents = [], [SLOW]
    for algo in ("sac", "ppo"):
        for k, f in GRID:
            limit = time_limit or 1000 / f
            mine = []
            for s in range(5):
                success = reached[s] & (seconds[s] <= limit)
                steps = np.round(np.minimum(np.where(success, seconds[s], limit), limit) * f)
                outcome = np.where(success, "success", "timeout")
                columns = {"step": np.cumsum(steps), "steps": steps, "outcome": outcome}
                frame = pd.DataFrame({**columns, "return": 500.0 * success + 0.4 * k * steps})
                frame["final_distance_m"] = 2.0
                run = trained(tmp_path, algo, k, f, s, frame)
                mine.append(replace(run, config={**run.config, "task.time_limit": time_limit}))
            runs += mine
            key = {"algo": algo, "reward.k": k, "step.frequency": f}
            agents.append(replace(policy, label=f"{algo} {k:g} {f:g}", key=key, runs=tuple(mine)))
    for number, told in enumerate(claims.judge(runs, agents), start=1):
        assert told.verdict != HOLDS, (number, told.statistic)
        assert "holds:" not in told.statistic, (number, told.statistic)


def test_claim_3_is_refuted_by_more_success_and_never_holds():
    """K scales the reward of equal motion, so more reward with a larger K shows nothing."""

    def grid(level):
        return [agent("sac", k, f, level=level(k), seed_sd=0.1, episodes=500, seeds=5) for k, f in GRID]

    alike = claim(3, (), grid(lambda k: 3))
    assert alike.verdict == OPEN
    assert "scales" in alike.missing
    assert claim(3, (), grid(lambda k: 0 if k == 1 else 4)).verdict == FAILS


def test_claim_4():
    levels = {(k, f): 0.0 - 0.3 * (k > 1) for k, f in GRID} | {(1.0, 25.0): 5.0}
    agents = [agent("sac", k, f, level=x, seed_sd=0.1, episodes=500, seeds=5) for (k, f), x in levels.items()]
    assert claim(4, (), agents).verdict == HOLDS
    some = [a for a in agents if a.key["step.frequency"] != 55]
    told = claim(4, (), some)
    assert told.verdict == OPEN
    assert "K=1 55 Hz" in told.missing
    levels[1.0, 25.0] = -2.0
    agents = [agent("sac", k, f, level=x, seed_sd=0.1, episodes=500, seeds=5) for (k, f), x in levels.items()]
    assert claim(4, (), agents).verdict == FAILS


@pytest.mark.slow
def test_claim_5(tmp_path):
    def world(level_when_not, folder):
        agents, runs = [], []
        for k, f in GRID:
            both = [agent("sac", k, f, level=x, seed_sd=0.3, seeds=6) for x in (3.0, level_when_not)]
            outcome = np.where(np.arange(6)[:, None] < 3, both[0].outcome, both[1].outcome)
            mine = [
                trained(tmp_path / folder, "sac", k, f, s, training(50_000 if s < 3 else None))
                for s in range(6)
            ]
            agents.append(with_runs(replace(both[0], outcome=outcome), mine))
            runs += mine
        return runs, [*agents, SWIFT]

    runs, agents = world(3.0, "same")
    told = claim(5, runs, agents)
    assert told.verdict in (HOLDS, OPEN)
    assert "The best of 27 runs that did not converge succeeds in" in told.statistic
    assert "27 of the 27 succeed in more than 80 % of the episodes" in told.statistic
    slow = claim(5, runs, [*(replace(a, metrics={}) for a in agents[:-1]), SLOW])
    assert "The best of 18 runs" in slow.statistic, "no control converges at 55 Hz"
    told = claim(5, *world(-2.0, "worse"))
    assert told.verdict == FAILS
    assert "0 of the 27 succeed in more than 80 % of the episodes" in told.statistic


def with_means(agents, deviation, steps, failing):
    found = []
    for one, d, s, share in zip(agents, deviation, steps, failing, strict=True):
        zero = 0 * one.metrics["steps"]
        outcome = np.where(np.arange(zero.shape[1]) < round(share * zero.shape[1]), 2, 0)
        metrics = {"steps": zero + s, "deviation_mean_m": zero + d}
        found.append(replace(one, metrics=metrics, outcome=np.tile(outcome, (len(zero), 1)).astype(np.int8)))
    return found


@pytest.mark.slow
def test_claim_6():
    rng = np.random.default_rng(2)
    told = claim(6, (), [agent("sac", k, f) for k, f in GRID])
    assert told.verdict == OPEN

    def made(n, spread):
        order = np.arange(n)
        steps = rng.permutation(n) if spread else order
        agents = [agent("sac", float(i), 25.0) for i in range(n)]
        return with_means(agents, order, steps, 0.4 * rng.random(n))

    assert claim(6, (), made(9, False)).verdict == FAILS
    assert claim(6, (), made(200, True)).verdict == HOLDS


def test_claim_6_is_judged_given_failures():
    """Long and crooked episodes are failures: both measures follow the failure rate and nothing else."""
    rng = np.random.default_rng(4)
    n = 60
    failing = np.linspace(0, 0.6, n)
    deviation, steps = (failing + 0.1 * rng.normal(size=n) for _ in range(2))
    agents = with_means([agent("sac", float(i), 25.0) for i in range(n)], deviation, steps, failing)
    assert stats.spearmanr(deviation, steps).statistic > 0.5
    assert claim(6, (), agents).verdict != FAILS


def test_cells_of_a_crossed_grid_are_not_independent_agents():
    crossed = [agent(algo, k, f) for algo in ("sac", "ppo", "ddpg") for k, f in GRID]
    assert independent(crossed) == 7
    assert independent([agent("sac", float(i), 25.0) for i in range(9)]) == 9
    rng = np.random.default_rng(0)
    order = np.arange(27.0)
    told = claim(6, (), with_means(crossed, order, order + 8 * rng.normal(size=27), 0.4 * rng.random(27)))
    assert told.verdict == OPEN
    assert "27 agents, of which 7 are independent" in told.statistic


def test_claim_7():
    def grid(sac, ppo):
        return [agent("sac", k, f, level=sac[f], seed_sd=0.1) for k, f in GRID] + [
            agent("ppo", k, f, level=ppo[f], seed_sd=0.1) for k, f in GRID
        ]

    theirs = grid({10.0: 2.0, 25.0: 2.5, 55.0: 2.0}, {10.0: 4.5, 25.0: -1.5, 55.0: -3.0})
    told = claim(7, (), theirs)
    assert told.verdict == HOLDS, told.missing
    assert (
        claim(7, (), grid({10.0: 3.0, 25.0: 3.0, 55.0: -3.0}, {10.0: 3.0, 25.0: 3.0, 55.0: 3.0})).verdict
        == FAILS
    )
    assert claim(7, (), theirs[:9]).verdict == OPEN


def test_agents_trained_as_in_the_thesis_come_first():
    plain, theirs = agent("sac", 1, 25), agent("sac_thesis", 1, 25)
    assert [a.label for a in Evidence((), [plain, theirs], 0.95, 0).of("sac")] == [theirs.label]
    assert [a.label for a in Evidence((), [plain], 0.95, 0).of("sac")] == [plain.label]


def test_factors_come_from_the_runs_where_agents_were_not_grouped_by_them():
    one = replace(agent("sac", 40, 55), key={"algo": "sac"})
    assert Evidence((), [one], 0.95, 0).agents[0].key == {"algo": "sac", "reward.k": 40, "step.frequency": 55}
    mixed = replace(one, runs=(record("sac", 1, 55, 0), record("sac", 40, 55, 1)))
    assert Evidence((), [mixed], 0.95, 0).agents[0].key["reward.k"] is None
    assert claims.judge((), [mixed])[3].verdict == OPEN


# What is no evidence


def untrained(algo, k, f, steps=20_000, **options):
    one = agent(algo, k, f, level=-4.5, **options)
    runs = tuple(
        replace(run, manifest={**run.manifest, "steps": steps, "total_steps": steps}) for run in one.runs
    )
    return replace(one, runs=runs)


def test_agents_that_learned_nothing_confirm_and_refute_nothing(tmp_path):
    nobody = [untrained(algo, k, f) for algo in ("sac", "ppo") for k, f in GRID]
    for number in (3, 4, 6, 7):
        told = claim(number, (), nobody)
        assert told.verdict == OPEN, told
        assert told.missing
    assert "nothing learned" in claim(3, (), nobody).missing
    some = [agent("sac", k, f, level=2.0) for k, f in GRID]
    six = claim(6, (), some)
    assert claim(6, (), [*some, *nobody[9:]]).verdict == six.verdict
    assert "over 9 agents" in claim(6, (), [*some, *nobody[9:]]).statistic


def test_a_ppo_that_was_hardly_trained_has_not_failed(tmp_path):
    agents = [untrained("ppo", 1.0, 25.0)]
    assert "1,000,000 training steps (here 20,000)" in claim(7, (), agents).missing
    full = [untrained("ppo", 1.0, 25.0, steps=1_000_000)]
    assert (
        "(c) holds: the typical training of PPO with K=1 at 25 Hz succeeds in" in claim(7, (), full).statistic
    )


def test_one_seed_and_unequal_budgets_are_no_evidence():
    one = [agent("sac", k, f, level=3 - 3 * (k > 50), seeds=1, episodes=500) for k, f in GRID]
    told = claim(4, (), one)
    assert told.verdict == OPEN
    assert "(a) several training seeds" in told.missing.replace("Several", "several").replace(
        "(a) S", "(a) s"
    )
    assert "3 cells left out" in told.missing
    several = [agent("sac", k, f, level=3 - 3 * (k > 50), episodes=500) for k, f in GRID]
    mixed = [
        replace(
            a,
            runs=tuple(
                replace(r, manifest={**r.manifest, "steps": 500_000, "total_steps": 500_000}) for r in a.runs
            ),
        )
        if a.key["reward.k"] > 50
        else a
        for a in several
    ]
    assert "3 cells left out" in claim(4, (), mixed).missing


def test_a_rollout_that_ends_after_the_budget_is_no_other_budget():
    def overshot(one):
        runs = (replace(r, manifest={**r.manifest, "steps": 1_000_000 + 64 * r.seed}) for r in one.runs)
        return replace(one, runs=tuple(runs))

    agents = [agent("sac", k, f, level=3 - 3 * (k > 50), episodes=500) for k, f in GRID]
    assert claim(4, (), [overshot(one) for one in agents]).statistic == claim(4, (), agents).statistic


# The thesis's numbers


def test_the_thesis_table_agrees_with_itself():
    rates = [thesis.TABLE[f"{name}_rate"] for name in ("success", "collision", "timeout")]
    for name in thesis.AGENTS[:-1]:
        assert sum(row[name].value for row in rates) == pytest.approx(100, abs=0.05)
        steps, norm, total = (
            thesis.TABLE[m][name].value
            for m in ("mean_steps", "mean_command_norm_mean_N", "mean_command_norm_sum_N")
        )
        assert steps * norm == pytest.approx(total, rel=2e-3)
    assert {a for row in thesis.TABLE.values() for a in row} == set(thesis.AGENTS)
    assert [a for row in thesis.TABLE.values() for a, x in row.items() if x.mark == "r"].count("SAC3") == 2


def test_partial_rank_correlation_of_the_original_study():
    names = [a for a in thesis.AGENTS if a in thesis.TABLE["mean_steps"]]
    assert len(names) == 10
    deviation, steps, failing = (
        np.array([thesis.TABLE[m][a].value for a in names])
        for m in ("mean_deviation_mean_m", "mean_steps", "timeout_rate")
    )
    xy, xz, yz = (
        stats.spearmanr(a, b).statistic
        for a, b in ((deviation, steps), (deviation, failing), (steps, failing))
    )
    found = partial_rank_correlation(deviation, steps, failing, 10, 0.95)
    assert found.value == pytest.approx((xy - xz * yz) / np.sqrt((1 - xz**2) * (1 - yz**2)))
    constant = np.zeros(10)
    assert partial_rank_correlation(deviation, steps, constant, 10, 0.95).value == pytest.approx(xy)


def test_the_interval_of_a_rank_correlation_covers_its_truth():
    rng, hits, n = np.random.default_rng(3), 0, 600
    r = 0.5
    truth = 6 / np.pi * np.arcsin(r / 2)  # Spearman's rho of a bivariate normal
    for _ in range(n):
        x, given = rng.normal(size=(2, 15))
        y = r * x + np.sqrt(1 - r**2) * rng.normal(size=15)
        estimate = partial_rank_correlation(x, y, given, 15, 0.95)
        hits += estimate.low <= truth <= estimate.high
    assert hits / n > 0.95 - 3.5 * np.sqrt(0.95 * 0.05 / n)


def test_beside_the_thesis():
    agents = [agent("sac", 1, 25), agent("ppo", 1, 10)]
    rows = thesis.compare(agents)
    mine = {(row.agent, row.measure): row for row in rows}
    success = mine["SAC4", "success_rate"]
    assert (success.theirs.value, success.label) == (100.0, "SAC K=1 25 Hz")
    assert success.ours.value == pytest.approx(100 * agents[0].success.mean())
    assert mine["SAC1", "success_rate"].ours is None
    assert mine["SAC3", "success_rate"].theirs.mark == "r"
    table = tables.comparison_table(rows)
    assert table is not None
    text = tables.pipes(table)
    assert "| SAC1 (K=1 55 Hz, not run) | 54.5 / – |" in text
    assert len(text.splitlines()) == 2 + len(thesis.AGENTS) + 2
