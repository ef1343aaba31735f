"""Figures are drawn where there are data, left out where there are none, and say what they show."""

import json
import math
import shutil
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from auvbench.analysis.conditions import results
from auvbench.analysis.formatting import rounded
from auvbench.analysis.load import agents, load
from auvbench.analysis.ranking import rank
from auvbench.registry import resolve
from auvbench.reporting.figures import FIGURES, draw_all, style, training
from auvbench.reporting.figures.difference import LOOKS
from auvbench.reporting.figures.looks import colour_of
from auvbench.reporting.figures.scene import Drawing, Scene, scene, wants_symlog
from auvbench.statistics import Estimate
from tests.synthetic import FREQUENCY_SWEEP, GAZEBO, ROBUSTNESS, TRANSFER, seal, write_experiment

BY_CONDITION = {
    "robustness": ROBUSTNESS,
    "frequency_sweep": FREQUENCY_SWEEP,
    "transfer": TRANSFER,
    "gazebo": GAZEBO,
}


def build(root: Path, baseline: str | None = None, **grid: object) -> Scene:
    write_experiment(root, **grid)  # type: ignore[arg-type]
    found = agents(load([root])[0])[0]
    return scene(found, rank(found, baseline=baseline))


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return build(
        tmp_path_factory.mktemp("runs") / "small",
        algorithms=("ppo", "sac", "pid"),
        reward_k=(1, 100),
        seeds=(0, 1),
        episodes=25,
        train_episodes=120,
        frequencies=(25,),
        protocols={"test": ("nominal",), **BY_CONDITION},
    )


def draw(name: str, drawn_from: Scene) -> style.Canvas | None:
    with style.styled():
        drawing = resolve(FIGURES[name])(drawn_from)
    return None if drawing is None else drawing.canvas


def only(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """Leave these figures alone to be drawn."""
    for name in FIGURES.keys() - set(names):
        monkeypatch.delitem(FIGURES, name)


@pytest.mark.slow
def test_every_figure_is_written_twice_with_title_and_caption(small: Scene, tmp_path: Path) -> None:
    figures, problems = draw_all(small.agents, small.ranking, tmp_path)
    assert problems == []
    watched = "validation_success"  # needs trainings that were tested on their way
    assert [figure.name for figure in figures] == [name for name in FIGURES if name != watched]
    for figure in figures:
        assert figure.title
        assert len(figure.caption) > 40
        assert figure.png.read_bytes().startswith(b"\x89PNG")
        assert ET.parse(figure.svg).getroot().tag.endswith("svg")
        assert figure.svg.stat().st_size < 600_000


@pytest.mark.slow
def test_a_figure_of_an_earlier_report_goes_when_it_is_not_drawn_again(small: Scene, tmp_path: Path) -> None:
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "training_curves.png").touch()
    (tmp_path / "figures" / "mine.png").touch()
    pid = [agent for agent in small.agents if agent.label == "PID"]
    draw_all(pid, rank(pid), tmp_path)
    names = {path.name for path in (tmp_path / "figures").iterdir()}
    assert "training_curves.png" not in names
    assert {"mine.png", "success_over_time.png"} <= names


def test_a_training_of_a_few_episodes_is_not_drawn(tmp_path: Path) -> None:
    drawn_from = build(tmp_path / "grid", algorithms=("ppo",), seeds=(0,), episodes=5, train_episodes=3)
    for name in ("training_curves", "training_success"):
        assert draw(name, drawn_from) is None


@pytest.mark.parametrize("name", FIGURES)
def test_one_agent_with_one_seed_and_one_episode(name: str, tmp_path: Path) -> None:
    drawn_from = build(tmp_path / "one", algorithms=("pid",), seeds=(0,), episodes=1)
    canvas = draw(name, drawn_from)
    if canvas is not None:
        style.save(canvas, tmp_path / name)
    # What compares agents, and what needs tests during training, has nothing to show.
    comparing = {
        "difference_from_baseline",
        "success_over_grid",
        "success_over_conditions",
        "validation_success",
        "gazebo",
    }
    assert (canvas is None) == (name in comparing or name.startswith("training"))


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in FIGURES if name != "validation_success"])
def test_27_agents_stay_readable(name: str, many: Scene) -> None:
    with style.styled():
        drawing = resolve(FIGURES[name])(many)
        assert drawing is not None
    for ax in drawing.canvas.axes:
        assert len([line for line in ax.lines if len(line.get_xdata()) > 2]) <= 27  # type: ignore[arg-type]
    whole = (
        "difference_from_baseline",
        "success_over_grid",
        "success_over_conditions",
        "training_curves",
        "steps_deviation",
        "gazebo",
    )
    if name not in whole:
        assert "of 27 agents, the best-ranked" in drawing.caption


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    root = tmp_path_factory.mktemp("runs") / "many"
    protocols = {"test": ("nominal",), **BY_CONDITION, "robustness": ("nominal", "current=0.5", "current=1")}
    grid = {"reward_k": (1, 40, 100), "frequencies": (10, 25, 55)}
    return build(
        root,
        algorithms=("ppo", "sac", "ddpg"),
        seeds=(0, 1),
        episodes=20,
        train_episodes=60,
        protocols=protocols,
        **grid,
    )


def test_the_best_eight_differ_in_colour_and_all_27_in_look(many: Scene) -> None:
    looks = colour_of(many.agents)
    assert len({look.colour for look in looks.values()}) == 27


@pytest.mark.slow
def test_few_agents_share_a_panel_and_nine_have_one_each(tmp_path: Path) -> None:
    grid = {"algorithms": ("ppo", "sac", "td3"), "reward_k": (1, 40, 100), "seeds": (0, 1), "episodes": 5}
    nine = build(tmp_path / "nine", train_episodes=60, **grid)
    few = scene(nine.agents[:3], nine.ranking)
    for name, panels in (("training_success", 9), ("training_curves", 18)):
        canvas = draw(name, nine)
        assert canvas is not None
        visible = [ax for ax in canvas.axes if ax.get_visible()]
        assert len(visible) == panels
        titles = [ax.get_title(loc="left") for ax in visible if ax.get_title(loc="left")]
        assert titles == [agent.label for agent in nine.agents]
        for ax in visible:  # one line in colour, with its band; all others grey
            assert len({line.get_color() for line in ax.lines} - {training.GREY}) == 1
            assert len(ax.collections) == 1
        canvas = draw(name, few)
        assert canvas is not None
        assert len(canvas.axes) == panels // 9
        assert len(canvas.axes[0].collections) == 3


def test_success_over_steps_has_a_dot_for_each_seed_and_span(tmp_path: Path) -> None:
    drawn_from = build(tmp_path / "grid", algorithms=("ppo",), seeds=(0, 1, 2, 3), episodes=5)
    canvas = draw("training_success", drawn_from)
    assert canvas is not None
    *dots, line = canvas.axes[0].lines
    assert len(dots) == 4
    y = np.array([dot.get_ydata() for dot in dots])
    assert np.allclose(
        line.get_ydata(), np.sort(y, axis=0)[1:3].mean(axis=0)
    )  # the interquartile mean of four
    frames = [pd.read_csv(run.directory / "train" / "episodes.csv") for run in drawn_from.agents[0].runs]
    last = min(frame["step"].iloc[-1] for frame in frames)
    edges = np.linspace(0, last, y.shape[1] + 1)
    spans = pd.cut(frames[0]["step"][frames[0]["step"] <= last], edges)
    expected = 100 * (frames[0]["outcome"] == "success").groupby(spans, observed=False).mean()
    assert np.allclose(y[0], expected, equal_nan=True)


def test_no_span_is_shorter_than_what_all_environments_need_for_their_longest_episode() -> None:
    """32 environments of which each second episode times out, all together, after 1000 steps."""
    ends = [
        (32 * (1000 * k + at), outcome)
        for k in range(6)
        for at, outcome in ((300, "success"), (1000, "timeout"))
    ]
    frame = pd.DataFrame(
        [
            (step, outcome, steps)
            for step, outcome in ends
            for steps in [1000 if outcome == "timeout" else 300] * 32
        ],
        columns=["step", "outcome", "steps"],
    )
    trained = SimpleNamespace(runs=[SimpleNamespace(config={"algo.n_envs": 32})])
    drawn_from = SimpleNamespace(training=lambda run: frame)
    x, y = training.binned(drawn_from, trained, "success")  # type: ignore[arg-type]
    assert y.tolist() == [[50.0] * 6]  # with 30 spans 100 and 0 in turn, and nothing between
    assert x[0] == 16_000
    alone = SimpleNamespace(runs=[SimpleNamespace(config={"algo.n_envs": 1})])
    assert len(training.binned(drawn_from, alone, "success")[0]) == 30  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_long_label_is_broken_into_lines(tmp_path: Path) -> None:
    grid = {"algorithms": ("ppo", "sac", "td3"), "reward_k": (1, 40), "seeds": (0, 1), "episodes": 5}
    six = build(tmp_path / "six", train_episodes=60, **grid)
    long = "PPO 25 Hz sign=positive 200k steps, and more"
    first = replace(six.agents[0], label=long)
    canvas = draw("training_success", scene([first, *six.agents[1:]], rank([first, *six.agents[1:]])))
    assert canvas is not None
    titles = [ax.get_title(loc="left") for ax in canvas.axes if ax.get_visible()]
    (found,) = (title for title in titles if title.replace("\n", " ") == long)
    assert max(map(len, found.split("\n"))) <= 26


def test_the_interquartile_mean_is_that_of_the_seeds_that_are_there() -> None:
    y = np.array([[1.0, 5.0], [2.0, np.nan], [30.0, 7.0], [4.0, np.nan]])
    assert training.middle(y).tolist() == [3.0, 6.0]
    assert np.isnan(training.middle(np.full((2, 1), np.nan))).all()


def test_the_baseline_is_always_shown(tmp_path: Path) -> None:
    grid = {"reward_k": (1, 40, 100), "frequencies": (10, 25, 55)}
    drawn_from = build(
        tmp_path / "grid",
        "random",
        algorithms=("sac", "random"),
        seeds=(0,),
        episodes=20,
        train_episodes=0,
        **grid,
    )
    assert drawn_from.agents[-1].label == "random"
    assert [agent.label for agent in drawn_from.top(3)][-1] == "random"
    canvas = draw("success_over_time", drawn_from)
    assert canvas is not None
    assert "random" in [text.get_text() for text in canvas.legends[0].get_texts()]


def test_success_over_time_ends_at_the_success_rate(small: Scene) -> None:
    canvas = draw("success_over_time", small)
    assert canvas is not None
    ends = [float(np.asarray(line.get_ydata())[-1]) for line in canvas.axes[0].lines]
    assert ends == pytest.approx([100 * agent.success.mean() for agent in small.agents])


def test_nobody_arrives(tmp_path: Path) -> None:
    drawn_from = build(tmp_path / "grid", algorithms=("random",), seeds=(0,), episodes=4)
    assert not drawn_from.agents[0].success.any()
    assert draw("success_over_time", drawn_from) is None


def test_the_heat_map_shows_the_table(small: Scene) -> None:
    canvas = draw("success_over_grid", small)
    assert canvas is not None
    shown = {text.get_text() for ax in canvas.axes for text in ax.texts}
    for row in small.ranking.rows:
        if row.label != "PID":
            assert rounded(row.estimates["success_rate"], 100)[0] in shown


@pytest.mark.slow
def test_a_training_without_one_finished_episode_is_not_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    only(monkeypatch, "training_curves", "steps_deviation")
    folder = tmp_path / "short"
    for run in write_experiment(folder, algorithms=("ppo", "pid"), seeds=(0,), episodes=12):
        table = run / "train" / "episodes.csv"
        if table.is_file():
            table.write_text(table.read_text().splitlines(keepends=True)[0])
            seal(run / "manifest.json")
    runs, _ = load([folder])
    found, _ = agents(runs)
    drawn, problems = draw_all(found, rank(found), folder / "report")
    assert problems == []
    assert "training_curves" not in {figure.name for figure in drawn}


def test_training_figures_do_without_a_damaged_record(tmp_path: Path) -> None:
    drawn_from = build(tmp_path / "grid", algorithms=("ppo",), seeds=(0, 1), episodes=10, train_episodes=50)
    (drawn_from.agents[0].runs[1].directory / "train" / "episodes.csv").write_text("step\n1\n")
    canvas = draw("training_curves", drawn_from)
    assert canvas is not None
    assert len(canvas.axes[0].lines) == 1


def test_robustness_never_mixes_scenarios(small: Scene, tmp_path: Path) -> None:
    drawn_from = build(
        tmp_path / "grid",
        algorithms=("ppo",),
        seeds=(0, 1),
        episodes=10,
        protocols={"test": ("nominal",), "robustness": ("nominal", "level=calm")},
    )

    def cells() -> np.ndarray:
        canvas = draw("success_over_conditions", drawn_from)
        assert canvas is not None
        return np.asarray(canvas.axes[0].images[0].get_array())[0]

    both = cells()
    path = drawn_from.agents[0].runs[1].directory / "evaluations" / "robustness" / "summary.json"
    seal(path, fingerprint="another")
    first = drawn_from.agents[0].runs[0]
    frame = pd.read_csv(first.directory / "evaluations" / "robustness" / "episodes.csv")
    for cell, condition in zip(cells(), ("nominal", "level=calm"), strict=True):
        won = (frame["outcome"][frame["condition"] == condition] == "success").to_numpy()
        assert cell == pytest.approx(100 * won.mean())
    assert not np.allclose(both, cells())


@pytest.mark.slow
def test_all_agents_stand_under_all_conditions_each_once(small: Scene) -> None:
    canvas = draw("success_over_conditions", small)
    assert canvas is not None
    ax = canvas.axes[0]
    assert [text.get_text() for text in ax.get_yticklabels()] == [agent.label for agent in small.agents]
    words = [text.get_text() for text in ax.get_xticklabels()]
    assert (
        len(words) == len(set(words)) == len(ROBUSTNESS) + 5
    )  # with two other vehicles and three frequencies
    assert words[0] == "nominal"
    assert {"current 0.5 m/s", "mass × 1.3", "bluerov2-wu2018", "frequency 55 Hz"} <= set(words)
    cells = np.asarray(ax.images[0].get_array())
    assert cells.shape == (len(small.agents), len(words))
    assert cells[:, 0] == pytest.approx([100 * r["success_rate"] for r in _nominal(small)])
    runs, _ = load([run.directory for agent in small.agents for run in agent.runs], "transfer")
    (tested,) = (found for found in agents(runs, protocol="transfer") if found)
    expected = {c.name: c.success for c in results(tested, "transfer", 0.95)}["vehicle=bluerov2-wu2018"]
    column = cells[:, words.index("bluerov2-wu2018")]
    assert column == pytest.approx([100 * expected[agent.label].value for agent in small.agents])
    for (i, j), value in np.ndenumerate(cells):
        text = ax.texts[i * len(words) + j].get_text()
        assert (text == "100") == (value == 100.0), "nothing but every episode is 100"
        assert abs(float(text) - value) <= 1.0


def last_without_robustness(folder: Path, **protocols: tuple[str, ...]) -> tuple[Scene, Drawing]:
    """Two agents, of whom the last was not tested by `robustness`, and their matrix."""
    tested = {"test": ("nominal",), "robustness": ("nominal", "current=1"), **protocols}
    drawn_from = build(folder, algorithms=("ppo", "pid"), seeds=(0, 1), episodes=10, protocols=tested)
    for run in drawn_from.agents[-1].runs:
        shutil.rmtree(run.directory / "evaluations" / "robustness")
    with style.styled():
        drawing = resolve(FIGURES["success_over_conditions"])(drawn_from)
    assert drawing is not None
    return drawn_from, drawing


def test_an_agent_without_these_protocols_is_counted_and_not_drawn(tmp_path: Path) -> None:
    drawn_from, drawing = last_without_robustness(tmp_path / "runs")
    ax = drawing.canvas.axes[0]
    assert [text.get_text() for text in ax.get_yticklabels()] == [drawn_from.agents[0].label]
    n = len(drawn_from.agents)
    assert f"Shown: {n - 1} of {n} agents, the best-ranked that were tested." in drawing.caption
    assert "cross" not in drawing.caption


def test_what_an_agent_was_not_tested_under_is_crossed_out(tmp_path: Path) -> None:
    _, drawing = last_without_robustness(tmp_path / "runs", transfer=TRANSFER)
    ax = drawing.canvas.axes[0]
    missing = np.isnan(np.asarray(ax.images[0].get_array(), dtype=float))
    assert missing.tolist() == [[False] * 4, [True, True, False, False]]
    assert [text.get_text() for text in ax.texts].count("✕") == 2
    assert "A cross: not tested." in drawing.caption


def _nominal(drawn_from: Scene) -> list[dict[str, float]]:
    """Each agent's undisturbed condition, mean over seeds."""
    found = []
    for agent in drawn_from.agents:
        rates = [
            json.loads((run.directory / "evaluations" / "robustness" / "summary.json").read_text())[
                "conditions"
            ][0]
            for run in agent.runs
        ]
        found.append({"success_rate": float(np.mean([rate["success_rate"] for rate in rates]))})
    return found


def test_returns_of_different_k_ask_for_another_axis() -> None:
    assert wants_symlog([np.array([300.0, 400.0]), np.array([9000.0, 11000.0])])
    assert not wants_symlog([np.array([300.0, 400.0]), np.array([-900.0, 500.0])])
    assert not wants_symlog([])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            b"a,b\n1,2\n",
            "train/episodes.csv: it lacks the columns outcome, step, steps",
        ),
        (
            bytes(range(128, 256)),
            "train/episodes.csv: ",
        ),
        (
            b"",
            "train/episodes.csv: ",
        ),
    ],
)
def test_damage_met_while_drawing_is_named_in_a_problem(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    content: bytes,
    message: str,
) -> None:
    only(monkeypatch, "training_curves")
    written = write_experiment(tmp_path / "grid", algorithms=("ppo", "sac"), seeds=(0,), episodes=8)
    (written[0] / "train/episodes.csv").write_bytes(content)
    found, _ = agents(load([tmp_path / "grid"])[0])
    figures, problems = draw_all(found, rank(found), tmp_path)
    assert [(p.where, p.kind) for p in problems] == [(written[0].name, "damaged")]
    assert problems[0].message.startswith(message)
    caption = next(f.caption for f in figures if f.name == "training_curves")
    assert "Shown:" not in caption


def test_gazebo_has_the_changes_of_every_agent_in_both_hydrodynamics(small: Scene) -> None:
    canvas = draw("gazebo", small)
    assert canvas is not None
    (ax,) = canvas.axes
    assert [text.get_text() for text in ax.get_yticklabels()] == [agent.label for agent in small.agents]
    (legend,) = canvas.legends
    assert [text.get_text() for text in legend.get_texts()] == ["corrected Gazebo", "published Gazebo"]
    canvas.draw_without_rendering()
    box = ax.xaxis.label.get_window_extent()
    assert canvas.bbox.x0 <= box.x0
    assert box.x1 <= canvas.bbox.x1, "the label of the axis is cut off"
    drawn = sorted(
        float(line.get_xdata()[0])
        for line in ax.lines
        if line.get_marker() in ("o", "s") and len(line.get_xdata())
    )  # type: ignore[arg-type, index]
    root = small.agents[0].runs[0].directory.parent
    conditions = results(agents(load([root], ("test", "gazebo"))[0])[0], "gazebo", 0.95)
    assert drawn == pytest.approx(sorted(e.value for c in conditions for e in c.par1_change.values()))


def test_the_main_figure_tells_verdicts_by_shape_and_by_colour(small: Scene) -> None:
    primary = small.ranking.primary
    assert primary is not None
    canvas = draw("difference_from_baseline", small)
    assert canvas is not None
    (ax,) = canvas.axes
    assert [label.get_text() for label in ax.get_yticklabels()] == [
        row.label if primary.of(row.label) else f"{row.label} (baseline)" for row in small.ranking.rows
    ]
    assert len({look.marker for look in LOOKS.values()}) == len({x.colour for x in LOOKS.values()}) == 4
    left, right = ax.get_xlim()
    points = [line for line in ax.lines if len(line.get_xdata()) == 1]
    for place, row in enumerate(small.ranking.rows):
        against = primary.of(row.label)
        value = 100 * against.difference.value if against else 0.0
        drawn = [line for line in points if line.get_ydata()[0] == place and line.get_xdata()[0] == value]
        assert drawn
        assert left <= value <= right
        if against:
            assert (drawn[0].get_color(), drawn[0].get_marker()) == LOOKS[against.verdict][:2]


def test_the_main_figure_has_the_reliability_of_learners_next_to_their_verdicts(small: Scene) -> None:
    primary = small.ranking.primary
    assert primary is not None
    canvas = draw("difference_from_baseline", small)
    assert canvas is not None
    shown = [text.get_text() for text in canvas.axes[0].texts]
    expected = [
        f"{c.reliability.count} of {c.reliability.trainings}" for c in primary.comparisons if c.reliability
    ]
    assert expected
    assert shown == expected


def test_the_main_figure_marks_verdicts_from_few_trainings_and_says_when_an_agent_is_ahead(
    small: Scene,
) -> None:
    assert small.ranking.primary is not None
    first, *rest = small.ranking.primary.comparisons
    ends = Estimate(0.01, 0.005, 0.03)
    few = replace(first, difference=ends, verdict="ahead", trainings=5, enough=8)
    primary = replace(small.ranking.primary, comparisons=(few, *rest), margin=0.02)
    drawing = resolve(FIGURES["difference_from_baseline"])(
        scene(small.agents, replace(small.ranking, primary=primary))
    )
    assert drawing is not None
    labels = [label.get_text() for label in drawing.canvas.axes[0].get_yticklabels()]
    assert [label for label in labels if label.endswith("*")] == [f"{few.agent} *"]
    assert "* From few trainings: the verdict assumes" in drawing.caption
    assert "Grey: the margin, ±2 points. Equivalent: the interval lies within the margin." in drawing.caption
    assert "Ahead or behind: it excludes zero and reaches beyond the margin." in drawing.caption
    nothing = replace(few, difference=replace(ends, low=math.nan, high=math.nan), verdict="open")
    lone = replace(primary, comparisons=(nothing,))
    drawing = resolve(FIGURES["difference_from_baseline"])(
        scene(small.agents, replace(small.ranking, primary=lone))
    )
    assert drawing is not None
    assert "of too few trainings for intervals." in drawing.caption


@pytest.mark.parametrize("far", [30.0, 1e4])
def test_the_axis_shows_every_agent_and_does_not_squeeze_the_margin(small: Scene, far: float) -> None:
    assert small.ranking.primary is not None
    first, *rest = small.ranking.primary.comparisons
    wild = replace(first, difference=Estimate(far / 2, -far, far), verdict="open")
    primary = replace(small.ranking.primary, comparisons=(wild, *rest), margin=0.02)
    canvas = draw("difference_from_baseline", scene(small.agents, replace(small.ranking, primary=primary)))
    assert canvas is not None
    (ax,) = canvas.axes
    left, right = ax.get_xlim()
    for against in primary.comparisons:
        assert left <= 100 * against.difference.value <= right
        if math.isnan(against.difference.low):
            continue
        assert left <= 100 * against.difference.low
        assert 100 * against.difference.high <= right
    (a, _), (b, _) = ax.transAxes.inverted().transform(ax.transData.transform([(-2, 0), (2, 0)]))
    assert b - a > 0.03


@pytest.mark.parametrize("more", ["x" * 20, "current.speed_high=1.2 " * 8])
def test_long_names_leave_room_for_the_axis(
    small: Scene, recwarn: pytest.WarningsRecorder, more: str
) -> None:
    assert small.ranking.primary is not None
    rows = tuple(
        replace(row, label=f"{row.label}, trained at 25 Hz in gazebo with {more.strip()}")
        for row in small.ranking.rows
    )
    names = dict(zip([row.label for row in small.ranking.rows], [row.label for row in rows], strict=True))
    compared = tuple(replace(c, agent=names[c.agent]) for c in small.ranking.primary.comparisons)
    primary = replace(
        small.ranking.primary, comparisons=compared, baseline=names[small.ranking.primary.baseline]
    )
    canvas = draw(
        "difference_from_baseline", replace(small, ranking=replace(small.ranking, rows=rows, primary=primary))
    )
    assert canvas is not None
    canvas.draw_without_rendering()
    inches = canvas.axes[0].get_position().width * canvas.get_figwidth()
    assert inches > 1.5
    assert canvas.get_figwidth() < 9.0  # a longer name has several lines
    assert not recwarn.list, "the layout had no room"
