"""No edited, damaged or foreign file changes a number of a report without a word."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from auvbench.analysis.load import agents, load
from auvbench.analysis.recorded import paths, training
from auvbench.runs import integrity
from tests.synthetic import seal, write_experiment

Harm = Callable[[Path], object]


@pytest.fixture
def grid(tmp_path: Path) -> list[Path]:
    return write_experiment(
        tmp_path / "grid", algorithms=("ppo", "pid"), seeds=(0, 1), episodes=12, train_episodes=20
    )


def resealed(path: Path, **changes: object) -> None:
    path.write_text(json.dumps(integrity.sealed(json.loads(path.read_text()) | changes)))


def config(old: str, new: str) -> Harm:
    def harm(run: Path) -> None:
        text = (run / "config.yaml").read_text()
        assert re.search(old, text)
        (run / "config.yaml").write_text(re.sub(old, new, text, count=1))

    return harm


def edited(name: str, **changes: object) -> Harm:
    """Edited, and the digests left as they were."""

    def harm(run: Path) -> None:
        path = run / name
        path.write_text(json.dumps(json.loads(path.read_text()) | changes))

    return harm


def forged(name: str, **changes: object) -> Harm:
    """Edited with a seal that fits: only what it says of itself betrays it."""
    return lambda run: resealed(run / name, **changes)


def rows(change: Callable[[str], str]) -> Harm:
    def harm(run: Path) -> None:
        path = run / "evaluations" / "test" / "episodes.csv"
        path.write_text(change(path.read_text()))

    return harm


def all_arrive(text: str) -> str:
    return re.sub("timeout|collision", "success", text)


def one_digit(text: str) -> str:
    """The last digit of a number in the middle of the table."""
    lines = text.splitlines(keepends=True)
    at = re.search(r"\d(?=,)", lines[6][60:])
    assert at is not None
    place = 60 + at.start()
    lines[6] = lines[6][:place] + str((int(lines[6][place]) + 5) % 10) + lines[6][place + 1 :]
    return "".join(lines)


SUMMARY = "evaluations/test/summary.json"

HARMS: list[tuple[Harm, str]] = [
    (config(r"k: 1\b", "k: 100"), "config.yaml does not belong to the run .*: its id is ppo-k100-"),
    (config(r"frequency: 25\b", "frequency: 10"), "its id is ppo-k1-f10-s0-"),
    (config(r"seed: 0\b", "seed: 7"), "its id is ppo-k1-f25-s7-"),
    (config("name: ppo", "name: sac"), "its id is sac-k1-f25-s0-"),
    (config(r"gamma: 0\.99", "gamma: 0.9"), "its id is ppo-k1-f25-s0-"),
    (edited("manifest.json", seed=9), "manifest.json: it was changed since it was written"),
    (edited("manifest.json", wall_time_s=1.0), "manifest.json: it was changed since it was written"),
    (forged("manifest.json", seed=9), "manifest.json has the seed 9, but config.yaml has 0"),
    (forged("manifest.json", id="ppo-k1-f10-s0-00000000"), "does not belong to the run ppo-k1-f10-s0-0000"),
    (forged("manifest.json", algo="sac"), "manifest.json has the algo sac, but config.yaml has ppo"),
    (edited(SUMMARY, fingerprint="0" * 16), "summary.json: it was changed since it was written"),
    (forged(SUMMARY, run="ppo-k1-f10-s1-00000000"), "it belongs to the run ppo-k1-f10-s1-00000000"),
    (forged(SUMMARY, protocol="thesis"), "it belongs to the protocol thesis"),
    (rows(all_arrive), "differs from its digest|instead of"),
    (rows(one_digit), "differs from its digest"),
]


@pytest.mark.parametrize(("harm", "message"), HARMS)
def test_a_changed_file_is_named_and_keeps_the_run_out_of_the_table(
    grid: list[Path], harm: Harm, message: str
) -> None:
    assert load([grid[0].parent])[1] == []
    harm(grid[0])
    runs, problems = load([grid[0].parent])
    assert len(problems) == 1
    assert re.search(message, problems[0].message), problems[0].message
    found = {agent.label: [run.seed for run in agent.runs] for agent in agents(runs)[0]}
    assert found == {"PID": [0, 1], "PPO": [1]} or found == {"PID": [0], "PPO": [1]}


def test_another_run_s_evaluation_is_no_evaluation_of_this_one(grid: list[Path]) -> None:
    shutil.rmtree(grid[0] / "evaluations")
    shutil.copytree(grid[1] / "evaluations", grid[0] / "evaluations")
    _, problems = load([grid[0].parent])
    assert [problem.kind for problem in problems] == ["foreign"]
    assert f"it belongs to the run {grid[1].name}" in problems[0].message


def test_an_evaluation_of_other_weights_than_the_run_has_now(grid: list[Path]) -> None:
    seal(grid[0] / SUMMARY, model={"model/policy.pt": "of before"})
    assert [problem.kind for problem in load([grid[0].parent])[1]] == ["foreign"]


@pytest.mark.parametrize("entry", ["seal", "files"])
@pytest.mark.parametrize("name", [SUMMARY, "manifest.json"])
def test_without_seal_or_digests_a_file_is_damaged(grid: list[Path], name: str, entry: str) -> None:
    path = grid[0] / name
    held = json.loads(path.read_text())
    del held[entry]
    path.write_text(json.dumps(held))
    assert [problem.kind for problem in load([grid[0].parent])[1]] == ["damaged"]


@pytest.mark.slow
def test_no_flipped_bit_changes_a_number_without_a_word(grid: list[Path]) -> None:
    """Two hundred bits in every kind of file: each is named, or changes nothing that is read."""
    rng = np.random.default_rng(5)
    names = ["manifest.json", "config.yaml", SUMMARY, "evaluations/test/episodes.csv", "train/episodes.csv"]
    names.append("evaluations/test/trajectories.npz")

    def numbers() -> tuple[list[str], list[str], list[object]]:
        runs, problems = load([grid[0]])
        said = [str(problem) for problem in problems]
        found: list[str] = []
        drawn: list[object] = []
        for run in runs:
            found.append(repr((run.id, run.seed, run.state, sorted(run.config.items()), run.manifest)))
            for evaluation in run.evaluations.values():
                found.append(repr(evaluation.summary) + evaluation.episodes.to_csv())
                try:
                    drawn += list(paths(run, evaluation.protocol, "nominal", 3))
                except Exception as error:
                    said.append(str(error))
            try:
                found.append(repr(training(run)))
            except Exception as error:
                said.append(str(error))
        return found, said, drawn

    clean, problems, drawn = numbers()
    assert problems == []
    told = 0
    for name in names:
        path = grid[0] / name
        good = path.read_bytes()
        for _ in range(33):
            data = bytearray(good)
            data[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
            path.write_bytes(bytes(data))
            try:
                found, said, there = numbers()
            except Exception as error:  # no run at all is left
                said, found, there = [str(error)], [], []
            # What cannot change a result (where a run lies, how it is launched) is no number of a report.
            same = [_known(text) for text in found] == [_known(text) for text in clean]
            assert said or (same and repr(there) == repr(drawn)), (name, bytes(data)[:80])
            told += bool(said)
        path.write_bytes(good)
    assert told > 150


def _known(text: str) -> str:
    """Without the keys that no identity covers, since they cannot change a result."""
    return re.sub(
        r"\('(name|output|launcher\.\w+|simulator\.threads|train\.(checkpoint\.\w+|progress))', [^)]*\)",
        "",
        text,
    )
