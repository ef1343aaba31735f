"""The main table in each format: the same cells, escaped, and never a zero for a number that does not exist."""

import csv as csv_module
import io
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from auvbench.analysis.load import agents, load
from auvbench.analysis.measures import to_rank_by
from auvbench.analysis.ranking import rank
from auvbench.analysis.records import Against, Agent, Finding, Needed, Problem, Ranking, Row
from auvbench.analysis.score import Scored, Scores
from auvbench.reporting import tables
from auvbench.reporting.tables.appendix import ranks_table, score_table
from auvbench.reporting.tables.main import cautions, main_table, needed_text, notes
from auvbench.reporting.tables.table import Cell, Heading, Line, Table
from auvbench.reporting.tables.terminal import TableView
from auvbench.reporting.write import findings_in_markdown
from auvbench.statistics.intervals import Estimate
from auvbench.statistics.reliability import Reliability
from tests.paper import compile_article, needs_pdflatex
from tests.synthetic import write_experiment

PROBLEMS = tuple(Problem(f"sac_{i}", "failed", '100% <broken> & {lost} #1 a|b ~ ^ \\ "x"') for i in range(9))


@pytest.fixture(scope="module")
def grouped(tmp_path_factory: pytest.TempPathFactory) -> list[Agent]:
    root = tmp_path_factory.mktemp("runs") / "grid"
    write_experiment(
        root,
        algorithms=("ppo", "sac", "pid", "random"),
        seeds=tuple(range(6)),
        episodes=20,
        train_episodes=10,
    )
    return agents(load([root])[0])[0]


@pytest.fixture(scope="module")
def ranking(grouped: list[Agent]) -> Ranking:
    return rank(grouped, problems=PROBLEMS)


def on_screen(ranking: Ranking, width: int) -> str:
    console = Console(width=width, file=io.StringIO(), record=True)
    console.print(tables.terminal(ranking))
    return console.export_text()


def relabelled(ranking: Ranking, change: str) -> Ranking:
    """The ranking with something behind each label."""
    rows = tuple(replace(row, label=f"{row.label}{change}") for row in ranking.rows)
    primary = ranking.primary
    assert primary is not None
    against = tuple(replace(c, agent=f"{c.agent}{change}") for c in primary.comparisons)
    primary = replace(primary, baseline=f"{primary.baseline}{change}", comparisons=against)
    return replace(ranking, rows=rows, primary=primary)


def awkward(ranking: Ranking) -> Ranking:
    """The ranking with labels that every format would misread."""
    return relabelled(ranking, " a_b & 50% #{x} <|> ~^\\ $")


def cells(ranking: Ranking) -> dict[str, Mapping[str, str]]:
    """The main table by agent and heading."""
    table = main_table(ranking)
    titles = [heading.title for heading in table.headings]
    return {
        line.cells[0].value: dict(zip(titles, (cell.text for cell in line.cells), strict=True))
        for line in table.lines
    }


def test_the_columns_of_the_main_table(ranking: Ranking) -> None:
    titles = [heading.title for heading in main_table(ranking).headings]
    assert titles == ["agent", "budget", "success", "from PID", "result", "not behind PID", "energy"]
    by_time = [h.title for h in main_table(replace(ranking, rank_by="par1_steps")).headings]
    assert by_time == [
        "agent",
        "budget",
        "PAR-1 steps",
        "from PID",
        "result",
        "not behind PID",
        "success",
        "energy",
    ]


def test_the_baseline_has_no_difference_and_controllers_no_budget(ranking: Ranking) -> None:
    shown = cells(ranking)
    assert shown["PID"]["result"] == "baseline"
    assert shown["PID"]["from PID"] == shown["PID"]["budget"] == shown["PID"]["not behind PID"] == "–"
    assert shown["random"]["result"].startswith("▼ behind")
    assert shown["random"]["not behind PID"] == "–"
    assert re.fullmatch(r"\d of 6 \[\d+, \d+\]", shown["SAC"]["not behind PID"])
    assert shown["SAC"]["budget"] != "–"
    assert ranking.primary is not None
    assert {line.verdict for line in main_table(ranking).lines} == {
        "baseline",
        *(c.verdict for c in ranking.primary.comparisons),
    }


def test_a_heading_names_no_long_baseline(ranking: Ranking) -> None:
    titles = [h.title for h in main_table(relabelled(ranking, ", trained at 25 Hz with sign=both")).headings]
    assert {"difference", "not behind"} <= set(titles)
    assert not any("trained at" in title for title in titles)


def test_one_training_has_no_difference(grouped: list[Agent]) -> None:
    def one(agent: Agent) -> Agent:
        metrics = {name: values[:1] for name, values in agent.metrics.items()}
        return replace(agent, runs=agent.runs[:1], outcome=agent.outcome[:1], metrics=metrics)

    shown = cells(rank([one(agent) if agent.label == "SAC" else agent for agent in grouped]))
    assert shown["SAC †"]["from PID"] == "–"
    assert shown["SAC †"]["result"] == "○ open"
    assert shown["PPO"]["from PID"] != "–"


def test_what_decides_an_open_comparison() -> None:
    assert needed_text(None) == ""
    assert needed_text(Needed("trainings", 12)) == "(about 12 trainings would decide)"
    assert needed_text(Needed("episodes", None)) == "(more than 100000 episodes would decide)"


def test_a_remark_below_a_verdict_is_folded_and_an_interval_is_not() -> None:
    cells = (
        Cell("PPO"),
        Cell("○ open", "(about 104 trainings would decide)"),
        Cell("0.1", "[-100.5, 100.5]"),
    )
    table = Table(tuple(map(Heading, ("agent", "result", "difference"))), (Line(cells),))
    console = Console(width=60, file=io.StringIO(), force_terminal=False)
    console.print(TableView(table))
    assert isinstance(console.file, io.StringIO)
    shown = console.file.getvalue()
    for words in ("(about 104", "trainings", "would decide)", "[-100.5, 100.5]"):
        assert words in shown
    assert "104 trainings" not in shown


@pytest.mark.parametrize("width", [60, 80, 120, 250])
def test_terminal_fits_and_keeps_what_matters_most(ranking: Ranking, width: int) -> None:
    text = on_screen(ranking, width)
    assert max(map(len, text.splitlines())) <= width
    for row in ranking.rows:
        assert row.label in text
    assert "result" in text
    assert "▼ behind" in text
    assert ("Not shown, because the terminal is too narrow" in text) == (width < 120)
    assert "not behind" in text
    assert f"of {len(ranking.rows[0].seeds)}" in text
    assert "failed (9)" in text
    assert "and 3 more" in text


def test_scores_of_many_tasks_keep_their_agents_on_a_narrow_terminal() -> None:
    titles = ("waypoint", "station keeping", "trajectory tracking", "path following", "docking")
    row = Scored("PPO added to PID", {}, True, (5,) * 5, (1.0,) * 5, Estimate(1.0, 0.9, 1.1, 0.95), ("a",))
    view = TableView(score_table(Scores(titles, (to_rank_by("par1_steps"),) * 5, (row,), 5, "test", 0.95)))
    console = Console(width=70, record=True, file=io.StringIO())
    console.print(view)
    text = console.export_text()
    assert "PPO added to PID" in text
    assert "[0.90, 1.10]" in text
    assert "Not shown, because the terminal is too narrow: trajectory tracking" in text


@pytest.mark.parametrize("width", [70, 80, 140])
@pytest.mark.parametrize("metric", ["mean_energy_J", "mean_command_norm_sum_N", "collision_rate"])
def test_verdict_and_reliability_are_shown_whole_and_so_is_the_measure_where_there_is_room(
    grouped: list[Agent], width: int, metric: str
) -> None:
    by = rank(grouped, rank_by=metric)
    text = on_screen(by, width)
    assert max(map(len, text.splitlines())) <= width
    for line in main_table(by).lines:
        for cell in line.cells[3 - (width >= 80) : 6]:
            assert cell.value in text
            folded = [cell.more] if cell.more.startswith("[") else cell.more.split()
            assert all(part in text for part in folded), cell
    assert "…" not in text


def test_a_long_label_leaves_room_for_the_result(ranking: Ranking) -> None:
    text = on_screen(relabelled(ranking, " K=40, trained at 25 Hz with disturbance=moderate"), 80)
    assert max(map(len, text.splitlines())) <= 80
    assert "▼ behind" in text


def test_what_does_not_exist_is_a_dash(grouped: list[Agent]) -> None:
    table = main_table(replace(rank(grouped), columns=("mean_time_to_goal_s",)))
    random = next(line for line in table.lines if line.cells[0].value == "random")
    assert random.cells[-1].value == "–"
    assert table.headings[-1].title == "time to goal"


def test_markdown_is_one_rectangle_and_lists_every_problem(ranking: Ranking) -> None:
    for case in (ranking, awkward(ranking)):
        text = tables.markdown(case)
        lines = [line for line in text.splitlines() if line.startswith("|")]
        assert len(lines) == 2 + len(case.rows)
        assert len({len(re.findall(r"(?<!\\)\|", line)) for line in lines}) == 1
        assert text.count("\n- sac") == len(PROBLEMS)
    assert "**Failed (9)**" in text
    assert "&lt;broken&gt;" in text


def test_notes_say_what_the_numbers_are(ranking: Ranking) -> None:
    text = " ".join(notes(ranking))
    assert f"scenarios {ranking.fingerprint}: 20 episodes per training seed" in text
    assert "Training seeds: 0, 1, 2, 3, 4, 5." in text
    assert "hold together with 95 %; within ±2 points equivalent" in text
    assert "†" not in text
    single = tuple(
        replace(row, seeds=row.seeds[:1], succeeded=1, compared=not row.trained) for row in ranking.rows
    )
    one = replace(ranking, rows=single)
    assert "† one training seed" in " ".join(notes(one))
    assert "SAC †" in tables.markdown(one)
    assert "PID †" not in tables.markdown(one)
    untrained = replace(ranking, rows=tuple(replace(row, trained=False) for row in ranking.rows))
    assert "Training seeds: none, no agent learns." in " ".join(notes(untrained))


def test_cautions_stand_where_the_numbers_do(ranking: Ranking) -> None:
    def told(**changes: object) -> str:
        return " ".join(cautions(replace(ranking, **changes)))

    def rated(value: float) -> tuple[Row, ...]:
        e = Estimate(value, value - 0.01, min(value + 0.01, 1.0))
        return tuple(replace(row, estimates={"success_rate": e}) for row in ranking.rows)

    assert told(rows=rated(0.5)) == ""
    for near in (0.98, 1.0, 0.03):
        assert "80 to 90 % of simulated experiments" in told(rows=rated(near))
    assert told(rows=tuple(replace(row, seeds=tuple(range(20))) for row in rated(0.98))) == ""
    assert "including failures" in told(rows=rated(0.5), rank_by="mean_energy_J")
    assert told(rows=rated(0.5), rank_by="par1_steps") == ""


def test_csv_reads_back_bit_for_bit(ranking: Ranking) -> None:
    rows = list(csv_module.DictReader(io.StringIO(tables.csv(ranking))))
    assert [row["agent"] for row in rows] == [row.label for row in ranking.rows]
    assert ranking.primary is not None
    for read, row in zip(rows, ranking.rows, strict=True):
        assert read["algo"] == row.key["algo"]
        assert read["runs"].split() == list(row.run_ids)
        estimate = row.estimates["mean_deviation_mean_m"]
        assert float(read["mean_deviation_mean_m"]) == estimate.value
        assert float(read["mean_deviation_mean_m_low"]) == estimate.low
        assert read["baseline"] == "PID"
        assert float(read["margin"]) == ranking.primary.margin
        against = ranking.primary.of(row.label)
        assert read["verdict"] == (against.verdict if against else "baseline")
        if against:
            ends = [float(read[f"difference{end}"]) for end in ("", "_low", "_high")]
            d = against.difference
            assert ends == [d.value, d.low, d.high]
    random = next(row for row in rows if row["algo"] == "random")
    assert random["mean_time_to_goal_s"] == ""
    pairs = list(csv_module.DictReader(io.StringIO(tables.comparisons_csv(ranking.comparisons))))
    assert float(pairs[0]["difference_low"]) == ranking.comparisons[0].difference.low
    assert tables.comparisons_csv(()) == ""


def test_columns_on_request_stand_in_every_format(ranking: Ranking) -> None:
    other = replace(ranking, columns=("mean_path_efficiency", "collision_rate"))
    assert "path efficiency" in tables.markdown(other)
    assert "collision (%)" in tables.markdown(other)
    assert "path efficiency" in on_screen(other, 200)
    assert "path efficiency" in tables.latex(other)


def test_five_findings_are_shown() -> None:
    found = [Finding("effect", f"Finding {i}.", basis="a test") for i in range(7)]

    def shown() -> str:
        console = Console(width=100, file=io.StringIO(), record=True)
        console.print(tables.findings_terminal(found))
        return console.export_text()

    assert [f"Finding {i}." in shown() for i in range(7)] == [True] * 5 + [False] * 2
    assert "2 more in the written report" in shown()
    head, _, folded = findings_in_markdown(found).partition("<details><summary>2 more</summary>")
    assert (head.count("* Finding"), folded.count("* Finding")) == (5, 2)


def test_latex_is_balanced_and_escaped(ranking: Ranking) -> None:
    text = tables.latex(awkward(ranking))
    assert text.count(r"\begin{table}") == text.count(r"\end{table}") == 1
    assert text.count("{") - text.count(r"\{") == text.count("}") - text.count(r"\}")
    body = [line for line in text.splitlines() if line.endswith(r"\\[-2pt]")]
    assert len(body) == len(ranking.rows)
    for line in body:
        plain = re.sub(r"\$\\[a-z]+\$", "", line.replace(r"\textasciitilde", ""))
        assert not re.search(r"(?<!\\)[%#$~^<>|]", plain)
    assert r"$\blacktriangledown$ behind" in text


@needs_pdflatex
def test_latex_compiles(ranking: Ranking, tmp_path: Path) -> None:
    compile_article(tmp_path, tables.latex(awkward(ranking)))


@needs_pdflatex
def test_latex_fits_an_article(ranking: Ranking, tmp_path: Path) -> None:
    text = tables.latex(relabelled(ranking, " K=100 25 Hz"))
    assert "Overfull" not in compile_article(tmp_path, text)


def test_the_notes_say_what_a_verdict_of_a_learner_is_and_what_its_seeds_leave_open(ranking: Ranking) -> None:
    text = " ".join(notes(ranking))
    assert text.count("Typical training (half of all trainings are better, half worse) less PID") == 1
    assert "Not behind: trainings at most 2 points worse than PID on these scenarios" in text
    primary = ranking.primary
    assert primary is not None
    held = Reliability(10, 10, 0.69, 1.0, 0.2589, 0.0123)
    ahead = Against("SAC", Estimate(0.1, 0.05, 0.2), "ahead", None, 10, 8, held)
    few = Against("PPO", Estimate(0.1, 0.05, 0.2), "ahead", None, 5, 8, replace(held, mean_turns=None))
    told = " ".join(notes(replace(ranking, primary=replace(primary, comparisons=(ahead, few)))))
    assert "behind (95 %, one-sided): 10 trainings, none of them behind, 26 %." in told
    assert "would be lost if this share of trainings failed in every episode: SAC 1.2 %." in told
    assert (
        "* fewer than 8 trainings: the verdict assumes that trainings cluster around the typical one." in told
    )
    open_ = replace(few, verdict="open")
    told = " ".join(notes(replace(ranking, primary=replace(primary, comparisons=(ahead, open_)))))
    assert "8 trainings that are all clearly better, or all clearly worse, than PID would decide." in told
    controllers = replace(ranking, primary=replace(primary, comparisons=()))
    assert "ypical training" not in " ".join(notes(controllers))


def test_no_verdict_of_a_learner_goes_without_its_reliability(ranking: Ranking) -> None:
    """Terminal, Markdown, LaTeX, CSV and the table of ranks, with the star and what an open one lacks."""
    primary = ranking.primary
    assert primary is not None
    held = Reliability(19, 20, 0.751, 0.9987, 0.216, 0.01)
    made = {
        "SAC": Against("SAC", Estimate(-0.1, -0.2, -0.05), "behind", None, 5, 8, held),
        "PPO": Against("PPO", Estimate(0.1, -0.2, 0.25), "open", None, 5, 8, held),
    }
    found = tuple(made.get(c.agent, c) for c in primary.comparisons)
    shown = replace(ranking, primary=replace(primary, comparisons=found))
    assert cells(shown)["SAC"]["result"] == "▼ behind*"
    assert cells(shown)["PPO"]["result"] == "○ open (5 trainings; 8 needed)"
    for text in (on_screen(shown, 80), tables.markdown(shown), tables.latex(shown)):
        assert text.count("19 of 20") == 2
        assert "behind*" in text.replace("\\", "")
        assert "75, 100" in text
    assert "19 of 20" in " ".join(cell.text for line in ranks_table(shown).lines for cell in line.cells)
    rows = {row["agent"]: row for row in csv_module.DictReader(io.StringIO(tables.csv(shown)))}
    sac = rows["SAC"]
    assert (sac["verdict"], sac["trainings"], sac["enough"], sac["not_behind"]) == ("behind*", "5", "8", "19")
    assert (float(sac["not_behind_low"]), float(sac["failing_excluded"])) == (0.751, 0.216)
    assert rows["random"]["not_behind"] == rows["random"]["trainings"] == ""


def test_pairs_in_the_csv_have_the_reliability_of_both_learners(ranking: Ranking) -> None:
    rows = list(csv_module.DictReader(io.StringIO(tables.comparisons_csv(ranking.comparisons))))
    learner = next(row for row in rows if {row["first"], row["second"]} == {"SAC", "PPO"})
    assert int(learner["first_not_behind"]) + int(learner["second_not_behind"]) >= 6
    controllers = next(row for row in rows if {row["first"], row["second"]} == {"PID", "random"})
    assert (
        controllers["first_not_behind"] == controllers["second_not_behind"] == controllers["trainings"] == ""
    )


def test_trainings_that_succeeded_are_counted_where_nothing_is_compared(ranking: Ranking) -> None:
    row = replace(ranking.rows[0], seeds=(0, 1, 2, 3, 4), succeeded=5)
    shown = cells(replace(ranking, rows=(row, *ranking.rows[1:]), primary=None))
    assert shown[row.label]["trainings that succeeded"] == "5 of 5 [57, 100]"
