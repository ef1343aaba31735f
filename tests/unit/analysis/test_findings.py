"""Sentences: they say what the table says, and no more."""

from dataclasses import replace

import numpy as np
import pytest

from auvbench.analysis.effects import effects, matched, mean_difference
from auvbench.analysis.findings import sentences
from auvbench.analysis.formatting import difference, turned
from auvbench.analysis.measures import measure
from auvbench.analysis.ranking import rank
from tests.unit.analysis.agents import agent

SUCCESS = measure("success_rate")


def told(agents, **options):
    return [finding.text for finding in sentences(rank(agents, **options), agents)]


def grid(sac=3.0, ppo=1.0, per_k=0.0, **options):
    return [
        agent(algo, k, f, level=level - per_k * (k > 1), **options)
        for algo, level in (("sac", sac), ("ppo", ppo))
        for k in (1, 40)
        for f in (10, 25)
    ]


def test_a_clear_winner_is_called_one():
    agents = [agent("sac", level=3, seed_sd=0), agent("ppo", level=-1, seed_sd=0)]
    first = told(agents)[0]
    assert first.startswith("SAC K=1 25 Hz is first, with success rate ")
    assert first.endswith("and is resolved from the only other agent.")


def test_an_unclear_one_is_not():
    agents = [agent("sac", level=2), agent("ppo", level=2)]
    assert "not resolved from any other agent: the data do not say who is best" in told(agents)[0]
    three = [*agents, agent("ddpg", level=-4, seed_sd=0)]
    first, steps = told(three)[:2]
    assert first.endswith("K=1 25 Hz: the data leave open which of these is best.")
    assert "1 is resolved" in steps


def test_of_policies_that_are_not_compared_no_places_are_counted():
    agents = [
        agent(algo, f=55, level=level, seeds=1) for algo, level in (("ppo", 3), ("sac", 1), ("ddpg", -1))
    ]
    assert not any("steps from one place of the table" in text for text in told(agents))
    assert any("steps from one place of the table" in text for text in told([*agents, *grid()]))


def test_one_agent():
    assert told([agent("sac")])[0].startswith("SAC K=1 25 Hz is the only agent: success rate ")


def test_a_controller_that_does_not_learn_has_no_training_seeds():
    agents = [agent("pid", level=6, seeds=1), agent("sac", level=-1)]
    first = sentences(rank(agents), agents)[0]
    assert first.text.startswith("PID")
    assert first.statistic.endswith("; 200 test episodes.")
    assert not rank(agents).rows[0].trained


def test_the_first_sentence_links_to_its_runs():
    agents = grid()
    ranking = rank(agents)
    assert sentences(ranking, agents)[0].run_ids == ranking.rows[0].run_ids


def test_effects_are_averaged_over_matched_cells():
    agents = grid()
    found = {(e.first, e.second): e for e in effects(agents, SUCCESS)}
    assert set(found) == {("SAC", "PPO"), ("K=40", "K=1"), ("25 Hz", "10 Hz")}
    by_cell = [a.success.mean() - b.success.mean() for a, b in matched(agents, "algo", "sac", "ppo")]
    assert len(by_cell) == 4
    assert found["SAC", "PPO"].difference.value == pytest.approx(np.mean(by_cell))
    assert found["SAC", "PPO"].difference.low > 0


def test_cells_without_a_partner_are_left_out():
    agents = grid()[:-1]
    assert len(matched(agents, "algo", "sac", "ppo")) == 3
    assert matched(agents[:4], "algo", "sac", "ppo") == []


FOUR = ("ddpg", "ppo", "sac", "td3")


def test_of_many_algorithms_no_pair_is_chosen_by_its_name():
    """First and last of an alphabet are no extremes; and of one cell the table itself has every pair, corrected for all."""
    agents = [agent(algo, level=level) for algo, level in zip(FOUR, (4, 1, 1, -2), strict=True)]
    assert effects(agents, SUCCESS) == []
    both = [
        agent(algo, k, level=level) for k in (1, 40) for algo, level in zip(FOUR, (4, 1, 1, -2), strict=True)
    ]
    found = {(e.first, e.second) for e in effects(both, SUCCESS) if e.factor == "algo"}
    assert found == {
        ("PPO", "DDPG"),
        ("SAC", "DDPG"),
        ("TD3", "DDPG"),
        ("SAC", "PPO"),
        ("TD3", "PPO"),
        ("TD3", "SAC"),
    }


def test_of_many_numbers_the_largest_is_set_against_the_smallest():
    agents = [agent("sac", k, level=level) for k, level in ((1, 2), (10, 1), (40, 1), (100, -1))]
    assert [(e.first, e.second) for e in effects(agents, SUCCESS)] == [("K=100", "K=1")]


def test_a_controller_that_does_not_learn_has_no_part_in_effects():
    agents = [*grid(), agent("pid", 1, 10, seeds=1)]
    assert {(e.first, e.second) for e in effects(agents, SUCCESS)} == {
        ("SAC", "PPO"),
        ("K=40", "K=1"),
        ("25 Hz", "10 Hz"),
    }


def test_the_interval_of_an_effect_covers_its_truth():
    """Two cells of two agents with three seeds each, no effect: rarely is one seen."""
    rng, hits, n = np.random.default_rng(0), 0, 400
    base = [agent(a, k, episodes=60) for a in ("sac", "ppo") for k in (1, 40)]
    for _ in range(n):
        hard = rng.normal(size=60)
        made = []
        for one in base:
            success = rng.random((3, 60)) < 1 / (1 + np.exp(-(1 + 0.5 * rng.normal(size=(3, 1)) - hard)))
            made.append(replace(one, outcome=np.where(success, 0, 2).astype(np.int8)))
        estimate, p = mean_difference([(made[0], made[2]), (made[1], made[3])], SUCCESS, 0.95)
        hits += estimate.low <= 0 <= estimate.high
        assert (p < 0.05) == (not estimate.low <= 0 <= estimate.high)
    assert hits / n > 0.95 - 3.5 * np.sqrt(0.95 * 0.05 / n)


def test_effects_say_better_or_worse_by_the_direction_of_the_measure():
    agents = [agent(a, k, steps=s, level=3) for a, s in (("sac", 200), ("ppo", 600)) for k in (1, 40)]
    text = " ".join(told(agents, rank_by="mean_steps"))
    assert "SAC is better than PPO in PAR-1 of the steps: -" in text
    assert "No other effect of K on PAR-1 of the steps is resolved." in text


def test_effects_that_are_not_resolved_share_a_sentence():
    agents = grid(sac=1.5, ppo=1.5)
    found = sentences(rank(agents), agents)
    (one,) = [finding for finding in found if finding.text.startswith("No effect of")]
    assert one.text == "No effect of algorithm, K or frequency on success rate is resolved."
    assert set(one.run_ids) == {run.id for a in agents for run in a.runs}
    shown = one.statistic.partition(". Holm over 3 effects")[0].split("; ")
    by_width = sorted(effects(agents, SUCCESS), key=lambda e: e.difference.high - e.difference.low)
    assert [text.partition(" against ")[0] for text in shown] == [e.first for e in by_width]
    assert all(" points [" in text for text in shown)


def test_an_effect_that_only_the_company_of_others_leaves_unresolved_is_marked():
    """A p between 0.05/3 and 0.05, found by shifting one algorithm's successes little by little."""
    for level in np.arange(1.5, 3, 0.05):
        agents = grid(sac=level, ppo=1.5)
        p = {(e.first, e.second): e.p_value for e in effects(agents, SUCCESS)}["SAC", "PPO"]
        if 0.05 / 3 < p < 0.05:
            statistic = " ".join(f.statistic for f in sentences(rank(agents), agents))
            assert "SAC against PPO" in statistic
            assert "resolved if it were the only one" in statistic
            return
    raise AssertionError("no level gave such a p")


def test_of_many_open_effects_the_sharpest_are_listed():
    agents = []
    for k in (1, 10, 100):
        for f in (10, 25, 55):
            for name, n, m in (("a", 1, 1), ("b", 2, 1), ("c", 3, 1), ("d", 1, 2)):
                one = agent(name, k, f, level=2, seeds=2)
                agents.append(replace(one, key={"reward.k": k, "step.frequency": f, "a.n": n, "a.m": m}))
    (one,) = [f for f in sentences(rank(agents), agents) if f.text.startswith("No effect of")]
    assert one.statistic.count(" against ") == 8
    assert "; 2 more with wider intervals. Holm over 10 effects" in one.statistic


def test_against_the_baseline():
    agents = [*grid(sac=3.0, ppo=-2.0, seed_sd=0.0), agent("pid", 1, 10, level=0.0, seeds=1)]
    text = next(t for t in told(agents, baseline="pid") if t.startswith("Against"))
    assert text.startswith("Against the baseline PID K=1 10 Hz, in success rate: 4 agents better (SAC ")
    assert "4 agents worse (PPO" in text
    assert "points" in text


def test_a_factor_has_no_effect_that_single_seeds_could_show():
    """What is said of K=100 by one training of each: nothing, however far the two policies are apart."""
    agents = [agent("ppo", 1, level=5, seeds=1), agent("ppo", 100, level=-2, seeds=1)]
    text = " ".join(f"{f.text} {f.statistic}" for f in sentences(rank(agents), agents))
    for word in ("better", "worse", "p <", "p =", "effect"):
        assert word not in text, word
    several = [agent("ppo", k, level=level, seeds=5, seed_sd=0.1) for k, level in ((1, 3), (100, -2))]
    assert any("worse" in t or "better" in t for t in told(several))


def test_the_first_is_not_called_best_of_agents_that_were_not_compared_with_it():
    pid, single = agent("pid", level=8, seeds=1), agent("ppo", level=2, seeds=1)
    low = agent("sac", level=-3, seeds=5, seed_sd=0)
    first = told([pid, single])[0]
    assert first.endswith(
        ". PPO K=1 25 Hz has one training seed and is not compared with it: the data do not say who is best."
    )
    several = told([pid, single, low, agent("td3", level=8, seeds=5, seed_sd=0)])
    assert "not resolved from" in several[0]
    assert "PPO K=1 25 Hz has one training seed" in several[0]
    assert "SAC" not in several[0]


def test_what_the_second_measure_resolves():
    agents = [
        agent("pid", level=30, steps=200, seeds=1),
        agent("sac", level=30, steps=400, seed_sd=0, seeds=5),
    ]
    text = next(t for t in told(agents) if "does not resolve" in t)
    assert text.startswith(
        "The one pair that success rate does not resolve is resolved by PAR-1 of the steps: "
        "PID K=1 25 Hz is better than SAC K=1 25 Hz (-2"
    )
    alike = [agent(name, level=2, seeds=5, seed_sd=1.0) for name in ("sac", "ppo")]
    assert "PAR-1 of the steps does not resolve the one pair that success rate leaves open." in told(alike)


def test_equivalence_with_the_baseline_is_told():
    agents = [agent(a, level=6, seed_sd=0, seeds=5, episodes=500) for a in ("sac", "ppo")]
    ranking = rank(agents, baseline="ppo", margin=0.05)
    text = next(f.text for f in sentences(ranking, agents) if f.text.startswith("Against"))
    assert "1 equivalent (SAC K=1 25 Hz)" in text


def test_no_failures_at_all():
    agents = [agent("sac", level=40, seed_sd=0, seeds=1), agent("ppo", level=40, seed_sd=0, seeds=1)]
    text = told(agents)
    assert "No agent failed in any of the 400 test episodes." in text
    assert "The data do not say who is best" in text[0]


def test_training_seeds():
    wild, calm = agent("sac", seed_sd=2.0, level=1), agent("ppo", seed_sd=0.0)
    finding = next(
        f for f in sentences(rank([wild, calm]), [wild, calm]) if f.text.startswith("Training seeds")
    )
    means = 100 * wild.success.mean(axis=1)
    assert finding.text.startswith(
        f"Training seeds of {wild.label} differ most in success rate: {means.min():.1f} to {means.max():.1f} %; "
        f"those of {calm.label} by "
    )
    alone = [f.text for f in sentences(rank([wild]), [wild]) if f.text.startswith("Training seeds")]
    assert alone == [
        f"Training seeds of {wild.label} differ in success rate: {means.min():.1f} to {means.max():.1f} %."
    ]
    single = [agent("sac", seeds=1), agent("ppo", seeds=1)]
    assert told(single)[-1].startswith(
        "Every trained agent has one training seed: a row of one seed describes that policy, and is not compared"
    )
    assert told([wild, single[1]])[-1].startswith("PPO K=1 25 Hz has one training seed")


def test_a_difference_of_two_agents_has_one_interval() -> None:
    pair = [agent("sac", 1, level=3.0), agent("sac", 100, level=-1.0), agent("pid", seeds=1)]
    ranking = rank(pair)
    (comparison,) = (c for c in ranking.comparisons if "PID" not in c.first + c.second)
    texts = [
        finding.text for finding in sentences(ranking, pair) if "in the one matched cell" in finding.text
    ]
    m = measure("success_rate")
    seen = (
        comparison.difference if comparison.first.endswith("K=100 25 Hz") else turned(comparison.difference)
    )
    assert len(texts) == 1
    assert difference(seen, m) in texts[0]


def test_policies_of_one_seed_have_no_effect_of_a_factor() -> None:
    pair = [
        agent("sac", 1, level=3.0, seeds=1),
        agent("sac", 100, level=-1.0, seeds=1),
        agent("pid", seeds=1),
    ]
    texts = " ".join(finding.text for finding in sentences(rank(pair), pair))
    assert "K=100 is" not in texts
    assert "No effect" not in texts
