"""Differences of agents with one run each, and how rarely all-pairs tests and the simulations behind the appendix err."""

import numpy as np
import pytest
from scipy import stats

from auvbench.statistics import crossed, mcnemar, pairs
from benchmarks.pages import replaced
from benchmarks.statistics import letters, stopping, verdicts
from benchmarks.statistics.__main__ import SECTIONS, main
from benchmarks.statistics.designs import Design, level
from benchmarks.statistics.letters import resolved
from benchmarks.statistics.verdicts import Cell
from benchmarks.statistics.worlds import FAILED, World, of_rate, successes


def test_two_runs_are_tested_by_the_paired_t_test():
    rng = np.random.default_rng(2)
    x, y = rng.gamma(2, 100, size=(2, 1, 50))
    p = pairs(crossed([x, y], bounds=(0.0, 5000.0))).p[0, 1]
    assert p == pytest.approx(stats.ttest_rel(x[0], y[0]).pvalue)


def test_worlds_have_the_rate_that_is_asked_for():
    world, tails = of_rate(0.9, 2.0), of_rate(0.9, 1.0, tails=3)
    assert world.rate() == pytest.approx(0.9)
    rng = np.random.default_rng(7)
    worlds = [world, tails, World(3.25, 0.5, failing=0.3)]
    data = successes(worlds, [2, 2, 2], rng.normal(size=(1500, 50)), rng)
    for x, world in zip(data, worlds, strict=True):
        means = x.mean(axis=(1, 2))
        assert abs(means.mean() - world.rate()) < 4 * means.std() / np.sqrt(1500)
    assert FAILED == 5.0


DESIGNS = (
    Design("rate", 2.0, shape="skew"),
    Design("rate", 1.0, shape="heavy"),
    Design("rate", 0.5, 0.98, failing=0.1),
    Design("par", 0.1, failing=0.1),
    Design("rms", 1.0),
)


@pytest.mark.parametrize("design", DESIGNS, ids=lambda design: design.name)
def test_the_typical_training_of_a_design_is_worth_what_its_controller_is(design):
    """Half of many trainings have a higher mean over many scenarios than the controller, half a lower one."""
    rng = np.random.default_rng(1)
    x, y = design.tables(12, 10, 40, rng)
    gains = x.mean(axis=(0, 3)).reshape(-1) if design.failing == 0 and design.sd == 0 else None
    assert gains is None
    # Means over 500 scenarios differ from those over all; many trainings of several sets of scenarios average that out.
    above = (x.mean(axis=3) > y.mean(axis=3)).mean(axis=(1, 2))
    assert abs(above.mean() - 0.5) < 4 * above.std() / np.sqrt(12) + 0.02


def test_a_level_has_the_rate_over_scenarios():
    rng = np.random.default_rng(0)
    hard = rng.normal(size=200_000)
    assert (1 / (1 + np.exp(-(level(0.9) + hard)))).mean() == pytest.approx(0.9, abs=2e-3)


def test_controllers_among_all_pairs_are_tested_by_mcnemar():
    rng = np.random.default_rng(3)
    x, y = (rng.random((2, 6, 1, 80)) < np.array([0.9, 0.7])[:, None, None, None]).astype(float)
    p = [
        float(mcnemar((a * (1 - b)).sum(), (b * (1 - a)).sum()))
        for a, b in zip(x[:, 0], y[:, 0], strict=True)
    ]
    assert resolved(x, y, 0.01).tolist() == [value < 0.01 for value in p]


TABLES = 60


@pytest.mark.slow
@pytest.mark.parametrize("design", DESIGNS, ids=lambda design: design.name)
def test_false_verdicts_are_rare(design):
    """The quick version of `make statistics`: few tables, loose limits."""
    for cell in verdicts.false_verdicts(design, TABLES)[:8]:
        assert cell.share / 100 <= 0.05 + 4 * np.sqrt(0.05 * 0.95 / TABLES)


@pytest.mark.slow
def test_true_differences_are_found():
    found = verdicts.power(verdicts.APART[0], TABLES)
    assert found[2].share > 85  # alone, ten trainings
    assert found[6].share > 60  # in a table of five
    assert max(cell.share for cell in verdicts.equivalent(verdicts.AT_MARGIN[0], TABLES, 2.0)) <= 10
    assert verdicts.equivalent(verdicts.EQUAL[2], TABLES)[2].share > 95


@pytest.mark.slow
def test_trainings_on_one_side_by_more_than_the_scenarios_error_are_decided():
    for design in (verdicts.APART[1], verdicts.DESIGNS[1]):
        assert max(cell.share for cell in verdicts.undecided(design, 20)) == 0


@pytest.mark.slow
def test_learners_against_a_learner_are_rarely_falsely_apart():
    found = verdicts.of_learners(*verdicts.PAIRS[1], TABLES)
    assert max(found.values()) <= 5 + 400 * np.sqrt(0.05 * 0.95 / TABLES)


@pytest.mark.slow
@pytest.mark.parametrize("place", range(7))
def test_false_letters_are_rare(place):
    found = letters.false_letters(letters.equal(0.9, 10)[place], TABLES, seed=1)
    assert found <= 0.05 + 4 * np.sqrt(0.05 * 0.95 / TABLES)


@pytest.mark.slow
def test_looking_again_finds_more_than_looking_once():
    found = stopping.found(300)
    assert found["20"] <= 0.08 < 0.0 + found["5, 6, 7, ... 20 seeds"]


def test_a_line_is_within_its_limit_but_for_the_error_of_the_simulation():
    assert Cell(5.0, 5.0, trials=500).within
    assert Cell(6.5, 5.0, trials=500).within
    assert not Cell(7.5, 5.0, trials=500).within
    assert not Cell(88.0, 94.0, True, 500).within
    assert Cell(93.0, 94.0, True, 500).within
    assert Cell(99.0).within


def test_the_page_keeps_everything_but_the_measured_tables():
    page = "a\n<!-- measured: x -->\nold\n<!-- end -->\nb\n<!-- measured: y -->\n<!-- end -->\n"
    assert replaced(page, "x", "new") == page.replace("old", "new")
    with pytest.raises(ValueError, match="no <!-- measured: z -->"):
        replaced(page, "z", "new")


def test_a_line_beyond_its_limit_is_named_and_is_exit_code_1(monkeypatch, tmp_path, capsys):
    from benchmarks.statistics import __main__ as program

    page = tmp_path / "statistics-appendix.md"
    page.write_text("<!-- measured: false verdicts -->\n<!-- end -->\n")
    monkeypatch.setattr(program, "DOCS", tmp_path)
    for within, code in (("yes", 0), ("**no**", 1)):
        monkeypatch.setitem(
            SECTIONS, "false verdicts", lambda n, within=within: f"| RMS | 9 | 5 | {within} |"
        )
        assert main(["--replications", "2", "false verdicts"]) == code
        assert ("not within its limit: false verdicts: | RMS | 9" in capsys.readouterr().out) == bool(code)
        assert within in page.read_text()
