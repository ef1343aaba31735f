"""Each shape of the table says the same, escapes what its format takes for markup, and never prints a zero for nothing."""

import csv as csv_module
import io
import re
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from auvbench.analysis.load import agents, load
from auvbench.analysis.model import Problem, Ranking, Row
from auvbench.reporting import tables
from auvbench.reporting.tables import columns as columns_of_tables
from auvbench.reporting.tables.latex import fitting
from auvbench.reporting.tables.notes import cautions
from auvbench.statistics.estimate import Estimate
from tests.paper import compile_article, needs_pdflatex
from tests.plain_ranking import plain_ranking
from tests.synthetic import write_experiment

PROBLEMS = tuple(Problem(f"sac_{i}", "failed", '100% <broken> & {lost} #1 a|b ~ ^ \\ "x"') for i in range(9))


@pytest.fixture(scope="module")
def ranking(tmp_path_factory: pytest.TempPathFactory) -> Ranking:
    root = tmp_path_factory.mktemp("runs") / "grid"
    write_experiment(
        root, algorithms=("ppo", "sac", "pid", "random"), seeds=(0, 1), episodes=20, train_episodes=10
    )
    return plain_ranking(agents(load([root])[0])[0], PROBLEMS, baseline="PID")


def on_screen(ranking: Ranking, width: int) -> str:
    console = Console(width=width, file=io.StringIO(), record=True)
    console.print(tables.terminal(ranking))
    return console.export_text()


def awkward(ranking: Ranking) -> Ranking:
    """The ranking with labels that every format would misread."""
    rows = tuple(replace(row, label=f"{row.label} a_b & 50% #{{x}} <|> ~^\\ $") for row in ranking.rows)
    return replace(ranking, rows=rows)


@pytest.mark.parametrize("width", [60, 80, 120, 250])
def test_terminal_fits_and_keeps_what_matters_most(ranking: Ranking, width: int) -> None:
    text = on_screen(ranking, width)
    assert max(map(len, text.splitlines())) <= width
    for row in ranking.rows:
        assert row.label in text
    assert "success" in text
    assert ("sum of norm u" in text.splitlines()[0]) == (width == 250)
    assert ("Not shown for want of width" in text) == (width < 250)
    assert "failed (9)" in text
    assert "and 3 more" in text


@pytest.mark.parametrize("width", [32, 40, 60, 80, 140])
@pytest.mark.parametrize("metric", ["mean_energy_J", "mean_command_norm_sum_N", "collision_rate"])
def test_what_a_table_is_ranked_by_is_shown_whole_at_any_width(
    ranking: Ranking, width: int, metric: str
) -> None:
    text = on_screen(replace(ranking, rank_by=metric), width)
    assert max(map(len, text.splitlines())) <= width
    column = next(column for column in columns_of_tables.COLUMNS if column.metric == metric)
    assert column.title in text.splitlines()[0]
    for row in ranking.rows:
        for part in columns_of_tables.cell(row, column):
            assert part in text
    assert "…" not in text


def test_what_does_not_exist_is_a_dash(ranking: Ranking) -> None:
    random = next(row for row in ranking.rows if row.label == "random")
    assert random.estimates["success_rate"].value == 0
    line = next(x for x in tables.markdown(ranking).splitlines() if "random" in x)
    assert [cell.strip() for cell in line.split("|")][9] == "–"  # time to goal
    absent = tuple(
        replace(row, estimates={"success_rate": row.estimates["success_rate"]}) for row in ranking.rows
    )
    text = tables.markdown(replace(ranking, rows=(ranking.rows[0], *absent[1:])))
    assert [cell.strip() for cell in text.splitlines()[3].split("|")][6:9] == ["–", "–", "–"]


def test_markdown_is_one_rectangle_and_lists_every_problem(ranking: Ranking) -> None:
    for case in (ranking, awkward(ranking)):
        text = tables.markdown(case)
        lines = [line for line in text.splitlines() if line.startswith("|")]
        assert len(lines) == 2 + len(case.rows)
        assert len({len(re.findall(r"(?<!\\)\|", line)) for line in lines}) == 1
        assert text.count("\n- sac") == len(PROBLEMS)
    assert "**Failed (9)**" in text
    assert "&lt;broken&gt;" in text


def test_notes_say_what_the_numbers_cover(ranking: Ranking) -> None:
    text = tables.markdown(ranking)
    assert "Protocol test, condition nominal" in text
    assert f"scenarios {ranking.fingerprint}: 20 episodes per training seed" in text
    assert "Brackets are 95 % intervals".replace("[", r"\[") in text
    assert "†" not in text
    single = tuple(
        replace(row, seeds=row.seeds[:1], compared=not row.trained, group="") for row in ranking.rows
    )
    text = tables.markdown(
        replace(ranking, rows=single, more_seeds="auvbench train -m algo=sac seed=0,1,2,3,4")
    )
    assert (
        "† one training seed: the row describes this policy, its interval covers test episodes only" in text
    )
    assert "it is not compared, because another training may end elsewhere" in text
    assert "More seeds: auvbench train -m algo=sac seed=0,1,2,3,4" in text
    assert re.search(r"\| – \| SAC † \| 1 \|", text)
    assert "PID †" not in text


def test_cautions_stand_where_the_numbers_do(ranking: Ranking) -> None:
    def told(**changes: object) -> str:
        return " ".join(cautions(replace(ranking, **changes)))

    def rated(value: float) -> tuple[Row, ...]:
        e = Estimate(value, value - 0.01, min(value + 0.01, 1.0))
        return tuple(replace(row, estimates={"success_rate": e}) for row in ranking.rows)

    assert told(rows=rated(0.5)) == ""
    for near in (0.98, 1.0, 0.03):
        assert "held in 80 to 88 % of simulated experiments" in told(rows=rated(near))
    assert told(rows=tuple(replace(row, seeds=tuple(range(20))) for row in rated(0.98))) == ""
    pair = replace(ranking.comparisons[0], first="SAC", second="PPO", verdict="equivalent")
    said = told(rows=rated(0.5), comparisons=(pair,))
    assert "what befalls 3 of 10 trainings is in none of 2 seeds with a probability of 49 %" in said
    assert "however they ended" in told(rows=rated(0.5), rank_by="mean_energy_J")
    assert told(rows=rated(0.5), rank_by="par1_steps") == ""


def test_a_controller_that_does_not_learn_has_no_seeds_to_be_unsure_of(ranking: Ranking) -> None:
    rows = tuple(replace(row, trained=row.label not in ("PID", "random")) for row in ranking.rows)
    text = tables.markdown(replace(ranking, rows=rows))
    assert re.search(r"\| PID \| – \|", text)
    assert "Training seeds: 0, 1." in text
    assert "The intervals cover training seeds and test episodes." in text
    assert "†" not in text
    untrained = replace(ranking, rows=tuple(replace(row, trained=False) for row in rows))
    assert "Training seeds: none, no agent learns." in tables.markdown(untrained)
    one = tuple(
        replace(row, seeds=row.seeds[:1], compared=False) if row.label == "PPO" else row for row in rows
    )
    text = tables.markdown(replace(ranking, rows=one))
    assert "| PPO † | 1 |" in text
    assert "Seeds –: does not learn" in text


def test_a_long_label_leaves_room_for_what_is_ranked(ranking: Ranking) -> None:
    rows = tuple(
        replace(row, label=f"{row.label} K=40 25 Hz disturbance=moderate 300k steps") for row in ranking.rows
    )
    text = on_screen(replace(ranking, rows=rows), 80)
    assert text.splitlines()[0].split() == ["success", "collision"]


def test_runs_that_are_pooled_are_not_called_seeds(ranking: Ranking) -> None:
    rows = tuple(replace(row, seeds=(0, 0, 1, 1)) if row.label == "PPO" else row for row in ranking.rows)
    pooled = replace(ranking, rows=rows)
    text = on_screen(pooled, 140)
    assert "4 runs" in text
    assert "0, 0, 1, 1" not in text
    assert "(PPO) pools what --group-by left out" in text
    assert "| 4 runs |" in tables.markdown(pooled)


def test_letters_that_nobody_can_read_give_way_to_the_rank_intervals(ranking: Ranking) -> None:
    rows = tuple(replace(row, group="abcdefghi"[i:]) for i, row in enumerate(ranking.rows))
    many = replace(ranking, rows=rows)
    for text in (on_screen(many, 100), tables.markdown(many), tables.latex(many)):
        assert "group |" not in text
        assert "abcdefghi" not in text
        assert "rank intervals do not overlap" in " ".join(text.split())
    for text in (on_screen(ranking, 100), tables.markdown(ranking), tables.latex(ranking)):
        assert "share a group letter" in " ".join(text.split())
    lines = [line for line in tables.markdown(many).splitlines() if line.startswith("|")]
    assert len({line.count("|") for line in lines}) == 1
    assert "---" in lines[1].split("|")[2]
    assert lines[1].split("|")[3].strip() == "---:"
    printed = tables.latex(many).splitlines()
    body = [line for line in printed if line.endswith(r"\\[-2pt]")]
    headings = [line for line in printed if line.startswith("rank & agent & seeds &")]
    assert {line.count("&") for line in headings} == {len(re.findall(r"(?<!\\)&", line)) for line in body}
    assert next(csv_module.DictReader(io.StringIO(tables.csv(many))))["group"] == "abcdefghi"


def test_csv_reads_back_bit_for_bit(ranking: Ranking) -> None:
    rows = list(csv_module.DictReader(io.StringIO(tables.csv(ranking))))
    assert [row["agent"] for row in rows] == [row.label for row in ranking.rows]
    for read, row in zip(rows, ranking.rows, strict=True):
        assert read["algo"] == row.key["algo"]
        assert read["runs"].split() == list(row.run_ids)
        estimate = row.estimates["mean_deviation_mean_m"]
        assert float(read["mean_deviation_mean_m"]) == estimate.value
        assert float(read["mean_deviation_mean_m_low"]) == estimate.low
    random = next(row for row in rows if row["algo"] == "random")
    assert random["mean_time_to_goal_s"] == ""
    comparisons = list(csv_module.DictReader(io.StringIO(tables.comparisons_csv(ranking.comparisons))))
    assert {row["second"] for row in comparisons} == {"PID"}
    assert float(comparisons[0]["difference_low"]) == -0.004


def test_a_table_ranked_by_something_else_shows_it(ranking: Ranking) -> None:
    other = replace(ranking, rank_by="mean_path_efficiency")
    assert "mean path efficiency" in tables.markdown(other).splitlines()[0]
    assert "mean path efficiency" in on_screen(other, 80)
    assert r"mean\_path\_efficiency" in tables.latex(other)


def test_comparisons(ranking: Ranking) -> None:
    line = tables.comparisons_markdown(ranking.comparisons).splitlines()[2]
    assert "+1.3 points [-0.4, 3.1] | 0.060 | undecided | 51.0 %" in line
    assert tables.comparisons_markdown(()) == ""


@pytest.mark.parametrize("width", [80, 140])
def test_comparisons_fit_a_terminal_without_a_cut_word(ranking: Ranking, width: int) -> None:
    labels = ["SAC K=100 disturbance=moderate", "PPO K=1 25 Hz"]
    console = Console(width=width, file=io.StringIO(), record=True)
    against = [replace(ranking.comparisons[0], first=label, second="PID") for label in labels]
    console.print(tables.comparisons_terminal(against))
    console.print(tables.comparisons_terminal([against[0], replace(against[0], second="random")]))
    text = console.export_text()
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= width
    metric = against[0].metric
    assert text.startswith(f"paired differences in {metric} from PID")
    assert f"paired differences in {metric} \n" in re.sub(" +", " ", text)  # then the column says from whom
    assert "random" in text


def test_latex_is_balanced_and_escaped(ranking: Ranking) -> None:
    text = tables.latex(awkward(ranking))
    assert text.count(r"\begin{table}") == text.count(r"\end{table}") > 2
    assert text.count("{") - text.count(r"\{") == text.count("}") - text.count(r"\}")
    body = [line for line in text.splitlines() if line.endswith(r"\\[-2pt]")]
    assert len(body) == text.count(r"\begin{table}") * len(ranking.rows)
    for line in body:
        assert not re.search(r"(?<!\\)[%#$~^<>|]", line.replace(r"\textasciitilde", ""))


def test_latex_leaves_columns_that_do_not_fit_to_another_float(ranking: Ranking) -> None:
    lead = ("rank", "group", "agent", "seeds")
    columns = columns_of_tables.OUTCOMES + columns_of_tables.MOTION
    rows = [replace(row, label=f"{row.label} K=100 25 Hz") for row in ranking.rows]
    wide = fitting(replace(ranking, rows=tuple(rows)), lead, columns)
    assert [column for part in wide for column in part] == list(columns)
    assert 2 < len(wide) < len(columns)
    longer = replace(ranking, rows=tuple(replace(row, label="long " * 30) for row in rows))
    assert [len(part) for part in fitting(longer, lead, columns)] == [1] * len(columns)


def test_latex_of_many_agents_continues_in_another_float(ranking: Ranking) -> None:
    rows = tuple(replace(ranking.rows[0], label=f"agent {i}") for i in range(60))
    text = tables.latex(replace(ranking, rows=rows))
    assert text.count(r"\begin{table}") % 3 == 0
    assert 3 * text.count("(continued)") == 2 * text.count(r"\begin{table}")


@needs_pdflatex
def test_latex_compiles(ranking: Ranking, tmp_path: Path) -> None:
    rows = tuple(
        replace(row, estimates=row.estimates | {"mean_steps": Estimate(1.0, 0.5, 1.5)})
        for row in ranking.rows
    )
    compile_article(tmp_path, tables.latex(awkward(replace(ranking, rows=rows))))


@needs_pdflatex
def test_latex_fits_an_article(ranking: Ranking, tmp_path: Path) -> None:
    rows = tuple(replace(row, label=f"{row.label} K=100 25 Hz") for row in ranking.rows)
    assert "Overfull" not in compile_article(tmp_path, tables.latex(replace(ranking, rows=rows)))
