"""The page's Python side: what it reads, packs, links and escapes."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import pytest

from auvbench.analysis.findings import SHOWN
from auvbench.analysis.ranking import rank
from auvbench.analysis.records import Agent, ClaimVerdict, Finding, Ranking, RunRecord
from auvbench.analysis.sources import RunFolder, StoredPath
from auvbench.reporting.page import parts as of_page
from auvbench.reporting.page import trajectories
from auvbench.reporting.page.parts import Links
from auvbench.reporting.tables.appendix import comparison_table
from auvbench.reporting.tables.main import main_table
from tests import page_data


class Elements(HTMLParser):
    """All tags with their attributes, and the text of scripts."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self._inside = False
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._inside = tag == "script"
        if self._inside:
            self.scripts.append("")

    def handle_endtag(self, tag: str) -> None:
        self._inside = False

    def handle_data(self, data: str) -> None:
        if self._inside:
            self.scripts[-1] += data

    def all(self, attribute: str) -> list[str]:
        return [value for _, attrs in self.tags if (value := attrs.get(attribute))]


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("page")
    return {"folder": folder, **page_data.parts(folder, episodes=30, train_episodes=50)}


def written(grid: dict[str, Any], **changes: Any) -> str:
    given = {key: value for key, value in grid.items() if key != "folder"} | changes
    path = grid["folder"] / "report" / ("changed.html" if changes else "index.html")
    return page_data.write(path, **given).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def html(grid: dict[str, Any]) -> str:
    return written(grid)


def test_same_arguments_same_bytes(grid: dict[str, Any], html: str) -> None:
    assert written(grid) == html


def test_nothing_comes_from_elsewhere(html: str) -> None:
    elements = Elements(html)
    assert all(src.startswith("data:") for src in elements.all("src"))
    assert all(href.startswith(("#", "./")) for href in elements.all("href"))
    # An SVG inside a data URI may name namespaces; the page's own text names no address at all but that one.
    text = re.sub(r"data:[^\"]*", "", html)
    assert set(re.findall(r"https?://[^\s\"'<]+", text)) <= {"http://www.w3.org/2000/svg"}


def test_policy_allows_the_pages_own_script_only(html: str) -> None:
    elements = Elements(html)
    policy = next(attrs["content"] for _, attrs in elements.tags if "http-equiv" in attrs)
    assert policy is not None
    run = [script for script in elements.scripts if not script.startswith("{")]
    digest = base64.b64encode(hashlib.sha256(run[0].encode()).digest()).decode()
    assert len(run) == 1
    assert f"script-src 'sha256-{digest}'" in policy
    assert "default-src 'none'" in policy


def test_links_lead_to_files_and_anchors_that_exist(grid: dict[str, Any], html: str) -> None:
    elements = Elements(html)
    ids = set(elements.all("id"))
    report = grid["folder"] / "report"
    for href in elements.all("href"):
        if href.startswith("#"):
            assert href[1:] in ids, href
        else:
            assert (report / unquote(href)).exists(), href
    assert sum("manifest.json" in href for href in elements.all("href")) == len(grid["runs"])
    assert len(ids) == len(elements.all("id"))


def test_every_agent_of_the_main_table_leads_to_its_runs(grid: dict[str, Any]) -> None:
    links = Links(grid["folder"] / "report" / "index.html", grid["runs"])
    lines = of_page.of_agents(main_table(grid["ranking"]), grid["ranking"], {}, links).lines
    runs = of_page.runs_table(grid["runs"], grid["agents"], {}, links).lines
    first = {line.cells[1].value: f"#{line.anchor}" for line in reversed(runs)}
    assert {line.cells[0].value: line.href for line in lines} == first


def test_one_training_seed_is_marked(tmp_path: Path) -> None:
    parts = page_data.parts(tmp_path, algorithms=("sac", "pid"), seeds=(0,), episodes=10, train_episodes=20)
    links = Links(tmp_path / "index.html", parts["runs"])
    shown = of_page.of_agents(main_table(parts["ranking"]), parts["ranking"], {}, links)
    assert {line.cells[0].value for line in shown.lines} == {"SAC †", "PID"}
    html = page_data.write(tmp_path / "index.html", **parts).read_text(encoding="utf-8")
    assert "† one training seed: the row describes this policy" in html


def test_the_answer_stands_before_everything_else(grid: dict[str, Any], html: str) -> None:
    places = [html.index(part) for part in ("<h1>", 'id="main-table"', 'id="findings"', 'id="appendix"')]
    assert places == sorted(places)
    primary = grid["ranking"].primary
    for verdict in {c.verdict for c in primary.comparisons} | {"baseline"}:
        assert f'<tr class="{verdict}"' in html
    assert html.count("<h1>") == 1


def test_five_findings_are_shown_and_the_others_folded(grid: dict[str, Any], html: str) -> None:
    shown, folded = html.partition('id="findings"')[2].split('<details class="more"', 1)
    assert shown.count("<li>") == SHOWN
    assert "2 more findings" in folded


def test_a_verdict_about_a_learner_has_its_reliability_next_to_it(grid: dict[str, Any], html: str) -> None:
    compared = {len(row.seeds) for row in grid["ranking"].rows if row.trained and row.compared}
    main = html.partition('id="main-table"')[2].partition("</table>")[0]
    assert "trainings that are not behind the baseline by more than the margin" in main
    assert compared
    assert all(f"of {n}</span>" in main for n in compared)


def test_ranks_are_folded_in_the_appendix(grid: dict[str, Any], html: str) -> None:
    appendix = html.partition('id="appendix"')[2].partition('id="runs"')[0]
    assert 'id="ranks-table"' in appendix
    assert "<details open" not in appendix


def test_hostile_names_stay_text(grid: dict[str, Any]) -> None:
    evil = page_data.EVIL
    agents = [dataclasses.replace(grid["agents"][0], label=evil), *grid["agents"][1:]]
    run = dataclasses.replace(grid["runs"][0], id=evil, state=evil, manifest={"versions": {evil: evil}})
    html = written(
        grid,
        agents=agents,
        ranking=rank(agents, problems=[page_data.hostile_problem()]),
        runs=[run, *grid["runs"][1:]],
        findings=[Finding("effect", evil, basis=evil)],
        claims=[ClaimVerdict(evil, evil, evil, evil)],
        command=evil,
    )
    elements = Elements(html)
    assert evil not in html
    assert not any(name.startswith("on") for _, attrs in elements.tags for name in attrs)
    assert [tag for tag, _ in elements.tags].count("script") == 2
    assert "url(" not in " ".join(elements.all("style"))
    data = json.loads(next(script for script in elements.scripts if script.startswith("{")))
    assert evil in {agent["label"] for agent in data["agents"]}


def test_links_of_strange_folders_are_quoted(tmp_path: Path) -> None:
    folder = tmp_path / "a b#c%41?'\"<x>" / "run:1"
    folder.mkdir(parents=True)
    (folder / "manifest.json").write_text("{}")
    run = RunRecord("run", RunFolder(folder), "failed", 0, {}, {})
    href = Links(tmp_path / "report" / "index.html", [run]).files(run)
    assert not set(href) & set("#?'\"<> ")
    assert (tmp_path / "report" / unquote(href)).resolve() == folder / "manifest.json"


def test_page_without_anything_to_rank(tmp_path: Path) -> None:
    ranking = Ranking((), "success_rate", "test", "nominal", "", 0.95, None, ())
    run = RunRecord("pid-1", RunFolder(tmp_path), "pending", 0, {}, {})
    path = page_data.write(tmp_path / "r" / "index.html", ranking=ranking, agents=[], runs=[run])
    assert "No agent could be ranked" in path.read_text()
    assert "pid-1" in path.read_text()


def test_failed_write_keeps_the_old_page(grid: dict[str, Any], html: str) -> None:
    path = grid["folder"] / "report" / "index.html"
    given = {key: value for key, value in grid.items() if key != "folder"} | {"figures": [None]}
    with pytest.raises(AttributeError):
        page_data.write(path, **given)
    assert path.read_text(encoding="utf-8") == html
    assert [child.name for child in path.parent.iterdir() if child.name.startswith(".")] == []


def test_numbers_of_a_study_stand_with_ours(grid: dict[str, Any], html: str) -> None:
    shown = comparison_table(grid["comparison"])
    assert shown is not None
    lines = {line.cells[0].value: line.cells for line in shown.lines}
    mine, other = lines["SAC4 (SAC)"], next(cells for name, cells in lines.items() if "not run" in name)
    agent = next(agent for agent in grid["agents"] if agent.label == "SAC")
    theirs, ours = mine[1].value.split(" / ")
    assert float(theirs) == 100
    assert float(ours) == pytest.approx(100 * agent.success.mean(), abs=1)
    assert other[1].value.endswith("/ –")
    assert 'id="comparison-table"' in html


# Trajectories


def unpacked(track: dict[str, Any]) -> np.ndarray:
    counts = np.frombuffer(base64.b64decode(track["points"]), "<i2").reshape(-1, 3)
    return np.asarray(counts * track["unit"])


def track_of(run: RunRecord, position: np.ndarray, **more: Any) -> trajectories.Track:
    time = np.arange(len(position)) / 10.0
    return trajectories.Track(0, run, "success", StoredPath(0, (1.0, 2.0, -3.0), position, time, **more))


@pytest.fixture
def run(tmp_path: Path) -> RunRecord:
    return RunRecord("run", RunFolder(tmp_path), "complete", 7, {}, {})


@pytest.mark.parametrize("steps", [0, 1, 2, 319, 320, 1000])
def test_packed_path_keeps_its_ends_and_times(run: RunRecord, steps: int) -> None:
    position = np.cumsum(np.random.default_rng(1).normal(0, 0.1, (steps + 1, 3)), axis=0)
    track = trajectories.pack([track_of(run, position)])[0]["tracks"][0]
    points = unpacked(track)
    assert len(points) <= trajectories.POINTS
    assert track["end"] == pytest.approx(steps / 10)
    steps_kept = np.minimum(np.arange(len(points)) * track["dt"] * 10, steps)
    np.testing.assert_allclose(points, position[np.rint(steps_kept).astype(int)], atol=0.0051)
    assert steps_kept[-1] == pytest.approx(steps)


def test_far_path_fits_with_a_coarser_unit(run: RunRecord) -> None:
    position = np.linspace([0, 0, -20], [1500, -1500, -20], 200)
    track = trajectories.pack([track_of(run, position)])[0]["tracks"][0]
    np.testing.assert_allclose(unpacked(track), position, atol=1500 / 32767)


def test_a_reference_is_packed_with_its_path(run: RunRecord) -> None:
    position = np.cumsum(np.random.default_rng(2).normal(0, 0.1, (600, 3)), axis=0)
    guided = track_of(run, position, reference=position + 400.0, dock_yaw=1.0)
    packed = trajectories.pack([guided])[0]
    (both,) = packed["tracks"]
    assert packed["dock_yaw"] == 1.0
    reference = unpacked(both | {"points": both["reference"]})
    np.testing.assert_allclose(reference - unpacked(both), 400.0, atol=2 * both["unit"])
    plain = trajectories.pack([track_of(run, position)])[0]
    assert "reference" not in plain["tracks"][0]
    assert "dock_yaw" not in plain


def test_the_other_vehicles_of_a_team_are_packed_with_its_path(run: RunRecord) -> None:
    position = np.cumsum(np.random.default_rng(2).normal(0, 0.1, (600, 3)), axis=0)
    others = np.stack([position + 3.0, position - 400.0], axis=1)
    team = trajectories.pack([track_of(run, position, reference=position + 1.0, others=others)])[0]["tracks"][
        0
    ]
    for text, shift in zip([team["reference"], *team["others"]], (1.0, 3.0, -400.0), strict=True):
        away = unpacked(team | {"points": text}) - unpacked(team)
        np.testing.assert_allclose(away, shift, atol=2 * team["unit"])
    assert "others" not in trajectories.pack([track_of(run, position)])[0]["tracks"][0]
    many = trajectories.pack([track_of(run, position, others=others)] * 50, budget=50_000)[0]["tracks"]
    assert len(json.dumps(many)) < 100_000


def test_signals_are_packed_with_their_path(run: RunRecord) -> None:
    """A vehicle that turns once at 2 m/s, and a command of 3 and 4 N."""
    turn = np.linspace(0.0, 2.0 * np.pi, 201)
    position = np.stack([0.2 / turn[1] * np.cos(turn), 0.2 / turn[1] * np.sin(turn), 0.0 * turn], axis=1)
    yaw, command = np.angle(np.exp(1j * turn)), np.tile([3.0, 4.0], (200, 1))
    track = trajectories.pack([track_of(run, position, yaw=yaw, command=command)])[0]["tracks"][0]
    seen = {
        name: np.frombuffer(base64.b64decode(text), "<i2") * track["units"][name]
        for name, text in track["signals"].items()
    }
    np.testing.assert_allclose(seen["speed"][1:-1], 2.0, atol=0.01)
    np.testing.assert_allclose(seen["yaw"], np.degrees(turn), atol=0.01)
    np.testing.assert_allclose(seen["command"], 5.0, atol=0.001)
    assert set(trajectories.pack([track_of(run, position)])[0]["tracks"][0]["signals"]) == {"speed"}


def test_solids_are_packed_once_for_all_paths_of_an_episode(run: RunRecord) -> None:
    position = np.zeros((5, 3))
    few, many = (np.random.default_rng(n).uniform(-30.0, 30.0, (n, 2, 3)) for n in (7, 9))
    packed = trajectories.pack([track_of(run, position, outlines=lines) for lines in (few, many)])[0]
    counts = np.frombuffer(base64.b64decode(packed["outlines"]), "<i2").reshape(-1, 2, 3)
    np.testing.assert_allclose(counts * packed["outlines_unit"], many, atol=0.0051)
    assert not any("outlines" in track for track in packed["tracks"])
    assert "outlines" not in trajectories.pack([track_of(run, position)])[0]


def test_budget_thins_paths(run: RunRecord) -> None:
    packed = trajectories.pack([track_of(run, np.zeros((1001, 3)))] * 100, budget=100_000)
    assert len(json.dumps([t["points"] for t in packed[0]["tracks"]])) < 110_000
    assert len(unpacked(packed[0]["tracks"][0])) >= 24


def test_paths_of_all_agents_share_an_episode(grid: dict[str, Any]) -> None:
    tracks, _, _ = trajectories.read(grid["agents"], protocol="test", condition="nominal")
    assert [track.path.episode for track in tracks] == [e for e in range(3) for _ in grid["runs"]]
    for track in tracks:
        frame = track.run.evaluations["test"].episodes
        row = frame[frame["episode"] == track.path.episode].iloc[0]
        assert track.outcome == row["outcome"]
        assert len(track.path.position) == row["steps"] + 1
    assert trajectories.read(grid["agents"], protocol="test", condition="severe")[0] == []


def test_first_seeds_come_before_second_ones(grid: dict[str, Any]) -> None:
    agents = grid["agents"]
    tracks, _, left_out = trajectories.read(agents, protocol="test", condition="nominal", runs=len(agents))
    assert {track.agent for track in tracks} == set(range(len(agents)))
    assert left_out == len(grid["runs"]) - len(agents)


@pytest.mark.parametrize("harm", ["cut", "shape", "nan", "pickle", "no time"])
def test_damaged_trajectories_are_named(tmp_path: Path, harm: str) -> None:
    parts = page_data.parts(tmp_path, algorithms=("pid", "sac"), seeds=(0,), episodes=5, train_episodes=0)
    agent: Agent = parts["agents"][0]
    path = agent.runs[0].directory / "evaluations" / "test" / "trajectories.npz"
    with np.load(path, allow_pickle=False) as file:
        arrays = dict(file)
    if harm == "cut":
        path.write_bytes(path.read_bytes()[:2000])
    else:
        if harm == "shape":
            arrays["position_nominal_0"] = arrays["position_nominal_0"][:, :2]
        elif harm == "nan":
            arrays["position_nominal_0"][3, 1] = np.nan
        elif harm == "pickle":
            arrays["position_nominal_0"] = np.array([[object()]])
        else:
            del arrays["time_nominal_0"]
        np.savez(path, **arrays)
    tracks, problems, _ = trajectories.read(parts["agents"], protocol="test", condition="nominal")
    assert [(p.where, p.kind) for p in problems] == [(agent.runs[0].id, "damaged")]
    assert {track.agent for track in tracks} == {1}
    assert "trajectories.npz: " in page_data.write(tmp_path / "index.html", **parts).read_text()


# Figures


def test_large_svg_gives_way_to_its_png(tmp_path: Path) -> None:
    drawn = page_data.figures(tmp_path)
    drawn[1].svg.write_bytes(drawn[1].svg.read_bytes() + b" " * of_page.LARGEST_SVG)
    links = Links(tmp_path / "index.html", [])
    found, problems = of_page.embed(drawn, links)
    assert [f.data.partition(";")[0] for f in found] == ["data:image/svg+xml", "data:image/png"]
    assert base64.b64decode(found[1].data.partition(",")[2]) == drawn[1].png.read_bytes()
    assert problems == []


def test_lost_figures_are_named(tmp_path: Path) -> None:
    drawn = page_data.figures(tmp_path, count=3)
    drawn[2].png.unlink()
    links = Links(tmp_path / "index.html", [])
    found, problems = of_page.embed(drawn, links)
    assert [figure.href for figure in found] == ["./figure0.svg", "./figure1.svg"]
    assert [(p.where, p.kind) for p in problems] == [("figure2", "missing")]


# Numbers


@pytest.mark.slow
def test_200_runs_and_large_figures_stay_under_10_megabytes(tmp_path: Path) -> None:
    grid = {"algorithms": ("ppo", "sac"), "reward_k": (1.0, 2.0, 5.0, 10.0, 40.0), "seeds": range(20)}
    parts = page_data.parts(tmp_path, **grid, episodes=10, train_episodes=0, trajectories=10)
    assert len(parts["runs"]) == 200
    drawn = page_data.figures(tmp_path / "large", count=12)
    noise = np.random.default_rng(0)
    for figure in drawn:
        figure.svg.write_bytes(figure.svg.read_bytes() + b" " * of_page.LARGEST_SVG)
        figure.png.write_bytes(figure.png.read_bytes() + noise.bytes(250_000))
    path = page_data.write(tmp_path / "report" / "index.html", **(parts | {"figures": drawn}))
    assert 4e6 < path.stat().st_size < 10e6


@pytest.mark.parametrize(("episodes", "shown"), [(7, "–"), (30, "100.0")])
def test_a_rate_of_a_few_training_episodes_is_not_shown(
    episodes: int, shown: str, grid: dict[str, Any]
) -> None:
    run = next(run for run in grid["runs"] if run.config["algo.name"] == "ppo")
    manifest = {**run.manifest, "episodes": episodes, "success_rate": 1.0}
    _, success, _ = of_page._training(dataclasses.replace(run, manifest=manifest))
    assert success.text == shown
